"""Cells, the best of a row and ratios, by hand-made scores."""

from __future__ import annotations

from typing import Any

import pytest

from recorder.benchmark.cells import best, cells, ratios
from recorder.benchmark.score import Score
from recorder.benchmark.tables import cost_rows, error_rows


def score(method: str, traffic: str, ape_m: float, failed: str | None = None, **others: Any) -> Score:
    fixed = {"dataset": ".", "town": "T", "weather": "ClearNoon", "cloud": "raw", "run": 1, "version": "1"}
    known = fixed | others
    return Score(**known, traffic=traffic, method=method, title=method, failed=failed, ape_m=ape_m)


def test_a_cell_is_the_median_with_its_range() -> None:
    table = cells([score("a", "static", v) for v in (3.0, 1.0, 2.0)])
    (row,) = table.values()
    assert row["a"].text == "2.00 (1.00–3.00)"


@pytest.mark.parametrize(
    ("failures", "text"), [(1, "2.00 (1.00–3.00), 1 of 3 fail"), (2, "fail"), (3, "fail")]
)
def test_half_of_the_runs_failed_is_fail(failures: int, text: str) -> None:
    good = [score("a", "static", v) for v in (1.0, 3.0)][: 3 - failures]
    bad = [score("a", "static", 99.0, "lost") for _ in range(failures)]
    (row,) = cells(good + bad).values()
    assert row["a"].text == text


def test_the_best_is_told_as_printed_and_never_a_failure() -> None:
    runs = [score("a", "static", 1.201), score("b", "static", 1.204), score("c", "static", 0.1, "lost")]
    (row,) = cells(runs).values()
    assert best(row) == {"a", "b"}


def test_ratios_pair_conditions_and_count_overlaps() -> None:
    runs = [score("a", "static", v) for v in (1.0, 2.0)] + [score("a", "dynamic", v) for v in (1.9, 4.1)]
    runs += [score("a", "dynamic", 1.0, cloud="seg"), score("a", "static", 3.0, weather="FoggyNoon")]
    found = {ratio.what: ratio for ratio in ratios(cells(runs))}
    assert found["dynamic / static"].median == pytest.approx(3.0 / 1.5)
    assert (found["dynamic / static"].repeated, found["dynamic / static"].within_range) == (1, 1)
    assert found["seg(d) / d"].repeated == 0
    assert found["seg(d) / d"].median == pytest.approx(1.0 / 3.0)
    assert found["FoggyNoon / ClearNoon (static)"].median == pytest.approx(2.0)


def test_an_overlap_with_a_single_run_is_not_counted() -> None:
    """One run has no range: the pair is not repeated, and tells nothing of the spread."""
    runs = [score("a", "static", 1.5)] + [score("a", "dynamic", v) for v in (1.0, 2.0)]
    (ratio,) = ratios(cells(runs))
    assert (ratio.repeated, ratio.within_range) == (0, 0)


def test_what_was_not_measured_is_a_dash_and_never_the_best() -> None:
    """Drift has no segment on a short way: that is neither a failure nor a figure."""
    nan = float("nan")
    runs = [score("a", "static", nan), score("b", "static", nan), score("a", "dynamic", nan)]
    runs += [score("b", "dynamic", 3.0)]
    table = cells(runs)
    rows = error_rows(table, {"a": "A", "b": "B"}, by_weather=False)
    assert rows[1:] == [["T", "s", "–", "–"], ["T", "d", "–", "**3.00**"]]
    assert not [ratio for ratio in ratios(table) if ratio.what == "dynamic / static"]


def test_costs_are_told_of_runs_that_were_measured() -> None:
    known = score("a", "static", 1.0, cores=2, cpu_s=30.0, peak_memory_mb=200.0)
    heads, a, b = cost_rows([known, score("a", "static", 1.0), score("b", "static", 1.0)])
    told = dict(zip(heads, a, strict=True))
    assert (told["CPU-s"], told["peak MB"], told["cores"], told["runs"]) == ("30.0", "200", "2", "2")
    untold = dict(zip(heads, b, strict=True))
    assert (untold["CPU-s"], untold["cores"], untold["runs"], untold["failed"]) == ("", "", "1", "0")
