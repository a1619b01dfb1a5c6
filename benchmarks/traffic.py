"""How traffic behaves and what it costs: one row per town.

``python benchmarks/traffic.py Town03 237 34 120`` runs Town03 with 237 vehicles and 34 walkers for 120 s.
"""

import sys
from pathlib import Path

from traffic_audit import TrafficReport, audit_traffic

from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.sources import find_town
from carlaloc_env.traffic.traffic_config import TrafficConfig

PAPER_COUNTS = {
    "Town01": (102, 30),
    "Town03": (237, 34),
    "Town04": (296, 34),
    "Town05": (241, 44),
    "Town06": (218, 50),
    "Town07": (91, 36),
    "Town10": (108, 56),
}
"""Vehicles and walkers of the paper's seven sequences."""


def run_town(
    town: str,
    vehicles: int | None = None,
    walkers: int | None = None,
    duration_s: float = 600.0,
    seed: int = 1,
) -> TrafficReport:
    """Watch the traffic of a town or an OpenDRIVE file, by default at the paper's counts."""
    source = Path(town) if town.endswith(".xodr") else find_town(town)
    usual = PAPER_COUNTS.get(town, (50, 10))
    config = TrafficConfig(
        vehicles=usual[0] if vehicles is None else vehicles,
        walkers=usual[1] if walkers is None else walkers,
        seed=seed,
    )
    return audit_traffic(build_network(source), config, duration_s)


def table(rows: dict[str, TrafficReport]) -> str:
    """All reports as one table."""
    lines = [
        f"{'town':10} {'veh':>4} {'walk':>4} {'s':>5} {'overlap %':>9} {'stand s':>8} {'v/limit':>8} "
        f"{'red':>4} {'lines':>6} {'hits':>5} {'astray':>6} {'across':>6} {'changes':>7} {'ms min/med':>12}"
    ]
    for name, r in rows.items():
        lines.append(
            f"{name:10} {r.vehicles:4} {r.walkers:4} {r.duration_s:5.0f} {100 * r.overlap_fraction:9.4f} "
            f"{r.longest_stand_s:8.1f} {r.speed_fraction:8.3f} {r.red_runs:4} {r.lines_crossed:6} "
            f"{r.walker_hits:5} {r.walkers_astray:6} {r.walked_across:6} {r.lane_changes:7} "
            f"{r.step_ms[0]:6.2f}/{r.step_ms[1]:.2f}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    chosen = sys.argv[1] if len(sys.argv) > 1 else "Town03"
    counts = [int(text) for text in sys.argv[2:4]] + [None, None]
    seconds = float(sys.argv[4]) if len(sys.argv) > 4 else 600.0
    print(table({Path(chosen).name: run_town(chosen, counts[0], counts[1], seconds)}))
