"""Findings: ratios of the paper's own tables, what is said of ours, and the page they are put into."""

import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from shared_fixtures.processes.checkout import ROOT, script

from carlaloc_env.core.errors import EvaluationError
from recorder import Trajectory
from recorder.benchmark.cells import cells, ratios
from recorder.benchmark.score import Score
from recorder.benchmark.tables import csv_text, failure_table, frame_of

FOLDER = str(ROOT / "docs" / "findings")
sys.path.insert(0, FOLDER)
findings = script("docs/findings/findings.py")
sys.path.remove(FOLDER)
paper = sys.modules["paper_findings"]


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
        ("orb3_svo", "FoggyNoon / ClearNoon (static)", 0.10, 0, 5),
    ],
)
def test_the_papers_tables_give_the_papers_findings(
    method: str, what: str, median: float, larger: int, count: int
) -> None:
    found = ratios(cells(findings.paper_runs())).set_index(["method", "what"]).loc[(method, what)]
    assert found[["pairs", "larger"]].tolist() == [count, larger]
    assert found["median"] == pytest.approx(median, abs=0.006)


def test_the_findings_that_are_asked_for_are_those_of_the_papers_tables() -> None:
    found = ratios(cells(findings.paper_runs())).set_index(["method", "what"])
    methods = {
        "LiDAR": "aloam",
        "LiDAR-inertial": "fast_lio2",
        "stereo": "orb3_svo",
        "stereo-inertial": "orb3_svio",
    }
    for finding in paper.FINDINGS:
        row = found.loc[(methods[finding.kind], finding.what)]
        assert (round(float(row["median"]), 2), paper.direction(row)) == (
            finding.median,
            finding.direction,
        ), finding


@pytest.mark.parametrize(
    ("true", "larger", "smaller", "within", "said"),
    [
        (paper.LARGER, 4, 0, 0, "reproduced"),
        (paper.LARGER, 4, 0, 3, "partly"),
        (paper.LARGER, 0, 4, 0, "not"),
        (paper.LARGER, 2, 2, 0, "not"),
        (paper.LARGER, 2, 0, 0, "untested"),
        (paper.NONE, 2, 2, 0, "reproduced"),
        (paper.NONE, 0, 4, 0, "reproduced"),
        (paper.NONE, 4, 0, 3, "partly"),
        (paper.NONE, 4, 0, 0, "not"),
    ],
)
def test_verdicts(true: str, larger: int, smaller: int, within: int, said: str) -> None:
    finding = paper.Finding("a", "LiDAR", "b", 2.0, true)
    pairs = larger + smaller
    ratio = SimpleNamespace(pairs=pairs, larger=larger, smaller=smaller, repeated=pairs, within=within)
    assert paper.answer(finding, ratio) == said


def our_row(scores: Sequence[Score]) -> list[str]:
    table = dict(findings.findings_tables(frame_of(scores)))["dynamic / static"]
    return table[table["from"] == "here"].to_numpy().tolist()[0]


def test_a_difference_beyond_the_spread_is_a_finding_and_one_within_it_none() -> None:
    clear = our_row(four_towns(spread_m=0.1))
    assert clear[:4] + clear[5:] == ["LiDAR", "KISS-ICP", "here", "×1.50", "4 of 4", "larger"]
    assert our_row(four_towns(spread_m=0.4))[-1].startswith("rests on less than the spread")


@pytest.mark.parametrize(
    ("larger", "smaller", "repeated", "said"),
    [
        (2, 0, 2, "2 pairs: too few"),
        (2, 2, 4, "no direction"),
        (0, 3, 3, "smaller"),
        (3, 0, 0, "larger; seldom repeated"),
        (3, 0, 1, "larger; spread of runs known in 1 of 3 pairs alone"),
        (3, 0, 2, "larger"),
    ],
)
def test_what_is_said(larger: int, smaller: int, repeated: int, said: str) -> None:
    ratio = SimpleNamespace(
        pairs=larger + smaller, larger=larger, smaller=smaller, repeated=repeated, within=0
    )
    assert findings.verdict(ratio) == said


def test_figures_take_the_place_of_older_ones(tmp_path: Path) -> None:
    files = []
    for name, part in (("a", four_towns(spread_m=0.1)[:8]), ("b", four_towns(spread_m=0.1)[8:])):
        (tmp_path / name).mkdir()
        files.append(tmp_path / name / "results.csv")
        files[-1].write_text(csv_text(frame_of(part)))
    runs = findings.read_results(files)
    assert csv_text(runs) == csv_text(frame_of(four_towns(spread_m=0.1)))
    (tmp_path / "findings").mkdir()
    page, figures = tmp_path / findings.PAGE, tmp_path / findings.FIGURES
    page.write_text(f"by hand\n{findings.BEGIN}\nolder\n{findings.END}\nby hand, too\n")
    findings.write_findings(runs, tmp_path)
    once = page.read_text()
    findings.write_findings(runs, tmp_path)
    assert page.read_text() == once
    assert (tmp_path / findings.PICTURE).read_bytes().startswith(b"\x89PNG")
    assert "| Movers hurt LiDAR odometry | ×1.58 | KISS-ICP | ×1.50 | reproduced |  |" in once
    assert once.startswith("by hand\n")
    assert once.endswith("\nby hand, too\n")
    assert "older" not in once
    ratios_written = (figures / "ratios.csv").read_text()
    assert "dynamic / static,LiDAR,KISS-ICP,here,×1.50,×1.50–×1.50,4 of 4,larger\n" in ratios_written
    assert (figures / "errors_lidar.csv").read_text().startswith("town,traffic,KISS-ICP\n")


def test_what_is_no_table_of_results_is_refused(tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_text("a,b\n1,2\n")
    with pytest.raises(EvaluationError, match=r"give a results\.csv of benchmark"):
        findings.read_results([tmp_path / "results.csv"])


def test_what_lacked_its_input_is_no_failure_and_no_path_is_written() -> None:
    good = score("Town01", "dynamic", 1.25, cloud="seg")
    lacking = replace(good, run=2, failed="/home/me/x.bag has clouds without labels; replay with --topics a")
    lost = replace(good, town="Town03", failed="crashed by SIGSEGV: /home/me/log.txt")
    tables = findings.figure_tables(frame_of([good, lacking, lost]))
    text = "".join(table.to_csv(index=False) for table in tables.values())
    assert "Town01,seg(d),1.25\n" in text
    assert "crashed by SIGSEGV: log.txt" in text
    assert "labels" not in text
    assert "/home" not in text


def test_failures_are_counted_by_condition_each_reason_once() -> None:
    good = score("Town01", "static", ape_m=1.0)
    lost, slow = replace(good, failed="lost"), replace(good, failed="too slow")
    table = failure_table(frame_of([good, lost, lost, slow, replace(good, town="Town03")]))
    assert table.to_numpy().tolist() == [
        ["KISS-ICP", "Town01", "ClearNoon static", "3 of 4", "lost; too slow"]
    ]


def test_a_drift_upwards_is_none_in_the_plane() -> None:
    """An estimate that rises by 2 % of the way, and one that is 1 % too long."""
    drifts = script("docs/findings/effects/effects.py").drifts_percent
    way = np.arange(500.0)[:, None]
    truth, rising, long = (
        Trajectory(stamp_ns=np.arange(500), position_m=way * step, quat_xyzw=np.eye(4)[[3] * 500], name="a")
        for step in ([1, 0, 0], [1, 0, 0.02], [1.01, 0, 0])
    )
    assert drifts(truth, rising) == pytest.approx((2.0, 0.0))
    assert drifts(truth, long) == pytest.approx((1.0, 1.0))


def test_the_pages_hold_what_the_kept_results_give() -> None:
    docs = ROOT / "docs"
    page = (docs / findings.PAGE).read_text(encoding="utf-8")
    (command,) = re.findall(r"`python docs/findings/findings\.py((?: docs/findings/\w+)+)`", page)
    runs = findings.read_results([docs.parent / folder / "results.csv" for folder in command.split()])
    assert findings.markdown_table(findings.answers_table(runs)) in page
    for name, table in findings.figure_tables(runs).items():
        kept = (docs / findings.FIGURES / f"{name}.csv").read_text(encoding="utf-8")
        assert kept == table.to_csv(index=False, lineterminator="\n"), name
