"""A benchmark of real systems over a dataset in closed form: scores, failures, resumption, tables."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import write_dataset

from carlaloc_env.core.errors import ConfigError
from recorder.benchmark import score as scoring
from recorder.benchmark.plan import find_sequences, plan_jobs
from recorder.benchmark.results import RESULT
from recorder.benchmark.run import BenchmarkConfig, BenchmarkResult, run_benchmark
from recorder.benchmark.tables import all_tables, csv_text, frame_of, latex, markdown
from recorder.cli.main import main
from recorder.evaluation.trajectory import Trajectory
from recorder.slam.systems import SYSTEMS

pytest.importorskip("small_gicp", reason="the benchmark runs small_gicp")

BROKEN = """
import os
from recorder.slam.system import System
SYSTEM = System(name="{name}", title="{name}", what="a test", needs=("lidar",), runner="x:run", frame="lidar")
def run(sequence, clock):
    {body}
"""


PROGRAM = """
{name: mine, title: My SLAM, needs: [lidar], frame: lidar, command: [sh, "{here}/slam.sh", "{out}", "{bag}"]}
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    conditions = ("ClearNoon_static", "ClearNoon_dynamic", "FoggyNoon_dynamic")
    return write_dataset(tmp_path_factory.mktemp("data") / "set", conditions=conditions)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Systems of a user: one that crashes, one that raises, one that stands, one that never ends."""
    folder = tmp_path_factory.mktemp("own")
    bodies = {
        "crashes": "os.abort()",
        "raises": "raise ValueError('no such luck')",
        "stands": "import numpy as np; return [(s.stamp_ns, np.eye(4)) for s in sequence.scans()]",
        "sleeps": "import time; time.sleep(600)",
    }
    for name, body in bodies.items():
        (folder / f"{name}.py").write_text(BROKEN.format(name=name, body=body))
    return {name: str(folder / f"{name}.py") for name in bodies}


@pytest.fixture(scope="module")
def result(data: Path, own: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> BenchmarkResult:
    config = BenchmarkConfig(
        data=data,
        out=tmp_path_factory.mktemp("out"),
        methods=("small_gicp", own["crashes"], own["raises"], own["stands"]),
        clouds=("raw",),
    )
    return run_benchmark(config)


def test_a_real_system_finds_its_way_through_the_box(result: BenchmarkResult) -> None:
    scores = [score for score in result.scores if score.method == "small_gicp"]
    assert [(s.weather, s.traffic) for s in scores] == [("ClearNoon", "dynamic"), ("ClearNoon", "static")]
    for score in scores:
        assert score.failed is None
        # It moves 1.6 m/s, so that a pose at the wrong end of the sweep would be 0.08 m off.
        assert score.ape_m < 0.06
        assert score.coverage == 1.0
        assert score.peak_memory_mb > 20
        assert 0 < score.cpu_s < 100
        assert score.frame_median_s > 0


def test_failures_are_rows_with_reasons(result: BenchmarkResult) -> None:
    why = {score.method: score.failed for score in result.scores}
    assert str(why["crashes"]).startswith("crashed by SIGABRT")
    assert why["raises"] == "ValueError: no such luck"
    assert "lie on a point" in str(why["stands"])


def test_a_run_has_a_time_limit(data: Path, own: dict[str, str], tmp_path: Path) -> None:
    from recorder.slam.supervisor import run_isolated

    folder = find_sequences(data)[0].path
    record = run_isolated(own["sleeps"], folder, tmp_path, cloud="raw", limit_s=0.5)
    assert record.error == "ended after its time limit of 0 s"
    assert record.wall_s < 60


def test_results_are_kept_until_what_they_depend_on_changes(
    data: Path, own: dict[str, str], tmp_path: Path
) -> None:
    config = BenchmarkConfig(data=data, out=tmp_path, methods=(own["raises"],), clouds=("raw",))
    first = run_benchmark(config)
    assert (first.reused, len(first.scores)) == (0, 2)
    assert run_benchmark(config).reused == 2
    broken = next(tmp_path.rglob(RESULT))
    broken.write_text("{")
    assert run_benchmark(config).reused == 1
    source = Path(own["raises"])
    source.write_text(source.read_text() + "# another version\n")
    assert run_benchmark(config).reused == 0


def test_tables_hold_all_rows(result: BenchmarkResult) -> None:
    runs = frame_of(result.scores)
    tables = all_tables(runs)
    text = markdown(tables)
    assert "| Box | d | " in text
    assert "| fail | fail | fail |" in text
    assert re.search(r"\\textbf\{0\.\d+\} & fail", latex(tables))
    rows = list(csv.DictReader(csv_text(runs).splitlines()))
    assert len(rows) == len(result.scores)
    assert float(rows[0]["ape_m"]) == result.scores[0].ape_m


def test_sweeps_that_no_weather_changes_are_run_once_and_seg_only_where_something_moves(data: Path) -> None:
    found = find_sequences(data)
    assert [s.key for s in found] == [
        "Box/ClearNoon_dynamic", "Box/ClearNoon_static", "Box/FoggyNoon_dynamic",
    ]  # fmt: skip
    jobs = plan_jobs(found, [("a", SYSTEMS["kiss_icp"])], runs=2, clouds=("raw", "seg"))
    named = [(j.sequence.path.name, j.cloud, j.run) for j in jobs]
    assert named == [
        ("ClearNoon_dynamic", "raw", 1), ("ClearNoon_dynamic", "raw", 2),
        ("ClearNoon_dynamic", "seg", 1), ("ClearNoon_dynamic", "seg", 2),
        ("ClearNoon_static", "raw", 1), ("ClearNoon_static", "raw", 2),
    ]  # fmt: skip
    visual = plan_jobs(found, [("a", SYSTEMS["stereo_vo"])], runs=1, clouds=("raw", "seg"))
    assert len(visual) == 3
    program = replace(SYSTEMS["kiss_icp"], takes_seg=False)
    assert {job.cloud for job in plan_jobs(found, [("a", program)], runs=1, clouds=("raw", "seg"))} == {"raw"}


def test_clouds_without_labels_are_not_asked_for_less_movers(tmp_path: Path) -> None:
    found = find_sequences(write_dataset(tmp_path / "set", sweeps=2, labelled=False))
    jobs = plan_jobs(found, [("a", SYSTEMS["kiss_icp"])], runs=1, clouds=("raw", "seg"))
    assert [job.cloud for job in jobs] == ["raw"]


def test_command_and_its_limit(data: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["benchmark", str(data), "--out", str(tmp_path), "--methods", "small_gicp", "--clouds", "raw"]
    assert main([*words, "--fail-above", "0.5", "--windows", "1", "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    files = {Path(file).name for file in found["files"]}
    assert files >= {"results.csv", "tables.md", "tables.tex"}
    # Both levels have the same sweeps.
    assert (found["windows"], found["headline"][:36]) == ([], "No system loses clearly; small_gicp ")
    assert main([*words, "--fail-above", "0.0001", "--windows", "1"]) == 1
    told = capfd.readouterr().out
    assert "no window" in told
    assert "above the limit: small_gicp Box ClearNoon dynamic: APE 0." in told
    assert "2 of them done before" in told


def test_failures_name_their_log_and_run_again_when_asked(
    data: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A program that fails everywhere, then among movers alone, then nowhere; its description stays.

    As that says nothing of its build, runs without an estimate are made again unasked.
    """
    system, program, out = tmp_path / "mine.yaml", tmp_path / "slam.sh", tmp_path / "out"
    system.write_text(PROGRAM)
    words = ["benchmark", str(data), "--out", str(out), "--methods", str(system), "--clouds", "raw"]
    fails, works = "echo no licence; exit 3", f"cp {data}/Box/ground_truth/lidar.tum $1"
    program.write_text(fails)
    assert main(words) == 1
    log = out / "runs" / "Box" / "ClearNoon_dynamic" / "mine" / "1" / "log.txt"
    line = f"My SLAM failed in Box/ClearNoon_dynamic, run 1: sh ended with 3; log: {log}"
    line += ", which ends with: no licence"
    told = capfd.readouterr().err.splitlines()[-1]
    assert told == f"carlaloc benchmark: every run failed, 2 in all; {line}"
    assert "no licence" in log.read_text()
    program.write_text(f"case $2 in *static*) {works};; *) {fails};; esac")
    assert main(words) == 0
    assert line in capfd.readouterr().out.splitlines()
    program.write_text(works)
    for again, reused in ((None, 1), ("failed", 2)):
        found = run_benchmark(
            BenchmarkConfig(data=data, out=out, methods=(str(system),), clouds=("raw",), again=again)
        )
        assert (found.failures, found.reused) == ([], reused)
    assert main([*words, "--again", "all", "--json"]) == 0
    last = json.loads(capfd.readouterr().out)
    assert (last["failures"], last["reused"]) == ([], 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"methods": ("small_gicq",)}, "did you mean 'small_gicp'|small_gicp"),
        ({"methods": ("missing.py",)}, "no such file"),
        ({"clouds": ("cooked",)}, "choose from raw, seg"),
        ({"workers": 1000}, "cores"),
        ({"again": "faild"}, "did you mean 'failed'"),
    ],
)
def test_wrong_words_are_named(data: Path, tmp_path: Path, change: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        run_benchmark(BenchmarkConfig(**{"data": data, "out": tmp_path, **change}))  # type: ignore[arg-type]


def test_a_folder_without_sequences_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no sequence"):
        find_sequences(tmp_path)


def test_a_camera_is_judged_over_the_time_of_its_images() -> None:
    """A replay may make images of a part of its stretch: here of 2 to 5 s of 16."""
    stamp_ns = np.arange(0, 16_000_000_000, 50_000_000)
    way_m = np.stack([stamp_ns * 1e-9, np.zeros(len(stamp_ns)), np.zeros(len(stamp_ns))], axis=1)
    level = np.tile([0.0, 0.0, 0.0, 1.0], (len(way_m), 1))
    truth = Trajectory(stamp_ns=stamp_ns, position_m=way_m, quat_xyzw=level)
    images = SimpleNamespace(image_stamps=lambda: np.arange(2_000_000_000, 5_000_000_001, 100_000_000))
    seen = scoring._seen(truth, images)  # type: ignore[arg-type]
    assert (seen.stamp_ns[0], seen.stamp_ns[-1]) == (1_900_000_000, 5_100_000_000)


def test_a_drive_behind_a_link_of_another_name_is_run(tmp_path: Path) -> None:
    """Its process finds the dataset by the path that was given, not by where the data lie."""
    root = write_dataset(tmp_path / "set", sweeps=12)
    (root / "Box").rename(tmp_path / "run7")
    (root / "Box").symlink_to(tmp_path / "run7")
    config = BenchmarkConfig(data=root, out=tmp_path / "out", methods=("small_gicp",), clouds=("raw",))
    (score,) = run_benchmark(config).scores
    assert (score.town, score.coverage, score.failed) == ("Box", 1.0, None)
