"""Drifts and rankings beside the road's: tau by hand, what of a benchmark is read, and the kept page."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from shared_fixtures.processes.checkout import script

road = script("docs/findings/road/road.py")


@pytest.mark.parametrize(
    ("other", "tau", "p"),
    [
        ((1, 2, 3, 4), 1.0, 2 / 24),
        # One of six pairs is turned: (5 - 1) / 6. One inversion at most, or five at least: 2 (1 + 3) of 24.
        ((2, 1, 3, 4), 2 / 3, 8 / 24),
        ((4, 3, 2, 1), -1.0, 2 / 24),
        # A pair is equal: 5 / sqrt(6 · 5).
        ((1.5, 1.5, 3, 4), 5 / math.sqrt(30), 4 / 24),
    ],
)
def test_tau_and_its_exact_p_by_hand(other: tuple[float, ...], tau: float, p: float) -> None:
    assert road.tau_b((1, 2, 3, 4), other) == pytest.approx(tau)
    assert road.permuted((1, 2, 3, 4), other) == pytest.approx(p)


def test_an_interval_is_as_wide_as_sequences_and_towns_disagree() -> None:
    alike = np.array([[1.0, 2.0, 3.0], [2.0, 3.0, 4.0], [3.0, 4.0, np.inf]])
    assert set(road.drawn_taus(alike, alike)) == {1.0}
    assert set(road.drawn_taus(alike, alike[::-1])) == {-1.0}
    # Two towns of opposite orders: a quarter of the draws has the first alone, a quarter the second.
    split = np.array([[1.0, 3.0], [2.0, 2.0], [3.0, 1.0]])
    drawn = road.drawn_taus(alike, split)
    assert [np.mean(drawn == tau) for tau in (1.0, -1.0)] == pytest.approx([0.25, 0.25], abs=0.04)


def results(folder: Path) -> Path:
    """Runs of three systems over two towns; the last lines are of no use here."""
    rows = [
        ("Town01", "dynamic", "raw", "kiss_icp", "", 1.0, 2.0),
        ("Town01", "dynamic", "raw", "kiss_icp", "", 3.0, 4.0),
        ("Town05", "dynamic", "raw", "kiss_icp", "diverged", 0.1, 0.1),
        ("Town01", "dynamic", "raw", "loam", "", 0.5, 9.0),
        ("Town01", "dynamic", "raw", "lego_loam", "", 9.0, 140.0),
        ("Town01", "static", "raw", "kiss_icp", "", 90.0, 90.0),
        ("Town01", "dynamic", "seg", "kiss_icp", "", 90.0, 90.0),
        ("Town05", "dynamic", "raw", "loam", "no bag; replay with --formats rosbag1", math.nan, math.nan),
    ]
    columns = ["town", "traffic", "cloud", "method", "failed", "ape_m", "kitti_percent"]
    runs = pd.DataFrame(rows, columns=columns).assign(weather="ClearNoon", length_m=200.0, run=1)
    runs["title"] = runs["method"].str.upper()
    folder.mkdir()
    runs.to_csv(folder / "results.csv", index=False)
    return folder


def published(metric: str) -> pd.DataFrame:
    errors = {"kiss_icp": 1.0, "loam": 2.0, "lego_loam": 3.0}
    rows = [("A", "B 2020", "01", name, metric, value, "%") for name, value in errors.items()]
    columns = ["dataset", "study", "sequence", "ours", "metric", "value", "unit"]
    return pd.DataFrame(rows, columns=columns).assign(length_m=math.nan)


def test_errors_are_of_drives_among_movers_and_a_failed_run_is_infinitely_wrong(tmp_path: Path) -> None:
    found = road.our_errors("paper", [results(tmp_path / "a")]).set_index(["method", "town"])
    assert found["runs"].to_dict() == {
        ("kiss_icp", "Town01"): 2, ("kiss_icp", "Town05"): 1,
        ("lego_loam", "Town01"): 1, ("loam", "Town01"): 1,
    }  # fmt: skip
    assert found.loc[("kiss_icp", "Town01"), ["kitti_percent", "ape_percent"]].tolist() == [3.0, 1.0]
    assert found.loc[("kiss_icp", "Town05"), ["kitti_percent", "ape_percent"]].tolist() == [math.inf] * 2


def test_drifts_are_compared_in_one_metric_and_rankings_in_towns_that_all_have(tmp_path: Path) -> None:
    ours = road.our_errors("paper", [results(tmp_path / "a")])
    drifts = road.drift_table(published("kitti_percent"), ours)
    assert drifts.to_numpy().tolist() == [
        ["KISS_ICP", "relative", "A 1.00", "fails (3.00–fails)"],
        ["LOAM", "relative", "A 2.00", "9.00; ×4.5 worse"],
    ], "LeGO-LOAM has no attitude, so no relative drift"
    (row,) = road.tau_table(published("kitti_percent"), ours).to_numpy().tolist()
    # By APE: LOAM 0.25 %, KISS-ICP 1 %, LeGO-LOAM 4.5 %. One pair of three is turned: the least τ.
    assert row == [
        "`paper`", "A (B 2020)", "KISS_ICP < LOAM < LEGO_LOAM", "LOAM < KISS_ICP < LEGO_LOAM", "1, 1",
        "0.33", "0.33 to 0.33", "1.00",
    ]  # fmt: skip
    assert road.tau_table(published("ape_m")[:2], ours).empty, "two systems make no ranking"


def test_each_published_number_has_its_source() -> None:
    table = pd.read_csv(road.HERE / "published.csv")
    assert table["source"].str.startswith("https://").all()
    assert table.notna()[["dataset", "study", "system", "ours", "metric", "value", "unit"]].all(axis=None)
    assert set(table["metric"]) == set(road.OURS_OF)


def test_the_page_holds_what_the_kept_files_give() -> None:
    drifts, rankings = road.tables()
    assert f"{road.BEGIN}\n\n{drifts}\n{road.END}" in road.PAGE.read_text(encoding="utf-8")
    assert road.RANKINGS.read_text(encoding="utf-8") == rankings
