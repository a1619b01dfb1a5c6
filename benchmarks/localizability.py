"""How well LiDAR scans hold the car along each town's route: `benchmarks/localizability.py [TOWN ...]`.

The least eigenvalue of the point-to-plane information about a shift, per point, for the paper's LiDAR
without traffic (`recorder.slam.localizability`): its median over the route, the worst 100 m, and the longest
stretch below a tenth of Town03's median. `firm`: leaves and grass hold nothing. `--curve` draws it.
"""

from __future__ import annotations

import argparse

import numpy as np

from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.lidar.config import LidarConfig
from carlaloc_env.town.build import load_town
from carlaloc_env.town.sources import known_towns
from recorder.slam.localizability import longest_below, weakest_stretch
from recorder.slam.route_localizability import RouteLocalizability, route_localizability

REFERENCE = "Town03"
FRACTION, LONGEST_M = 0.1, 100.0
"""No stretch longer than this lies below this fraction of the reference's median."""
_BAR = 60


def draw_curve(curve: RouteLocalizability, full: float, limit: float) -> None:
    """One line every 20 m; `full` fills it."""
    step = max(round(20.0 / (curve.station_m[1] - curve.station_m[0])), 1)
    for k in range(0, len(curve.station_m), step):
        firm, least = curve.firm[k : k + step].mean(), curve.least[k : k + step].mean()
        bar = "#" * min(round(_BAR * firm / full), _BAR)
        mark = "<" if firm < limit else " "
        print(f"  {curve.station_m[k]:6.0f} m  {least:.4f}  {firm:.4f} {mark} {bar}")


def main() -> None:
    """Measure the towns that were asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("towns", nargs="*", help="all when left out")
    parser.add_argument("--step", type=float, default=5.0, help="distance of the scans [m]")
    parser.add_argument("--curve", action="store_true", help="draw it along the route")
    arguments = parser.parse_args()
    lidar = next(c for c in rig_by_name("paper").sensors if isinstance(c, LidarConfig))
    names = list(arguments.towns or known_towns())
    curves = {
        name: route_localizability(load_town(name), lidar, step_m=arguments.step)
        for name in dict.fromkeys([REFERENCE, *names])
    }
    full = float(np.median(curves[REFERENCE].firm))
    limit = FRACTION * full
    print(f"limit {limit:.5f}: a tenth of {REFERENCE}'s median of firm returns")
    print(
        "town     route m   median all   firm     worst 100 m: firm   from m   longest below limit m   from m"
    )
    for name in names:
        curve = curves[name]
        worst, begin = weakest_stretch(curve.station_m, curve.firm, LONGEST_M)
        length, start = longest_below(curve.station_m, curve.firm, limit)
        verdict = "" if length <= LONGEST_M else "   TOO LONG"
        print(
            f"{name:8} {curve.station_m[-1]:7.0f} {np.median(curve.least):12.4f} {np.median(curve.firm):8.4f}"
            f" {worst:19.4f} {begin:8.0f} {length:23.0f} {start:8.0f}{verdict}"
        )
        if arguments.curve:
            draw_curve(curve, full, limit)


if __name__ == "__main__":
    main()
