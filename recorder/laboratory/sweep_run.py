"""Runs a sweep as one benchmark, so that it shares rays, resumes, and takes workers and clusters.

Files of a sweep: runs, curves and areas as CSV, a figure for each axis, and one page.

Curves of a sweep: means with bands, shares of failures with bands, and the areas under them.
"""

import base64
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write
from recorder.benchmark.page import page_head
from recorder.benchmark.results import BenchmarkConfig, Score, read_shared
from recorder.benchmark.run import BenchmarkResult, Progress, run_benchmark
from recorder.benchmark.tables import RULE
from recorder.evaluation.confidence import CONFIDENCE, mean_interval, wilson
from recorder.laboratory.sweep import Axis, Point, SweepConfig, points_of, sequences_of_points
from recorder.report.trajectory_plot import COLOURS, new_figure


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepResult:
    """All runs of a sweep."""

    config: SweepConfig
    """Its configuration."""
    runs: pd.DataFrame
    """A row for each point and system: swept quantities, ``drive``, ``seed``, figures of the score."""
    benchmark: BenchmarkResult
    """The runs themselves; several points may share one."""
    instants: int
    """Instants whose rays were cast or pictures drawn by this call."""
    frames: int
    """Sweeps and pairs that were made of them."""


def run_sweep(
    config: SweepConfig,
    benchmark: BenchmarkConfig,
    progress: Progress = lambda *_: None,
    report: Callable[[str], None] = lambda _: None,
) -> SweepResult:
    """Run systems at every point of every axis.

    Args:
        config: Quantities and drives.
        benchmark: Systems, workers, clouds and the rule of failure; its data are those of the sweep.
        progress: Called with the progress of the runs.
        report: Called with a line about every drive that is simulated anew.

    Raises:
        CarlaLocError: a drive cannot be read, an option does not fit it, or a system is missing.
    """
    points = points_of(config)
    sequences = sequences_of_points(config, points, report)
    before = len(read_shared(config.out))
    unique = list({sequence.path: sequence for sequence in sequences}.values())
    result = run_benchmark(benchmark, progress, sequences=unique)
    passes = read_shared(config.out)[before:]
    # Systems run once where sweeps are the same in all weathers.
    scores = {
        key: (job, score)
        for job, score in zip(result.jobs, result.scores, strict=True)
        for key in ((job.sequence.path, job.title, job.run), (*_alike(job.sequence), job.title, job.run))
    }
    titles = dict.fromkeys((job.title, job.run) for job in result.jobs)
    rows = []
    for point, sequence in zip(points, sequences, strict=True):
        for title, run in titles:
            found = scores.get((sequence.path, title, run)) or scores.get((*_alike(sequence), title, run))
            if found is not None:
                rows.append(row_of(point, found[1], title))
    return SweepResult(
        config=config,
        runs=pd.DataFrame(rows),
        benchmark=result,
        instants=sum(made["instants"] for made in passes),
        frames=sum(made["frames"] for made in passes),
    )


def _alike(sequence: object) -> tuple[object, ...]:
    return tuple(getattr(sequence, name) for name in ("dataset", "town", "traffic", "faults"))


def row_of(point: Point, score: Score, title: str) -> dict[str, object]:
    """A row of `SweepResult.runs`."""
    figures = asdict(score)
    # The quantity swept may be called as the level is.
    level = {"traffic_level": figures.pop("traffic"), "title": title}
    return {**figures, **level, **dict(point.values), "drive": point.drive.stem, "seed": point.number}


FIGURES = ("ape_m", "rpe_m", "coverage")
"""Figures of a run that have a curve."""


def curves_of(runs: pd.DataFrame, axes: Sequence[Axis]) -> pd.DataFrame:
    """A row for each axis, series and value.

    Args:
        runs: Of `recorder.laboratory.sweep_run.SweepResult`.
        axes: Swept quantities.

    Returns:
        ``axis``, ``series`` (the system, with the values of other axes where all combinations were run),
        ``value``, ``runs``, ``failed``, ``fail_share`` with ``_low`` and ``_high``. Mean of each of `FIGURES`
        over the runs that did not fail, of the coverage over all, with ``_low`` and ``_high``.
    """
    rows: list[dict[str, Any]] = []
    for axis in axes:
        others = [other.name for other in axes if other.name != axis.name]
        here = runs[runs[axis.name].notna()]
        # The order of titles is that of the benchmark.
        for key, group in here.groupby(["title", *others, axis.name], sort=False, dropna=False):
            words = [f"{n}={v:g}" for n, v in zip(others, key[1:-1], strict=True) if not math.isnan(v)]
            good, count = group[group["failed"].isna()], len(group)
            failed = count - len(good)
            share = wilson(failed / count, count)
            row: dict[str, Any] = {
                "axis": axis.name, "series": " ".join([key[0], *words]), "value": key[-1],
                "runs": count, "failed": failed,
                "fail_share": share.value, "fail_share_low": share.low, "fail_share_high": share.high,
            }  # fmt: skip
            for name in FIGURES:
                some = np.asarray((group if name == "coverage" else good)[name], np.float64)
                mean = mean_interval(some[np.isfinite(some)])
                row |= {name: mean.value, f"{name}_low": mean.low, f"{name}_high": mean.high}
            rows.append(row)
    return pd.DataFrame(rows)


def areas_of(curves: pd.DataFrame, axes: Sequence[Axis]) -> pd.DataFrame:
    """Scores of each series over each axis: areas under its curves by the length of the axis.

    ``success`` is that under the share of runs that do not fail, 0–1; ``ape_m`` and ``rpe_m`` are those under
    the mean errors, over the values where some run did not fail. Logarithmic axes are measured by their
    logarithm.
    """
    rows = []
    for axis in axes:
        here = curves[curves["axis"] == axis.name]
        for series, curve in here.groupby("series", sort=False):
            x = np.asarray(curve["value"], np.float64)
            x = np.log(x) if axis.is_log else x
            area = {"success": _area(x, 1.0 - np.asarray(curve["fail_share"], np.float64))}
            area |= {name: _area(x, np.asarray(curve[name], np.float64)) for name in FIGURES[:2]}
            rows.append({"axis": axis.name, "series": series, **area})
    return pd.DataFrame(rows)


def _area(x: np.ndarray, y: np.ndarray) -> float:
    """Mean of a curve of straight lines over its abscissae."""
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 2:
        return float(y[0]) if len(x) else math.nan
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)) / (x[-1] - x[0]))


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
        with atomic_write(out / name, EvaluationError) as part:
            part.write_text(table.to_csv(index=False, na_rep="nan"), encoding="utf-8")
    figures = {axis: out / f"{axis.name}.png" for axis in axes}
    for axis, path in figures.items():
        draw_axis(curves[curves["axis"] == axis.name], axis, path)
    with atomic_write(out / "sweep.html", EvaluationError) as part:
        part.write_text(_page(result, curves, areas, figures), encoding="utf-8")
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
