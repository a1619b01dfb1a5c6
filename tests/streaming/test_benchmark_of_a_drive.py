"""A benchmark over a drive reads what a dataset of it would hold, whatever becomes of single systems."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from shared_fixtures.drives.straight_drives import RIG, StraightDrive
from shared_fixtures.processes.lifecycles import runs
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.errors import CarlaLocError, EpisodeError
from recorder.benchmark.config import BenchmarkConfig
from recorder.benchmark.run import BenchmarkResult, run_benchmark
from recorder.cli.main import main
from recorder.replaying.options import ReplayOptions
from recorder.replaying.replay import replay
from recorder.slam.worker import ESTIMATE
from recorder.streaming.drive import DriveConfig

pytest.importorskip("small_gicp", reason="the benchmark runs small_gicp")

METHODS = ("small_gicp", "stereo_vo")
CONDITIONS: dict[str, Any] = {"weathers": ("ClearNoon", "RainyNight"), "traffic": ("dynamic",)}
LABELLED = RIG.replace("outputs: [rgb]", "outputs: [rgb, semantic]").replace("semantic, events]", "semantic]")
OWN = """
import json, os, signal, time
from pathlib import Path
import numpy as np
from recorder.slam.system import System
SYSTEM = System(
    name="{name}", title="{name}", what="a test", needs=("lidar", "imu"), runner="x:run", frame="lidar"
)
def run(sequence, clock):
    inertial = list(sequence.imu_samples())
    assert len(inertial) == 100 and sequence.frames("lidar") == 10
    poses, turns = [], []
    for scan in sequence.scans():
        began = time.monotonic()
        with clock.frame():
            time.sleep(0.02)
            {body}
        turns.append((began, time.monotonic()))
        T = np.eye(4)
        T[0, 3] = 0.1 * len(poses) ** 2
        poses.append((scan.stamp_ns, T))
    Path(__file__).with_suffix(".json").write_text(json.dumps(turns))
    return poses
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both cameras have labels, so that pairs can be had without movers."""
    need_opengl()
    path = tmp_path_factory.mktemp("rig") / "rig.yaml"
    path.write_text(LABELLED)
    return path


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig without cameras."""
    path = tmp_path_factory.mktemp("few") / "few.yaml"
    path.write_text(LABELLED.partition("- kind: camera")[0])
    return path


def drives(drive: StraightDrive, rig: Path, *, map: Path | None = None, noise_seeds: int = 1) -> DriveConfig:
    """Half a second of the drive under two weathers."""
    return DriveConfig(
        episodes=(drive.episode,),
        options=ReplayOptions(rig=str(rig), quality="low", **CONDITIONS),
        noise_seeds=noise_seeds,
        start_s=0.5,
        duration_s=0.5,
        map=map or drive.town,
    )


def benchmark(data: DriveConfig, out: Path, *methods: str, **more: Any) -> BenchmarkResult:
    return run_benchmark(BenchmarkConfig(data=data, out=out, methods=methods, **more))


@pytest.fixture(scope="module")
def streamed(
    straight_drive: StraightDrive, rig: Path, tmp_path_factory: pytest.TempPathFactory
) -> list[BenchmarkResult]:
    """A LiDAR system over two seeds of noise, and a stereo one."""
    out = tmp_path_factory.mktemp("streamed")
    return [
        benchmark(drives(straight_drive, rig, noise_seeds=n), out, method)
        for method, n in zip(METHODS, (2, 1), strict=True)
    ]


@pytest.fixture(scope="module")
def from_dataset(
    straight_drive: StraightDrive, rig: Path, tmp_path_factory: pytest.TempPathFactory
) -> BenchmarkResult:
    """The same systems over a dataset of the drive's own seed."""
    folder = tmp_path_factory.mktemp("dataset")
    options = {"rig": str(rig), "preview": False, "start_s": 0.5, "duration_s": 0.5}
    replay(straight_drive.config(folder / "data", **CONDITIONS, **options))
    return run_benchmark(BenchmarkConfig(data=folder / "data", out=folder / "out", methods=METHODS))


def test_estimates_are_those_from_a_dataset(
    streamed: list[BenchmarkResult], from_dataset: BenchmarkResult
) -> None:
    """Byte for byte: raw and without movers, by day and in the rain at night."""
    found = {job.folder.parts[-4:]: r.out / job.folder for r in streamed for job in r.jobs
             if job.sequence.dataset == "drive/seed5"}  # fmt: skip
    assert len(from_dataset.jobs) == 6  # sweeps are the same in all weathers
    for job in from_dataset.jobs:
        ours, theirs = found[job.folder.parts[-4:]], from_dataset.out / job.folder
        assert (ours / ESTIMATE).read_bytes() == (theirs / ESTIMATE).read_bytes(), job.folder
    movers = {score.movers for score in from_dataset.scores}
    assert {score.movers for score in streamed[-1].scores} == movers


def test_another_seed_of_noise_is_another_estimate(streamed: list[BenchmarkResult]) -> None:
    found = {score.dataset: score.ape_m for score in streamed[0].scores}
    assert set(found) == {"drive/seed5", "drive/seed6"}
    assert len(set(found.values())) == 2


def test_a_lidar_is_chosen_by_its_name(straight_drive: StraightDrive, few: Path, tmp_path: Path) -> None:
    """The second LiDAR of a rig gives the estimate that it gives alone, and the score has its name."""
    rear = "- {kind: lidar, name: rear, columns: 200, beams: 16, mount: {position_m: [0, 0, 1.9]}}\n"
    (tmp_path / "both.yaml").write_text(few.read_text() + rear)
    (tmp_path / "alone.yaml").write_text("name: alone\nsensors:\n" + rear)
    found = []
    for name, lidar in (("both", "rear"), ("alone", None)):
        data = replace(drives(straight_drive, tmp_path / f"{name}.yaml"), lidar=lidar)
        result = benchmark(data, tmp_path / name, "small_gicp", clouds=("raw",))
        (job,), (score,) = result.jobs, result.scores
        assert (score.failed, score.lidar) == (None, "rear")
        found.append((result.out / job.folder / ESTIMATE).read_bytes())
    assert found[0] == found[1]


def test_nothing_of_the_sensor_data_stays(streamed: list[BenchmarkResult]) -> None:
    out = streamed[0].out
    files = [path for path in out.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 3_000_000
    assert {path.name for path in out.iterdir()} == {"drives", "runs"}


def test_the_same_command_runs_nothing_again(
    streamed: list[BenchmarkResult], straight_drive: StraightDrive, rig: Path
) -> None:
    again = benchmark(drives(straight_drive, rig, noise_seeds=2), streamed[0].out, METHODS[0])
    assert again.reused == len(streamed[0].jobs)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Systems of a user: one that moves, one that is killed, one that takes three sweeps and no more."""
    folder = tmp_path_factory.mktemp("own")
    bodies = {
        "moves": "pass",
        "killed": "len(poses) == 5 and os.kill(os.getpid(), signal.SIGKILL)",
        "stops": "\n            if len(poses) == 3: break",
    }
    for name, body in bodies.items():
        (folder / f"{name}.py").write_text(OWN.format(name=name, body=body))
    return {name: str(folder / f"{name}.py") for name in bodies}


def test_who_dies_or_stops_holds_nobody_up(
    straight_drive: StraightDrive, rig: Path, own: dict[str, str], tmp_path: Path
) -> None:
    """Two lanes: who goes on gets all frames, and no other of its lane has one in hand meanwhile."""
    (tmp_path / "drives" / "drive" / "seed6").mkdir(parents=True)  # left by a command that was ended
    result = benchmark(drives(straight_drive, rig), tmp_path, *own.values(), clouds=("raw",), workers=2)
    moves, killed, stops = result.scores
    assert moves.coverage == 1.0
    kept = [Path(own[name]).with_suffix(".json").read_text() for name in ("moves", "stops")]
    turns = sorted(turn for text in kept for turn in json.loads(text))
    assert len(turns) == 10 + 3
    assert all(end <= begin for (_, end), (begin, _) in pairwise(turns))
    assert "SIGKILL" in str(killed.failed)
    assert stops.coverage == pytest.approx(3 / 9)


def test_what_the_rig_lacks_is_a_row_and_the_rest_goes_on(
    straight_drive: StraightDrive, few: Path, own: dict[str, str], tmp_path: Path
) -> None:
    data, methods = drives(straight_drive, few), (own["moves"], "stereo_vo")
    result = benchmark(data, tmp_path / "out", *methods, clouds=("raw",))
    moves, *stereo_vo = result.scores
    assert moves.coverage == 1.0
    assert {score.failed for score in stereo_vo} == {"rig 'small' has 0 cameras; stereo needs two"}


def test_programs_share_files_that_are_deleted_afterwards(
    straight_drive: StraightDrive, rig: Path, tmp_path: Path
) -> None:
    (tmp_path / "slam.sh").write_text(
        'stat -c "%i %Z" "$2" >> "$(dirname $0)/seen"; head -c 7 "$2" >> "$(dirname $0)/begin"\n'
        'printf "0 0 0 0 0 0 0 1\\n" > "$1"\n'
    )
    programs = [tmp_path / f"{name}.yaml" for name in ("mine", "other")]
    for path in programs:
        path.write_text(
            f"{{name: {path.stem}, title: {path.stem}, needs: [lidar], frame: lidar, "
            'command: [sh, "{here}/slam.sh", "{out}", "{bag}"]}'
        )
    benchmark(drives(straight_drive, rig), tmp_path / "out", *map(str, programs), clouds=("raw",))
    first, second = (tmp_path / "seen").read_text().splitlines()
    assert first == second
    assert (tmp_path / "begin").read_bytes() == b"#ROSBAG" * 2
    assert not (tmp_path / "out" / "bags").exists()


def command(drive: StraightDrive, rig: Path, out: Path, *words: str) -> list[str]:
    return [
        "benchmark", str(drive.episode), "--map", str(drive.town), "--rig", str(rig), "--out", str(out),
        "--clouds", "raw", "--start", "0.5", "--duration", "0.5", *words,
    ]  # fmt: skip


def test_bad_input_is_one_line(
    straight_drive: StraightDrive, rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command(straight_drive, rig, tmp_path / "out", "--rerun")) != 0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("carlaloc")]
    assert "replay them into a dataset" in line
    shutil.copy(straight_drive.episode, tmp_path / "drive.mcap")
    mixed = command(straight_drive, rig, tmp_path / "out")
    assert main([*mixed[:1], str(tmp_path / "drive.mcap"), *mixed[1:]]) != 0
    assert "two drives are called drive" in capsys.readouterr().err


def test_a_drive_of_another_world_is_refused(
    straight_drive: StraightDrive, rig: Path, tmp_path: Path
) -> None:
    other = tmp_path / "straight.xodr"
    other.write_text(straight_drive.town.read_text().replace('a="3.5"', 'a="3.6"'))
    config = BenchmarkConfig(
        data=drives(straight_drive, rig, map=other), out=tmp_path / "out", methods=("small_gicp",)
    )
    why = "record it anew: carlaloc record"
    with suppress(EpisodeError):  # where an earlier test has left the town in the cache
        assert why in str(run_benchmark(config).scores[0].failed)
    with pytest.raises(EpisodeError, match=why):
        run_benchmark(config)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
def test_an_ended_process_leaves_no_orphan_and_the_same_command_goes_on(
    straight_drive: StraightDrive, few: Path, own: dict[str, str], tmp_path: Path
) -> None:
    """Without the benchmark all others end; without the feed its runs fail, and are run again."""
    words = command(straight_drive, few, tmp_path / "out", "--methods", own["moves"])
    run = [sys.executable, "-m", "recorder.cli.main", *words]
    for who in ("benchmark", "Ctrl-C", "feed"):
        with subprocess.Popen(run, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as first:
            feed = _feed_below(first.pid)
            others = _below(first.pid)
            if who == "Ctrl-C":
                first.send_signal(signal.SIGINT)
            else:
                os.kill(first.pid if who == "benchmark" else feed, signal.SIGKILL)
            printed = first.communicate(timeout=600)[1].decode()
        until = time.monotonic() + 600
        while any(runs(pid) for pid in others):
            assert time.monotonic() < until, who
            time.sleep(0.05)
        if who == "Ctrl-C":
            assert "interrupted; 0 of 1 runs are kept, and the same command resumes" in printed
            assert "Traceback" not in printed
    assert first.returncode == 1
    assert "the feed ended with -9" in printed
    again = subprocess.run(run, capture_output=True, text=True, check=False)
    assert "diverged" in again.stderr  # it ran, and says that this system is no good one


def _below(pid: int) -> list[int]:
    """Processes below one, of which any may end meanwhile."""
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            found += [int(n) for n in task.read_text().split()]
    return found + [n for child in found for n in _below(child)]


def _feed_below(pid: int) -> int:
    """The feed below a process, when it has begun."""
    until = time.monotonic() + 600
    while time.monotonic() < until:
        for child in _below(pid):
            with suppress(OSError):  # it has ended
                if b"recorder.streaming.feed" in Path(f"/proc/{child}/cmdline").read_bytes():
                    time.sleep(0.5)
                    return child
        time.sleep(0.02)
    raise AssertionError(f"no feed below process {pid}")


def test_a_cluster_gives_the_same_estimates(
    streamed: list[BenchmarkResult],
    straight_drive: StraightDrive,
    rig: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    distributed = pytest.importorskip("distributed", reason="clusters need the extra `cluster`")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, processes=True
    ) as scheduler:
        data, address = drives(straight_drive, rig), scheduler.scheduler_address
        result = benchmark(data, tmp_path, METHODS[0], cluster=address)
    assert len(result.jobs) == 2
    for job in result.jobs:
        same = streamed[0].out / job.folder
        assert (tmp_path / job.folder / ESTIMATE).read_bytes() == (same / ESTIMATE).read_bytes()


def test_a_cluster_is_for_drives_alone(tmp_path: Path) -> None:
    with pytest.raises(CarlaLocError, match="drives"):
        BenchmarkConfig(data=tmp_path, out=tmp_path / "out", cluster="tcp://nobody:1")
