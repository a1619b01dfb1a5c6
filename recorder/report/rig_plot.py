"""Draws where the sensors of a rig sit on the car, from the left side and from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carlaloc_env.assets.vehicles.cars import ego_body
from carlaloc_env.core.files.output_paths import check_output_file
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.base import SensorConfig
from recorder.report.canvas import COLOURS, new_figure, save_figure

_ARROW_M = 0.45
"""Length of the arrows [m]."""
_VIEWS = (("from the left", (0, 2), "up [m]"), ("from above", (0, 1), "left [m]"))


def plot_rig(rig: SensorRig, path: str | Path, *, overwrite: bool = False) -> Path:
    """Draw the car and its sensors as a PNG; arrows show where cameras, LiDARs and radars look.

    Args:
        rig: The sensors.
        path: New image (.png).
        overwrite: Whether an older one is replaced.

    Raises:
        OutputError: the image exists, or its name is not that of an image.
        EvaluationError: the image cannot be written.
        MissingDependencyError: matplotlib is not installed.
    """
    check_output_file(path, suffixes=(".png",), overwrite=overwrite)
    from matplotlib.collections import PolyCollection

    places: dict[tuple[float, float, float], list[SensorConfig]] = {}
    for sensor in rig.sensors:
        places.setdefault(sensor.mount.position_m, []).append(sensor)
    figure, body = new_figure(11.0, 7.5), ego_body()
    figure.suptitle(f"Rig {rig.name}: base_link, on the ground below the rear axle")
    corners_m = np.asarray(body.vertices_m, np.float64)[body.triangles]
    for axes, (title, shown, label) in zip(figure.subplots(2, 1, sharex=True), _VIEWS, strict=True):
        axes.add_collection(PolyCollection(list(corners_m[:, :, list(shown)]), color="#d9d9d9", lw=0))
        axes.plot(0.0, 0.0, "+", color="black", ms=12)
        for k, (place, sensors) in enumerate(places.items()):
            colour = COLOURS[k % len(COLOURS)]
            at = [place[axis] for axis in shown]
            for sensor in sensors:
                # The optical axis of cameras, the x axis of others.
                ahead = sensor.mount.T_base_sensor[:3, 2 if sensor.mount.axes == "optical" else 0]
                if sensor.kind in ("camera", "lidar", "radar"):
                    tip = [place[axis] + _ARROW_M * float(ahead[axis]) for axis in shown]
                    axes.annotate("", tip, at, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.5})
                    axes.plot(*tip, alpha=0.0)
            names = ", ".join(f"{s.kind} {s.name}" if s.kind != s.name else s.name for s in sensors)
            where = ", ".join(f"{metres:.2f}" for metres in place)
            axes.plot(*at, "o", color=colour, ms=11, label=f"{k + 1}  {names}  [{where}]")
            axes.annotate(str(k + 1), at, ha="center", va="center", color="white", fontsize=8)
        axes.set(title=title, ylabel=label, aspect="equal")
        axes.grid(alpha=0.3)
        axes.margins(0.08)
    axes.set_xlabel("forward [m]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=9, frameon=False)
    return save_figure(figure, Path(path))
