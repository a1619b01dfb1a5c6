"""Jobs in processes of their own, with progress and errors reported to the parent."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TypeVar

from carlaloc_env.core.errors import CarlaLocError

Job = TypeVar("Job")
Result = TypeVar("Result")
Report = Callable[[float], None]
"""Called by a job with its progress, in a unit of its own."""
Work = Callable[[Job, Report], Result]

ENVIRONMENT = {"LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1", "MALLOC_MMAP_THRESHOLD_": "262144"}
"""Set in workers: with a process per core, threads of a software renderer would only compete; a
fixed threshold lets glibc give the memory of building a scene back to the system."""


def run_jobs(
    work: Work[Job, Result], jobs: Sequence[Job], workers: int, report: Callable[[int, float], None]
) -> list[Result]:
    """Run jobs and return their results in order.

    Args:
        work: A function of a module, called with a job and a function that reports its progress.
        jobs: What to do; sent to the processes by pickle.
        workers: Number of processes; with one, everything runs in this process.
        report: Called with a job's number and its progress.

    Raises:
        Exception: the first error of a job; the other processes are ended then.
    """
    if workers == 1 or len(jobs) < 2:
        return [work(job, lambda done, k=k: report(k, done)) for k, job in enumerate(jobs)]  # type: ignore[misc]
    context = get_context("spawn")
    results: dict[int, Result] = {}
    waiting = list(enumerate(jobs))
    running: dict[Connection, object] = {}
    processes = []
    try:
        with _environment():
            while waiting or running:
                while waiting and len(running) < workers:
                    k, job = waiting.pop(0)
                    receiver, sender = context.Pipe(duplex=False)
                    process = context.Process(target=_child, args=(sender, work, k, job), daemon=True)
                    process.start()
                    sender.close()
                    processes.append(process)
                    running[receiver] = process
                for connection in wait(list(running)):
                    _receive(connection, running, results, report)  # type: ignore[arg-type]
    finally:
        for process in processes:
            if process.is_alive() and running:
                process.terminate()
            process.join()
    return [results[k] for k in range(len(jobs))]


def _child(connection: Connection, work: Work[Job, Result], k: int, job: Job) -> None:
    # A Ctrl-C reaches all processes of a terminal: the parent decides. Without a parent nobody would.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    try:
        result = work(job, lambda done: connection.send(("progress", k, done)))
        connection.send(("result", k, result))
    except CarlaLocError as error:
        connection.send(("error", k, error))
    finally:
        connection.close()


def _end_with(parent: BaseProcess) -> None:
    """End this process as soon as its parent has ended, however that came."""
    parent.join()
    os._exit(1)


def _receive(
    connection: Connection,
    running: dict[Connection, object],
    results: dict[int, Result],
    report: Callable[[int, float], None],
) -> None:
    try:
        kind, k, value = connection.recv()
    except EOFError:
        del running[connection]
        raise CarlaLocError("a worker process ended early; its traceback stands above") from None
    if kind == "error":
        raise value
    if kind == "result":
        results[k] = value
        del running[connection]
    else:
        report(k, value)


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
