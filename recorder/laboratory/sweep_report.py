"""Files of a sweep: runs, curves and areas as CSV, a plot for each axis, and one page."""

import base64
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write, write_whole
from recorder.benchmark.page import page_head
from recorder.benchmark.tables import RULE
from recorder.evaluation.confidence import CONFIDENCE
from recorder.laboratory.sweep import Axis
from recorder.laboratory.sweep_curves import areas_of, curves_of
from recorder.laboratory.sweep_run import SweepResult
from recorder.report.canvas import COLOURS, new_figure

PANELS = (
    ("ape_m", "APE [m]"),
    ("rpe_m", "RPE [m]"),
    ("coverage", "coverage"),
    ("fail_share", "share of failures"),
)
"""Curves of a figure, and their labels."""


def write_sweep_report(result: SweepResult) -> list[Path]:
    """Write ``runs.csv``, ``curves.csv``, ``areas.csv``, a PNG for each axis, and ``sweep.html``.

    Raises:
        EvaluationError: a file cannot be written.
        MissingDependencyError: matplotlib is not installed.
    """
    out, axes = result.config.out, result.config.axes
    curves = curves_of(result.runs, axes)
    areas = areas_of(curves, axes)
    tables = {"runs.csv": result.runs, "curves.csv": curves, "areas.csv": areas}
    for name, table in tables.items():
        write_whole(out / name, table.to_csv(index=False, na_rep="nan"), EvaluationError)
    figures = {axis: out / f"{axis.name}.png" for axis in axes}
    for axis, path in figures.items():
        draw_axis(curves[curves["axis"] == axis.name], axis, path)
    write_whole(out / "sweep.html", _page(result, curves, areas, figures), EvaluationError)
    return [*(out / name for name in tables), *figures.values(), out / "sweep.html"]


def draw_axis(curves: pd.DataFrame, axis: Axis, path: Path) -> None:
    """Draw curves with their bands, one panel for each of `PANELS`."""
    figure = new_figure(11.0, 7.2)
    places = figure.subplots(2, 2, sharex=True).flat
    for place, (name, label) in zip(places, PANELS, strict=True):
        for number, (series, curve) in enumerate(curves.groupby("series", sort=False)):
            colour = COLOURS[number % len(COLOURS)]
            place.plot(curve["value"], curve[name], "o-", color=colour, ms=4, lw=1.5, label=series)
            low, high = curve[f"{name}_low"], curve[f"{name}_high"]
            place.fill_between(curve["value"], low, high, color=colour, alpha=0.18, lw=0)
            # Bands have no width where their neighbours failed.
            place.vlines(curve["value"], low, high, color=colour, alpha=0.5, lw=1.0)
        if axis.is_log:
            place.set_xscale("log")
            place.set_xticks(axis.values, [f"{value:g}" for value in axis.values])
            place.minorticks_off()
        if name in ("coverage", "fail_share"):
            place.set_ylim(-0.04, 1.04)
        else:
            place.set_ylim(bottom=0.0)
        place.set(ylabel=label)
        place.grid(alpha=0.3)
    for place in figure.axes[2:]:
        place.set_xlabel(axis.name)
    figure.axes[0].legend(frameon=False, fontsize=9)
    with atomic_write(path, EvaluationError) as part:
        figure.savefig(part, dpi=120, format="png")


def _page(result: SweepResult, curves: pd.DataFrame, areas: pd.DataFrame, figures: dict[Axis, Path]) -> str:
    drives = ", ".join(path.stem for path in result.config.drives.episodes)
    band = (
        f"Bands are {CONFIDENCE:.0%} intervals over seeds and drives: Student's of means, Wilson's of shares."
    )
    parts = [
        page_head("Sweep"),
        f"<h1>Sweep</h1>\n<p>{escape(drives)}; {len(result.runs)} runs. {band} {escape(RULE)}</p>",
        "<h2>Areas under the curves</h2>",
        _table(areas, {"success": "{:.3f}", "ape_m": "{:.3f}", "rpe_m": "{:.4f}"}),
    ]
    for axis, path in figures.items():
        data = base64.b64encode(path.read_bytes()).decode()
        parts.append(
            f'<section><h2>{escape(axis.name)}</h2>\n<img alt="" src="data:image/png;base64,{data}">'
        )
        here = curves[curves["axis"] == axis.name].drop(columns=["axis", "fail_share"])
        parts.append(_table(here, dict.fromkeys(here.columns[2:], "{:.4g}")) + "</section>")
    return "\n".join(parts) + "\n</html>\n"


def _table(table: pd.DataFrame, forms: dict[str, str]) -> str:
    def word(name: str, value: Any) -> str:
        text = "–" if pd.isna(value) else forms[name].format(value) if name in forms else f"{value}"
        return f"<td>{escape(text)}</td>"

    head = "".join(f"<th>{escape(str(name))}</th>" for name in table.columns)
    rows = (zip(table.columns, row, strict=True) for row in table.to_numpy().tolist())
    body = "".join(f"<tr>{''.join(word(str(n), v) for n, v in row)}</tr>\n" for row in rows)
    return f'<div class="scroll"><table>\n<tr>{head}</tr>\n{body}</table></div>'
