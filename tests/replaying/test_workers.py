"""Tasks in processes and on a cluster: all are done, errors told, the dead replaced, nobody left behind."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from carlaloc_env.core.errors import CarlaLocError, ConfigError
from recorder.replaying.workers import DaskCluster, LocalProcesses, Task, ThisProcess, Workers, run_tasks

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="signals as on Linux")


def note(job: tuple[Path, int], report: Callable[[float], None]) -> None:
    """Leave a file that says who has done it."""
    folder, number = job
    report(1.0)
    (folder / f"{number}.done").write_text(str(os.getpid()))


def die_once(job: tuple[Path, int], report: Callable[[float], None]) -> None:
    """The worker is killed in the midst of its first attempt at number 2."""
    folder, number = job
    if number == 2 and not (folder / "died").exists():
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    note(job, report)


def die(job: tuple[Path, int], report: Callable[[float], None]) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def fail(job: tuple[Path, int], report: Callable[[float], None]) -> None:
    if job[1] == 1:
        raise ConfigError("number 1 cannot be done")
    time.sleep(1000.0)


def tasks(
    do: Callable[[tuple[Path, int], Callable[[float], None]], None], folder: Path, count: int = 4
) -> list[Task]:
    return [Task(do, (folder, number), folder / f"{number}.progress") for number in range(count)]


def run(todo: list[Task], workers: Workers) -> None:
    run_tasks(todo, workers, done=lambda _: [], look=lambda _: None)


def finished(folder: Path) -> list[int]:
    return sorted(int(path.stem) for path in folder.glob("*.done"))


@pytest.fixture(params=[1, 2])
def workers(request: pytest.FixtureRequest) -> Workers:
    return LocalProcesses(2) if request.param == 2 else ThisProcess(lambda *_: None, lambda: None)


def test_tasks_and_what_follows_from_them_are_done(workers: Workers, tmp_path: Path) -> None:
    first = tasks(note, tmp_path)

    def done(task: Task) -> list[Task]:
        number = task.job[1]
        return [Task(note, (tmp_path, 100), tmp_path / "100.progress")] if number == 3 else []

    run_tasks(first, workers, done=done, look=lambda _: None)
    assert finished(tmp_path) == [0, 1, 2, 3, 100]
    assert not multiprocessing.active_children()


def test_a_killed_process_is_replaced(tmp_path: Path) -> None:
    run(tasks(die_once, tmp_path), LocalProcesses(2))
    assert (tmp_path / "died").exists()
    assert finished(tmp_path) == [0, 1, 2, 3]


def test_what_kills_every_worker_is_given_up(tmp_path: Path) -> None:
    with pytest.raises(CarlaLocError, match="died 3 times of 0"):
        run(tasks(die, tmp_path, 1), LocalProcesses(1))
    assert not multiprocessing.active_children()


def test_a_task_that_fails_ends_them_all(tmp_path: Path) -> None:
    begin = time.monotonic()
    with pytest.raises(ConfigError, match="number 1"):
        run(tasks(fail, tmp_path), LocalProcesses(2))
    assert time.monotonic() - begin < 900.0
    assert not multiprocessing.active_children()


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Two Dask workers in processes of their own."""
    distributed = pytest.importorskip("distributed", reason="clusters need the extra `cluster`")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as scheduler:
        yield scheduler.scheduler_address


def test_a_cluster_does_the_same_and_replaces_its_dead(cluster: str, tmp_path: Path) -> None:
    run(tasks(die_once, tmp_path, 8), DaskCluster(cluster))
    assert (tmp_path / "died").exists()
    assert finished(tmp_path) == list(range(8))
    assert str(os.getpid()) not in {path.read_text() for path in tmp_path.glob("*.done")}


def test_a_scheduler_that_is_not_there_is_one_line() -> None:
    pytest.importorskip("distributed", reason="clusters need the extra `cluster`")
    with pytest.raises(ConfigError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        DaskCluster("tcp://127.0.0.1:9")


def test_workers_hold_no_libraries_of_formats_that_nobody_asked_for() -> None:
    """HDF5 and FFmpeg are imported by those who write them: every worker would hold them."""
    code = "import sys, recorder.replaying.unit_work; print(*{'av', 'h5py'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
