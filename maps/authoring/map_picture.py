"""Picture of a map for its author.

`python -m maps.authoring.map_picture Town03 OUT.png [xmin xmax ymin ymax]` from the repository root.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from carlaloc_env.town.lanes.build_network import build_network
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.lanes.records import SIGN_CODES
from carlaloc_env.town.opendrive.records import OpenDrive
from maps.authoring.build import MAPS

_FLAT = {"sidewalk": "#d9cfc0", "median": "#a9c59b"}
_SIGNS = {SIGN_CODES["stop"]: "r8", SIGN_CODES["yield"]: "y^", SIGN_CODES["speed"]: "b."}


def draw(source: Path, out: Path, window: Sequence[float], dpi: int = 110) -> None:
    """Lanes coloured by elevation, with lights, signs, crosswalks and stop lines."""
    network = build_network(source)
    figure, axes = plt.subplots(figsize=(14, 14))
    shapes, colours = _lanes(network)
    axes.add_collection(PolyCollection(shapes, facecolors=colours, edgecolors="#0004", linewidths=0.3))
    _furniture(axes, network.xodr, network)
    axes.set_aspect("equal")
    if window:
        axes.set_xlim(window[0], window[1])
        axes.set_ylim(window[2], window[3])
    else:
        axes.autoscale()
    figure.tight_layout()
    figure.savefig(out, dpi=dpi)


def _lanes(network: LaneNetwork) -> tuple[list[np.ndarray], list[object]]:
    shapes, colours = [], []
    heights = colormaps["turbo"]
    order = sorted(network.lanes, key=lambda lane: (lane.type == "driving", lane.length_m))
    for lane in order:
        station = np.linspace(0.0, lane.length_m, max(3, int(lane.length_m)))
        index = np.full(len(station), lane.index)
        pose = network.pose(index, station)
        half = 0.5 * network.width_m(index, station)
        side = np.stack([-np.sin(pose.heading_rad), np.cos(pose.heading_rad)], axis=1) * half[:, None]
        left, right = pose.position_m[:, :2] + side, pose.position_m[:, :2] - side
        if lane.type == "driving":
            for k in range(len(station) - 1):
                shapes.append(np.array([left[k], left[k + 1], right[k + 1], right[k]]))
                colours.append(heights((pose.position_m[k, 2] + 6.0) / 14.0))
        else:
            shapes.append(np.concatenate([left, right[::-1]]))
            colours.append(_FLAT.get(lane.type, "#999999"))
    return shapes, colours


def _furniture(axes: Axes, xodr: OpenDrive, network: LaneNetwork) -> None:
    for crosswalk in network.crosswalks:
        polygon = np.asarray(crosswalk.polygon_m)
        axes.fill(polygon[:, 0], polygon[:, 1], color="white", alpha=0.6)
    for signal in network.signals:
        T = signal.T_world_signal
        axes.plot(T[0, 3], T[1, 3], "ms", markersize=4)
        axes.arrow(T[0, 3], T[1, 3], 3 * T[0, 0], 3 * T[1, 0], color="m", width=0.1)
        for lane, station in zip(signal.lanes, signal.stop_station_m, strict=True):
            stop = network.pose([lane], [station]).position_m[0]
            axes.plot([T[0, 3], stop[0]], [T[1, 3], stop[1]], "m-", linewidth=0.4)
    for sign in network.static_signs:
        T = sign.T_world_sign
        axes.plot(T[0, 3], T[1, 3], _SIGNS.get(sign.type, "kx"), markersize=4)


def main() -> int:
    """Draw one town."""
    name, out = sys.argv[1:3]
    window = [float(v) for v in sys.argv[3:7]]
    draw(MAPS / name / "town.xodr", Path(out), window)
    return 0


if __name__ == "__main__":
    sys.exit(main())
