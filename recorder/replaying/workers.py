"""Workers that do the jobs of a run: this process, processes of this machine, or a Dask cluster.

All three are executors of `concurrent.futures`, so that the same loop serves them. A worker that dies is
replaced, and its job is done again.
"""

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Protocol

from carlaloc_env.core.errors import CarlaLocError, ConfigError

ENVIRONMENT = {"LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1", "MALLOC_MMAP_THRESHOLD_": "262144"}
"""Set in workers: with a process per core, threads of a software renderer would only compete; a
fixed threshold lets glibc give the memory of building a scene back to the system."""
ATTEMPTS = 3
"""How often workers may die of a job before the run gives up."""
_LOOK_S = 0.25
"""Time between two looks at how far workers are [s]."""

Report = Callable[[float], None]
"""Called by a job with its progress, in a unit that depends on the job."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A job and the function that does it."""

    do: Callable[[Any, Report], None]
    """A function of a module, called with the job and a function that reports its progress."""
    job: Any
    """The input of the function; sent to workers by pickle."""
    progress: Path
    """File in which a worker writes its progress; its folder exists."""


Look = Callable[[Mapping[Task, float]], None]
"""Called with the progress of tasks."""


class Workers(Protocol):
    """Interface of a place where tasks run."""

    at_once: int
    """How many tasks are handed out at a time."""
    deaths: tuple[type[Exception], ...]
    """Exceptions of a future whose worker has died."""

    def executor(self) -> Executor:
        """A new executor."""

    def stop(self, executor: Executor) -> None:
        """End an executor at once, with all that it does."""


class ThisProcess:
    """Does tasks in this process, in turn.

    Args:
        look: Called with the progress of a task.
        release: Called at the end, to release whatever tasks keep for the next task.
    """

    at_once = 1
    deaths: tuple[type[Exception], ...] = ()

    def __init__(self, look: Look, release: Callable[[], None]) -> None:
        self._look, self._release = look, release

    def executor(self) -> Executor:
        """An executor that does a task when it is submitted."""
        return _Inline(self._look)

    def stop(self, executor: Executor) -> None:
        """Release kept objects."""
        self._release()


class LocalProcesses:
    """Processes of this machine.

    Args:
        count: How many.
    """

    deaths: tuple[type[Exception], ...] = (BrokenExecutor,)

    def __init__(self, count: int) -> None:
        self._count = count
        # An extra task waits, so that no worker does.
        self.at_once = count + 1
        self._foreign = set(multiprocessing.active_children())

    def executor(self) -> Executor:
        """A pool of processes, each with separate modules and memory."""
        return ProcessPoolExecutor(self._count, mp_context=get_context("spawn"), initializer=_begin_worker)

    def stop(self, executor: Executor) -> None:
        """End all processes; none has anything to clean up."""
        executor.shutdown(wait=False, cancel_futures=True)
        ours = set(multiprocessing.active_children()) - self._foreign
        for process in ours:
            process.kill()
        for process in ours:
            # The executor's thread waits for them, too, and may be notified first.
            while process.is_alive():
                process.join(0.01)


class DaskCluster:
    """Workers of a running Dask scheduler, which all see the same folders.

    Args:
        address: Of the scheduler, such as ``tcp://node1:8786``.

    Raises:
        ConfigError: Dask is not installed, or no scheduler answers at the address.
    """

    at_once = 4096

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client, KilledWorker
        except ImportError as error:
            raise ConfigError(f"a cluster needs Dask ({error}); pip install 'carlaloc[cluster]'") from error
        self.deaths: tuple[type[Exception], ...] = (KilledWorker,)
        try:
            self._client = Client(address, timeout="10s", set_as_default=False)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise ConfigError(
                f"no Dask scheduler answers at {address}: {reason}; start a scheduler first"
            ) from error

    def executor(self) -> Executor:
        """The cluster as an executor; its scheduler repeats the tasks of a lost worker."""
        executor: Executor = self._client.get_executor(pure=False)
        return executor

    def stop(self, executor: Executor) -> None:
        """Disconnect from the cluster; its workers notice a stopped run by themselves."""
        executor.shutdown(wait=False)
        self._client.close(timeout=1)


def run_tasks(
    tasks: Sequence[Task],
    workers: Workers,
    *,
    done: Callable[[Task], Sequence[Task]],
    look: Look,
) -> None:
    """Do tasks, and those that follow from them.

    Args:
        tasks: The tasks, in order of preference.
        workers: Where.
        done: Called with each finished task; returns what can be done now.
        look: Called four times a second with the progress of the tasks that are not finished.

    Raises:
        Exception: the first error of a task; all others are ended then.
        CarlaLocError: workers die of a task again and again.
    """
    deaths: Counter[Task] = Counter()
    left = list(tasks)
    while left:
        for task in left:
            task.progress.unlink(missing_ok=True)
        executor = workers.executor()
        try:
            with _environment():
                left = _work(executor, left, workers, done, look)
        finally:
            workers.stop(executor)
        # A task in progress when a worker died may be the cause.
        deaths.update(task for task in left if task.progress.exists())
        for task, times in deaths.items():
            if times >= ATTEMPTS:
                raise CarlaLocError(
                    f"workers died {times} times of {task.progress.stem}, perhaps for want of memory; "
                    "take fewer --workers"
                )


def _work(
    executor: Executor,
    tasks: Sequence[Task],
    workers: Workers,
    done: Callable[[Task], Sequence[Task]],
    look: Look,
) -> list[Task]:
    """Do tasks, and return those that are left over where workers have died."""
    waiting, left = deque(tasks), list[Task]()
    pending: dict[Future[None], Task] = {}
    while waiting or pending:
        while waiting and len(pending) < workers.at_once:
            task = waiting.popleft()
            try:
                pending[executor.submit(_do, task)] = task
            except workers.deaths:
                left += [task, *waiting]
                waiting.clear()
        finished, _ = wait(pending, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
        for future in finished:
            task = pending.pop(future)
            try:
                future.result()
            except workers.deaths:
                left.append(task)
            else:
                # Tasks that follow come first: assembled sequences free disk space.
                waiting.extendleft(done(task))
        look({task: progress_of(task) for task in pending.values()})
    return left


def _do(task: Task) -> None:
    """Do a task in a worker, and keep its progress in a file."""
    # Written in place: file systems sync a truncated and rewritten file to the disk each time.
    with task.progress.open("wb", buffering=0) as file:

        def report(done: float) -> None:
            file.seek(0)
            file.write(f"{done:12.2f}".encode())

        report(0.0)
        task.do(task.job, report)
    task.progress.unlink(missing_ok=True)


def progress_of(task: Task) -> float:
    """Progress of a task that a worker does; 0 before it begins."""
    try:
        return float(task.progress.read_text(encoding="ascii") or 0)
    except (OSError, ValueError):
        return 0.0


class _Inline(Executor):
    """Does each task when it is submitted; errors are raised there and then."""

    def __init__(self, look: Look) -> None:
        self._look = look

    def submit(self, do: Any, /, *args: Any, **_: Any) -> Future[Any]:
        (task,) = args
        task.do(task.job, lambda done: self._look({task: done}))
        future: Future[Any] = Future()
        future.set_result(None)
        return future


def _begin_worker() -> None:
    # A Ctrl-C reaches all processes of a terminal: the parent decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    """End this process as soon as its parent has ended, however that came."""
    parent.join()
    os._exit(1)


@contextmanager
def _environment() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
