"""Cells, the best of a row and ratios, by hand-made scores."""

import pytest
from shared_fixtures.readings.scores import score

from recorder.benchmark.cells import best, cells, ratios
from recorder.benchmark.tables import all_tables, cost_table, error_table, frame_of


def test_a_cell_is_the_median_with_its_range() -> None:
    cell = cells(frame_of([score("a", "static", v) for v in (3.0, 1.0, 2.0)]))
    assert cell["text"].tolist() == ["2.00 (1.00–3.00)"]


@pytest.mark.parametrize(
    ("failures", "text"), [(1, "2.00 (1.00–3.00), 1 of 3 fail"), (2, "fail"), (3, "fail")]
)
def test_half_of_the_runs_failed_is_fail(failures: int, text: str) -> None:
    good = [score("a", "static", v) for v in (1.0, 3.0)][: 3 - failures]
    bad = [score("a", "static", 99.0, "lost") for _ in range(failures)]
    assert cells(frame_of(good + bad))["text"].tolist() == [text]


def test_the_best_is_found_as_printed_and_is_never_a_failure() -> None:
    runs = [score("a", "static", 1.201), score("b", "static", 1.204), score("c", "static", 0.1, "lost")]
    cell = cells(frame_of(runs))
    assert set(cell["method"][best(cell)]) == {"a", "b"}


def test_ratios_pair_conditions_and_count_overlaps() -> None:
    runs = [score("a", "static", v) for v in (1.0, 2.0)] + [score("a", "dynamic", v) for v in (1.9, 4.1)]
    runs += [score("a", "dynamic", 1.0, cloud="seg"), score("a", "static", 3.0, weather="FoggyNoon")]
    found = ratios(cells(frame_of(runs))).set_index("what")
    assert found["median"].to_dict() == pytest.approx(
        {"dynamic / static": 2.0, "seg(d) / d": 1.0 / 3.0, "FoggyNoon / ClearNoon (static)": 2.0}
    )
    assert found.loc["dynamic / static", ["repeated", "within", "larger"]].tolist() == [1, 1, 1]
    assert found.loc["seg(d) / d", "repeated"] == 0


def test_an_overlap_with_a_single_run_is_not_counted() -> None:
    """One run has no range: the pair is not repeated, and says nothing of the spread."""
    runs = [score("a", "static", 1.5)] + [score("a", "dynamic", v) for v in (1.0, 2.0)]
    assert ratios(cells(frame_of(runs)))[["repeated", "within"]].to_numpy().tolist() == [[0, 0]]


def test_what_was_not_measured_is_a_dash_and_never_the_best() -> None:
    """Drift has no segment on a short way: that is neither a failure nor a figure."""
    nan = float("nan")
    runs = [score("a", "static", nan), score("b", "static", nan), score("a", "dynamic", nan)]
    runs += [score("b", "dynamic", 3.0), score("a", "empty", 4.0)]
    table = error_table(frame_of(runs), by_weather=False)
    rows = [["T", "e", "4.00", "–"], ["T", "s", "–", "–"], ["T", "d", "–", "**3.00**"]]
    assert table.to_numpy().tolist() == rows
    assert ratios(cells(frame_of(runs[:-1]))).empty


def test_columns_without_any_figure_are_left_out() -> None:
    """The other system keeps its figures, and is no best of one; costs and drift have none."""
    nan = float("nan")
    runs = [score("a", "static", nan), score("b", "static", 2.0), score("a", "dynamic", nan)]
    table = error_table(frame_of(runs), by_weather=False)
    assert table.columns.tolist() == ["town", "traffic", "b"]
    assert table.to_numpy().tolist() == [["T", "s", "2.00"]]
    tables = dict(all_tables(frame_of(runs)))
    assert not [title for title in tables if "drift" in title]
    assert tables["Cost"].columns.tolist() == ["system", "version", "runs", "failed"]
    assert not [word for table in tables.values() for word in table if not "".join(table[word]).strip("–")]


def test_costs_are_medians_of_runs_that_were_measured() -> None:
    known = [score("a", "static", 1.0, cores=2, cpu_s=cpu_s, peak_memory_mb=200.0) for cpu_s in (30.0, 40.0)]
    cost = cost_table(frame_of([*known, score("a", "static", 1.0), score("b", "static", 1.0)]))
    columns = ["CPU-s", "peak MB", "cores", "runs", "failed"]
    assert cost[columns].to_numpy().tolist() == [["35.0", "200", "2", "3", "0"], ["", "", "", "1", "0"]]
