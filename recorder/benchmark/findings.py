"""Findings: how conditions compare, for the paper's systems by its own tables and for those of a benchmark.

A finding is the ratio of two conditions' errors, medians over runs, in every pair of a town. Nothing is
claimed that less than two thirds of the pairs show, that rests on less than the spread of runs, or whose
spread is known in less than two thirds of the pairs.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import EvaluationError
from recorder.benchmark.cells import Ratio, Table, cells, ratios
from recorder.benchmark.paper import KINDS, TITLES, paper_table
from recorder.benchmark.score import Score
from recorder.benchmark.tables import Rows, cost_rows, error_rows, failure_rows, markdown_table
from recorder.slam.systems import SYSTEMS

BEGIN, END = "<!-- figures: made by benchmarks/findings.py -->", "<!-- end of figures -->"
"""What stands between these lines of the page is written by `write_findings`, the rest by people."""
_PAIRS_MIN, _SHARE = 3, 2 / 3
_PATH = re.compile(r"(?:/[\w.+-]+)+/([\w.+-]+)")


def read_results(files: Sequence[Path]) -> list[Score]:
    """Runs of one or several benchmarks, from their ``results.csv``.

    Raises:
        EvaluationError: a file cannot be read, or is none.
    """
    scores: list[Score] = []
    for file in files:
        try:
            with file.open(encoding="utf-8", newline="") as text:
                scores += [_score(row) for row in csv.DictReader(text)]
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise EvaluationError(f"cannot read {file} ({error}); give a results.csv of benchmark") from error
    if not scores:
        raise EvaluationError("no runs; give folders that benchmark wrote")
    return scores


def _score(row: dict[str, str]) -> Score:
    kinds: dict[str, Any] = {
        "int": int,
        "float": float,
        "bool": "True".__eq__,
        "str | None": lambda s: s or None,
    }
    types = {field.name: kinds.get(str(field.type), str) for field in fields(Score)}
    values = {name: types[name](word) for name, word in row.items() if name in types}
    values.setdefault("visual", row["method"] in SYSTEMS and SYSTEMS[row["method"]].is_visual)
    return Score(**values)


def verdict(ratio: Ratio) -> str:
    """What can be said of a ratio, in words."""
    count = len(ratio.values)
    larger = sum(value > 1 for value in ratio.values)
    smaller = sum(value < 1 for value in ratio.values)
    if count < _PAIRS_MIN:
        return f"{count} pair{'s' * (count > 1)}: too few"
    if max(larger, smaller) < _SHARE * count:
        return "no direction"
    direction = "larger" if larger > smaller else "smaller"
    if not ratio.repeated:
        return f"{direction}; spread of runs not known"
    if ratio.repeated < _SHARE * count:
        return f"{direction}; spread of runs known in {ratio.repeated} of {count} pairs alone"
    if ratio.within_range > (1 - _SHARE) * ratio.repeated:
        return f"rests on less than the spread of runs ({ratio.within_range} of {ratio.repeated})"
    return direction


def findings_rows(scores: Sequence[Score]) -> list[tuple[str, Rows]]:
    """A table for each comparison: the paper's systems first, then ours, of the same kind together."""
    ours = {score.method: score.title for score in scores}
    kinds = {method: _kind(method) for method in ours}
    entries = [("paper", TITLES[r.method], KINDS[r.method], r) for r in ratios(paper_table())]
    entries += [("here", ours[r.method], kinds[r.method], r) for r in ratios(cells(scores))]
    shown = {ratio.what for source, _, _, ratio in entries if source == "here"}
    tables = []
    for what in sorted(shown, key=_order):
        rows = [["kind", "system", "from", "median", "range", "larger", "what it says"]]
        found = [entry for entry in entries if entry[3].what == what]
        for source, title, kind, ratio in sorted(found, key=lambda e: (e[2], e[0] == "here", e[1])):
            rows.append(
                [
                    kind,
                    title,
                    source,
                    f"×{ratio.median:.2f}",
                    f"×{ratio.values[0]:.2f}–×{ratio.values[-1]:.2f}",
                    f"{sum(value > 1 for value in ratio.values)} of {len(ratio.values)}",
                    verdict(ratio),
                ]
            )
        tables.append((what, rows))
    return tables


def _kind(method: str) -> str:
    """What a system reads, as `KINDS` has it."""
    if method not in SYSTEMS:
        return "own"
    system = SYSTEMS[method]
    # evalio wants the IMU of all of its pipelines, also of those that make no use of it.
    return ("stereo" if system.is_visual else "LiDAR") + ("-inertial" if "inertial" in system.what else "")


def _order(what: str) -> tuple[int, str]:
    return (0 if what.startswith("dynamic") else 1 if what.startswith("seg") else 2), what


def fed(scores: Sequence[Score]) -> list[Score]:
    """Runs whose system had what it needs: to lack labels or a bag is no failure of a system."""
    return [score for score in scores if "; replay " not in (score.failed or "")]


def findings_text(scores: Sequence[Score]) -> str:
    """All figures as Markdown, without paths of the machine that found them."""
    scores = [replace(s, failed=s.failed and _PATH.sub(r"\1", s.failed)) for s in fed(scores)]
    parts: list[str] = []
    for what, rows in findings_rows(scores):
        parts += [f"### APE {what}", "", markdown_table(rows), ""]
    for name, visual in (("visual", True), ("LiDAR", False)):
        part = [score for score in scores if score.visual == visual]
        paper: Table = {
            condition: {m: cell for m, cell in row.items() if _is_visual(m) == visual}
            for condition, row in paper_table().items()
        }
        paper = {condition: row for condition, row in paper.items() if row}
        if part:
            titles = {score.method: score.title for score in part}
            ours = error_rows(cells(part), titles, by_weather=visual)
            theirs = error_rows(
                paper, {m: TITLES[m] for m in TITLES if _is_visual(m) == visual}, by_weather=visual
            )
            parts += [f"### APE of {name} systems [m], RMSE", "", markdown_table(ours), ""]
            parts += ["The paper's:", "", markdown_table(theirs), ""]
    for title, rows in (("What the runs cost", cost_rows(scores)), ("Why runs failed", failure_rows(scores))):
        if len(rows) > 1:
            parts += [f"### {title}", "", markdown_table(rows), ""]
    return "\n".join(parts)


def _is_visual(method: str) -> bool:
    return KINDS[method].startswith("stereo")


def write_findings(scores: Sequence[Score], page: Path) -> None:
    """Put the figures into a page, in the place of older ones.

    Raises:
        EvaluationError: the page has no place for them, or cannot be written.
    """
    try:
        text = page.read_text(encoding="utf-8")
        before, rest = text.split(BEGIN)
        after = rest.split(END)[1]
        page.write_text(f"{before}{BEGIN}\n\n{findings_text(scores)}\n{END}{after}", encoding="utf-8")
    except (OSError, ValueError, IndexError) as error:
        raise EvaluationError(f"{page} cannot be written or lacks the line {BEGIN} or {END}") from error
