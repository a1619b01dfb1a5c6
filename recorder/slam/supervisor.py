"""Runs a SLAM system in a separate process; records time and memory."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.files.text_files import last_line
from recorder.dataset.layout import whole_path
from recorder.slam.keeper import GRACE_S, descendants, kept
from recorder.slam.worker import ESTIMATE, FACTS, FRAMES

LOG = "log.txt"
"""File with all that a system prints."""
_WATCH_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """Time and memory of a run, and its error."""

    error: str | None
    """Why there is no estimate, in a line; None: there is one."""
    wall_s: float
    """Time on the clock, start of the process and reading included [s]."""
    cpu_s: float
    """Processor time of the process and all that it has started [s]."""
    peak_memory_mb: float
    """Largest resident memory [MB]."""
    cores: int
    """Cores that it could use."""
    version: str = ""
    """Version of the system."""
    frames: int = 0
    """Frames that should have a pose, whether it took them or not."""
    frame_median_s: float = float("nan")
    """Median time of a frame, reading left out [s]."""
    frame_p99_s: float = float("nan")
    """Time that 99 % of the frames stay below [s]."""

    @classmethod
    def of_error(cls, error: str) -> RunRecord:
        """The record of a run that never began."""
        return cls(error=error, wall_s=0.0, cpu_s=0.0, peak_memory_mb=float("nan"), cores=0)


def run_isolated(
    method: str,
    sequence: Path,
    out: Path,
    *,
    cloud: str,
    limit_s: float,
    cores: tuple[int, ...] = (),
    stop: threading.Event | None = None,
    feed: Connection | None = None,
    lidar: str | None = None,
) -> RunRecord:
    """Run a system over a sequence; its record holds how it ended, whatever happens to it.

    Nothing that it has started outlives the run, see `recorder.slam.keeper`.

    Args:
        method: Name or file of a system, see `recorder.slam.systems.system_of`.
        sequence: Folder of the sequence.
        out: Folder for ``estimate.tum``, ``frames.csv``, ``facts.json`` and ``log.txt``.
        cloud: Which points sweeps hold, see `SlamSequence`.
        limit_s: Longest time on the clock [s].
        cores: Cores that it may use; empty: all.
        stop: Ends the run when it is set.
        feed: Connection to a feed, from which it reads in place of the folder; closed here when it has it.
        lidar: Name of the LiDAR that it reads; None: the rig's first.

    Raises:
        KeyboardInterrupt: it was stopped.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name in (ESTIMATE, FACTS, FRAMES):
        (out / name).unlink(missing_ok=True)
    job = {
        "method": method,
        "sequence": str(whole_path(sequence)),
        "cloud": cloud,
        "lidar": lidar,
        "out": str(out.resolve()),
        "feed": None if feed is None else feed.fileno(),
    }
    (out / "job.json").write_text(json.dumps(job) + "\n", encoding="utf-8")
    threads = len(cores or usable_cores())
    began = time.monotonic()
    child = start_worker("worker", out / "job.json", out / LOG, threads, feed)
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(child.pid, cores)
    memory = _PeakMemory(child.pid)
    status, usage = _wait(child, began + limit_s, stop, memory)
    error = _fault(status, out / LOG, limit_s)
    return RunRecord(
        error=error,
        wall_s=time.monotonic() - began,
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak_memory_mb=memory.peak_mb,
        cores=threads,
        **(_facts(out) if error is None else {}),
    )


def start_worker(
    module: str, job: Path, log: Path, threads: int, connection: Connection | None
) -> subprocess.Popen[bytes]:
    """Start a module of `recorder.slam` in a process of its own, below a keeper.

    Args:
        module: Name of the module, ``worker`` or ``live_worker``.
        job: File with its job.
        log: File that receives all that it prints.
        threads: Threads of libraries that compute.
        connection: What it reads from; closed here when the process has it.
    """
    limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), str(threads))
    with log.open("wb") as output:
        child = subprocess.Popen(
            kept([sys.executable, "-m", f"recorder.slam.{module}", str(job.resolve())]),
            stdout=output, stderr=subprocess.STDOUT, env=os.environ | limits, start_new_session=True,
            pass_fds=() if connection is None else (connection.fileno(),),
        )  # fmt: skip
    if connection is not None:
        connection.close()
    return child


class _PeakMemory:
    """Largest resident memory of all that a process has started, asked for while it runs.

    The system's figure of an ended child includes its parent's memory: it is taken before `exec`.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self.peak_mb = float("nan")

    def look(self) -> None:
        """Ask once more; a system without ``/proc`` gives NaN."""
        now_mb = sum(_high_water_mb(pid) for pid in descendants(self._pid))
        self.peak_mb = float(np.nanmax([self.peak_mb, now_mb])) if now_mb else self.peak_mb


def _high_water_mb(pid: int) -> float:
    """Largest resident memory of one process so far [MB]; 0: it has ended."""
    with suppress(OSError, ValueError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024.0
    return 0.0


def _wait(
    child: subprocess.Popen[bytes], until: float, stop: threading.Event | None, memory: _PeakMemory
) -> tuple[int | None, Any]:
    """Exit status (None: past its limit and ended) and what the process used."""
    try:
        while True:
            memory.look()
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                child.returncode = os.waitstatus_to_exitcode(status)
                return child.returncode, usage
            if time.monotonic() > until:
                return None, _terminate(child)
            if stop is not None and stop.is_set():
                raise KeyboardInterrupt
            time.sleep(_WATCH_S)
    except BaseException:
        _terminate(child)
        raise


def _terminate(child: subprocess.Popen[bytes]) -> Any:
    """Ask a process to end all that it keeps, end it, and return what it used."""
    below = descendants(child.pid)
    child.terminate()
    until = time.monotonic() + sum(GRACE_S.values()) + 2.0
    pid, status, usage = 0, 0, None
    while not pid and time.monotonic() < until:
        time.sleep(_WATCH_S)
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
    if not pid:
        for one in (child.pid, *below):
            with suppress(ProcessLookupError):
                os.kill(one, signal.SIGKILL)
        _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    return usage


def _fault(status: int | None, log: Path, limit_s: float) -> str | None:
    """Why a run failed, by its exit status (None: its time was over) and its log; None: it did not."""
    if status is None:
        return f"ended after its time limit of {limit_s:.0f} s"
    if status < 0:
        return f"crashed by {signal.Signals(-status).name}: {last_line(log) or 'it printed nothing'}"
    if status > 0:
        error = last_line(log) or f"ended with {status} and printed nothing"
        return error.replace(f"; see {LOG}", f"; log: {log}")
    return None


def _facts(out: Path) -> dict[str, Any]:
    """Fields of the record that a run which ended well has written."""
    facts = json.loads((out / FACTS).read_text(encoding="utf-8"))
    rows = (out / FRAMES).read_text(encoding="utf-8").splitlines()[1:]
    times = np.array([float(row.split(",")[0]) for row in rows])
    record = {name: facts[name] for name in ("version", "frames")}
    if len(times):
        record |= {"frame_median_s": float(np.median(times)), "frame_p99_s": float(np.percentile(times, 99))}
    return record
