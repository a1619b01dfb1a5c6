"""Findings: ratios of the paper's own tables, what is said of ours, and the page they are put into."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from carlaloc_env.core.errors import EvaluationError
from recorder.benchmark.cells import Ratio, ratios
from recorder.benchmark.findings import (
    BEGIN,
    END,
    findings_rows,
    findings_text,
    read_results,
    verdict,
    write_findings,
)
from recorder.benchmark.paper import paper_table
from recorder.benchmark.score import Score
from recorder.benchmark.tables import csv_text, failure_rows


def score(town: str, traffic: str, ape_m: float, run: int = 1, cloud: str = "raw") -> Score:
    return Score(
        dataset=".", town=town, weather="ClearNoon", traffic=traffic, cloud=cloud, method="kiss_icp",
        title="KISS-ICP", run=run, version="1", failed=None, ape_m=ape_m,
    )  # fmt: skip


def four_towns(*, spread_m: float) -> list[Score]:
    """Dynamic is half as large again as static, each run twice."""
    levels = (("static", 1.0), ("dynamic", 1.5))
    return [
        score(f"Town0{town}", traffic, town * base + sign * spread_m * town, run)
        for town in (1, 2, 3, 4)
        for traffic, base in levels
        for run, sign in ((1, -1), (2, 1))
    ]


@pytest.mark.parametrize(
    ("method", "what", "median", "larger", "count"),
    [
        ("aloam", "dynamic / static", 1.58, 5, 7),
        ("lego_loam", "dynamic / static", 1.48, 7, 7),
        ("fast_lio2", "dynamic / static", 0.96, 3, 7),
        ("orb3_svo", "FoggyNoon / ClearNoon (static)", None, 0, 5),
    ],
)
def test_the_papers_tables_give_the_papers_findings(
    method: str, what: str, median: float | None, larger: int, count: int
) -> None:
    found = next(r for r in ratios(paper_table()) if (r.method, r.what) == (method, what))
    assert len(found.values) == count
    assert sum(value > 1 for value in found.values) == larger
    if median is not None:
        assert found.median == pytest.approx(median, abs=0.006)


def test_a_difference_beyond_the_spread_is_a_finding_and_one_within_it_none() -> None:
    clear = next(r for r in findings_rows(four_towns(spread_m=0.1)) if r[0] == "dynamic / static")[1]
    ours = next(row for row in clear if row[2] == "here")
    assert ours[:4] + ours[5:] == ["LiDAR", "KISS-ICP", "here", "×1.50", "4 of 4", "larger"]
    blurred = next(r for r in findings_rows(four_towns(spread_m=0.4)) if r[0] == "dynamic / static")[1]
    assert next(row for row in blurred if row[2] == "here")[-1].startswith("rests on less than the spread")


@pytest.mark.parametrize(
    ("values", "repeated", "told"),
    [
        ((1.2, 1.4), 2, "2 pairs: too few"),
        ((0.5, 0.9, 1.1, 1.2), 4, "no direction"),
        ((0.5, 0.7, 0.8), 3, "smaller"),
        ((1.5, 1.7, 1.8), 0, "larger; spread of runs not known"),
        ((1.5, 1.7, 1.8), 1, "larger; spread of runs known in 1 of 3 pairs alone"),
        ((1.5, 1.7, 1.8), 2, "larger"),
    ],
)
def test_what_is_said(values: tuple[float, ...], repeated: int, told: str) -> None:
    ratio = Ratio(method="m", what="w", values=values, repeated=repeated, within_range=0)
    assert verdict(ratio) == told


def test_figures_take_the_place_of_older_ones(tmp_path: Path) -> None:
    files = []
    for name, part in (("a", four_towns(spread_m=0.1)[:8]), ("b", four_towns(spread_m=0.1)[8:])):
        (tmp_path / name).mkdir()
        files.append(tmp_path / name / "results.csv")
        files[-1].write_text(csv_text(part))
    scores = read_results(files)
    assert scores == four_towns(spread_m=0.1) or len(scores) == 16  # NaN is unequal to itself
    page = tmp_path / "page.md"
    page.write_text(f"by hand\n{BEGIN}\nolder\n{END}\nby hand, too\n")
    write_findings(scores, page)
    once = page.read_text()
    write_findings(scores, page)
    assert page.read_text() == once
    assert once.startswith("by hand\n")
    assert once.endswith("\nby hand, too\n")
    assert "older" not in once
    assert "| LiDAR | KISS-ICP | here | ×1.50 | ×1.50–×1.50 | 4 of 4 | larger |" in once


def test_what_is_no_table_of_results_is_told(tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_text("a,b\n1,2\n")
    with pytest.raises(EvaluationError, match=r"give a results\.csv of benchmark"):
        read_results([tmp_path / "results.csv"])


def test_what_lacked_its_input_is_no_failure_and_no_path_is_told() -> None:
    good = score("Town01", "dynamic", 1.25, cloud="seg")
    lacking = replace(good, run=2, failed="/home/me/x.bag has clouds without labels; replay with --topics a")
    lost = replace(good, town="Town03", failed="crashed by SIGSEGV: /home/me/log.txt")
    text = findings_text([good, lacking, lost])
    assert "| Town01 | seg(d) | 1.25 |" in text
    assert "crashed by SIGSEGV: log.txt" in text
    assert "labels" not in text
    assert "/home" not in text


def test_failures_are_counted_by_condition_each_reason_told_once() -> None:
    good = score("Town01", "static", ape_m=1.0)
    lost, slow = replace(good, failed="lost"), replace(good, failed="too slow")
    rows = failure_rows([good, lost, lost, slow, replace(good, town="Town03")])
    assert rows[1:] == [["KISS-ICP", "Town01", "ClearNoon static", "3 of 4", "lost; too slow"]]
