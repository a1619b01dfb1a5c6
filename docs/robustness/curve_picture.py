"""Draws curves of sweeps: a row for each town, a column for each quantity."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

_PANEL_IN, _DPI = (4.2, 3.0), 110
LABELS = {
    "fog_visibility_m": "visibility in fog [m]",
    "traffic": "multiple of the recorded traffic",
    "fault.lidar.time_offset_ms": "time offset of the LiDAR [ms]",
}
"""Labels of the axes."""


def draw_curves(towns: dict[str, pd.DataFrame], out: Path) -> None:
    """Draw APE with its bands; crosses at the top edge are values at which all runs fail.

    Args:
        towns: ``curves.csv`` of `carlaloc sweep` for each town.
        out: PNG file.
    """
    if not towns:
        return
    axes_names = list(dict.fromkeys(name for curves in towns.values() for name in curves["axis"]))
    width, height = _PANEL_IN
    figure = Figure((width * len(axes_names), height * len(towns)), dpi=_DPI, layout="constrained")
    panels = figure.subplots(len(towns), len(axes_names), squeeze=False, sharey="row")
    for row, (town, curves) in zip(panels, towns.items(), strict=True):
        for panel, name in zip(row, axes_names, strict=True):
            here = curves[curves["axis"] == name].groupby("series", sort=False)
            for number, (series, curve) in enumerate(here):
                _draw(panel, series, curve.sort_values("value"), f"C{number}", number)
            panel.set_yscale("log")
            if name.startswith("fog"):
                panel.set_xscale("log")
                values = sorted(set(curves.loc[curves["axis"] == name, "value"]))
                panel.set_xticks(values, [f"{value:.0f}" for value in values])
                panel.minorticks_off()
            panel.set_xlabel(LABELS.get(name, name))
            panel.grid(alpha=0.3)
        row[0].set_ylabel(f"{town}: APE [m]")
    panels[0][-1].legend(fontsize=8)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out)


def _draw(panel: object, series: str, curve: pd.DataFrame, colour: str, number: int) -> None:
    x, y = curve["value"].to_numpy(float), curve["ape_m"].to_numpy(float)
    panel.plot(x, y, "o-", ms=3, color=colour, label=series)  # type: ignore[attr-defined]
    failed = curve["failed"].to_numpy() == curve["runs"].to_numpy()
    if np.any(failed):
        height = np.full(int(failed.sum()), 0.98 - 0.04 * number)
        panel.plot(x[failed], height, "x", color=colour, transform=panel.get_xaxis_transform())  # type: ignore[attr-defined]
