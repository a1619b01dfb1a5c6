"""Tables of scores in the paper's layout: Markdown, LaTeX, CSV and Parquet."""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from carlaloc_env.core.errors import EvaluationError
from recorder.benchmark.cells import Cell, Table, best, cells, ratios
from recorder.benchmark.score import Score

Rows = list[list[str]]
"""A heading and lines of words."""

RULE = (
    "A run fails when it ends with an error or passes its time limit, when it has poses for less than 80 % "
    "of the frames, or when its APE is more than half of that of an estimate that never moves. A cell fails "
    "when half of its runs do."
)


def write_tables(scores: Sequence[Score], out: Path) -> list[Path]:
    """Write ``results.csv``, ``tables.md``, ``tables.tex``; with pyarrow ``results.parquet``, too.

    Raises:
        EvaluationError: a file cannot be written.
    """
    written = []
    texts = {"results.csv": csv_text(scores), "tables.md": markdown(scores), "tables.tex": latex(scores)}
    try:
        for name, text in texts.items():
            (out / name).write_text(text, encoding="utf-8")
            written.append(out / name)
    except OSError as error:
        raise EvaluationError(f"cannot write into {out}: {error.strerror}; choose another folder") from error
    return written + _parquet(scores, out / "results.parquet")


def csv_text(scores: Sequence[Score]) -> str:
    """A line for each run with all of its figures."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, list(scores[0].to_mapping()), lineterminator="\n")
    writer.writeheader()
    writer.writerows(score.to_mapping() for score in scores)
    return buffer.getvalue()


def markdown(scores: Sequence[Score]) -> str:
    """All tables as Markdown."""
    parts = ["# Benchmark", "", RULE, ""]
    for title, rows in all_tables(scores):
        parts += [f"## {title}", "", markdown_table(rows), ""]
    return "\n".join(parts)


def latex(scores: Sequence[Score]) -> str:
    """All tables as LaTeX with booktabs."""
    parts = ["% \\usepackage{booktabs}", f"% {RULE}"]
    for title, rows in all_tables(scores):
        body = [" & ".join(_tex(word) for word in row) + r" \\" for row in rows]
        parts += [
            r"\begin{table}",
            f"\\caption{{{_tex(title)}}}",
            r"\begin{tabular}{" + "l" * len(rows[0]) + "}",
            r"\toprule",
            body[0],
            r"\midrule",
            *body[1:],
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    return "\n".join(parts)


def all_tables(scores: Sequence[Score]) -> list[tuple[str, Rows]]:
    """Titles and rows: errors of visual and LiDAR systems as in Tables II and IV, ratios, and costs."""
    titles = {score.method: score.title for score in scores}
    visual = [score for score in scores if score.visual]
    lidar = [score for score in scores if not score.visual]
    found: list[tuple[str, Rows]] = []
    for name, part, by_weather in (("Visual", visual, True), ("LiDAR", lidar, False)):
        if not part:
            continue
        found.append(
            (f"{name} systems: APE [m], RMSE", error_rows(cells(part), titles, by_weather=by_weather))
        )
        rpe = cells(part, lambda score: score.rpe_paper_m)
        found.append(
            (f"{name} systems: RPE as in the paper [m], RMSE", error_rows(rpe, titles, by_weather=by_weather))
        )
        turned = cells(part, lambda score: score.attitude_deg)
        found.append(
            (f"{name} systems: attitude [deg], RMSE", error_rows(turned, titles, by_weather=by_weather))
        )
        drift = cells(part, lambda score: score.kitti_percent)
        rows = error_rows(drift, titles, by_weather=by_weather)
        found.append((f"{name} systems: drift over KITTI's segments [%]", rows))
    found.append(("Ratios of APE", ratio_rows(cells(scores), titles)))
    found.append(("Cost", cost_rows(scores)))
    found.append(("Why runs failed", failure_rows(scores)))
    return [(title, rows) for title, rows in found if len(rows) > 1]


def error_rows(table: Table, titles: dict[str, str], *, by_weather: bool) -> Rows:
    """A row for each town, weather and traffic level, a column for each system, the best in bold.

    Args:
        table: Cells.
        titles: Titles of methods.
        by_weather: Whether the weather is a column.
    """
    methods = [method for method in titles if any(method in row for row in table.values())]
    weathers = {condition.weather for condition in table}
    shown = by_weather or len(weathers) > 1
    rows = [["town", *(["weather"] if shown else []), "traffic", *(titles[m] for m in methods)]]
    for condition, row in table.items():
        winners = best(row)
        words = [_cell(row.get(m), bold=m in winners) for m in methods]
        weather = [condition.weather] if shown else []
        rows.append([condition.town, *weather, condition.traffic_label, *words])
    return rows


def ratio_rows(table: Table, titles: dict[str, str]) -> Rows:
    """Ratios with their median, range, and pairs of which nothing can be said."""
    rows = [["system", "compared", "median", "range", "pairs", "larger", "within the spread of runs"]]
    for ratio in ratios(table):
        rows.append(
            [
                titles[ratio.method],
                ratio.what,
                f"×{ratio.median:.2f}",
                f"×{ratio.values[0]:.2f}–×{ratio.values[-1]:.2f}",
                str(len(ratio.values)),
                f"{sum(value > 1 for value in ratio.values)} of {len(ratio.values)}",
                f"{ratio.within_range} of {ratio.repeated}" if ratio.repeated else "one run: not known",
            ]
        )
    return rows


def cost_rows(scores: Sequence[Score]) -> Rows:
    """Time, processor time and memory of each system, medians over the runs that ended and were measured."""
    rows = [
        [
            "system",
            "version",
            "ms a frame",
            "99 %",
            "of real time",
            "CPU-s",
            "peak MB",
            "cores",
            "runs",
            "failed",
        ]
    ]
    for method in dict.fromkeys(score.method for score in scores):
        runs = [score for score in scores if score.method == method]
        ended = [score for score in runs if score.version and score.cores]
        failed = str(sum(score.failed is not None for score in runs))
        if not ended:
            rows.append([runs[0].title, runs[0].version, *[""] * 6, str(len(runs)), failed])
            continue
        rows.append(
            [
                runs[0].title,
                ended[0].version,
                f"{1e3 * _median([s.frame_median_s for s in ended]):.1f}",
                f"{1e3 * _median([s.frame_p99_s for s in ended]):.1f}",
                f"×{_median([s.real_time for s in ended]):.2f}",
                f"{_median([s.cpu_s for s in ended]):.1f}",
                f"{_median([s.peak_memory_mb for s in ended]):.0f}",
                str(ended[0].cores),
                str(len(runs)),
                failed,
            ]
        )
    return rows


def failure_rows(scores: Sequence[Score]) -> Rows:
    """A row for each system and condition of which runs failed: how many, and why."""
    runs: dict[tuple[str, str, str], list[str | None]] = defaultdict(list)
    for s in scores:
        condition = f"{s.weather} {s.traffic}" + ("" if s.cloud == "raw" else f" {s.cloud}")
        runs[s.title, s.town, condition].append(s.failed)
    rows = [["system", "town", "condition", "failed", "reason"]]
    for names, reasons in runs.items():
        failed = [reason for reason in reasons if reason is not None]
        if failed:
            rows.append([*names, f"{len(failed)} of {len(reasons)}", "; ".join(dict.fromkeys(failed))])
    return rows


def _median(values: Sequence[float]) -> float:
    finite = sorted(value for value in values if value == value)
    return finite[len(finite) // 2] if finite else float("nan")


def _cell(cell: Cell | None, *, bold: bool) -> str:
    if cell is None:
        return "–"
    return f"**{cell.text}**" if bold else cell.text


def markdown_table(rows: Rows) -> str:
    """Rows as a table of Markdown, the first one as its head."""
    clean = [[word.replace("|", "\\|") for word in row] for row in rows]
    lines = [f"| {' | '.join(row)} |" for row in clean]
    return "\n".join([lines[0], f"|{' --- |' * len(rows[0])}", *lines[1:]])


def _tex(word: str) -> str:
    for sign in "\\&%$#_{}":
        word = word.replace(sign, "\\textbackslash{}" if sign == "\\" else f"\\{sign}")
    if word.startswith("**"):
        return f"\\textbf{{{word.strip('*')}}}"
    return word.replace("×", "$\\times$").replace("–", "--")


def _parquet(scores: Sequence[Score], path: Path) -> list[Path]:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return []
    parquet.write_table(pyarrow.Table.from_pylist([score.to_mapping() for score in scores]), path)
    return [path]
