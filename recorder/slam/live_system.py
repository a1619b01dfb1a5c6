"""A SLAM system in a process of its own that takes a drive sweep by sweep.

The process of a system by which a car drives: ``python -m recorder.slam.live_system job.json``.
"""

import inspect
import json
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import EvaluationError, MissingDependencyError
from carlaloc_env.core.files.text_files import last_line
from carlaloc_env.rigs.rig import SensorRig
from recorder.dataset.feed_readings import NEXT
from recorder.dataset.readings import ImuSample
from recorder.dataset.scans import Scan
from recorder.dataset.sequence import LiveSequence
from recorder.slam.supervisor import LOG, start_worker
from recorder.slam.system import FrameClock, StampedPose
from recorder.slam.systems import system_of
from recorder.slam.worker import runner_of, work_process


class DeadSystemError(EvaluationError):
    """A system has ended, hangs, or gives no pose that can be driven by."""


class LiveSystem(AbstractContextManager["LiveSystem"]):
    """The process of a system, in lock-step with a drive; ended at the latest with the context.

    Args:
        method: Name or ``.py`` file of a system whose function yields its poses.
        rig: Sensors of the car.
        work: Folder for its log.
        patience_s: Longest time on the clock between two answers [s].

    Raises:
        ConfigError: there is no such system.
        MissingDependencyError: it is not installed.
        EvaluationError: it reads images.
    """

    def __init__(self, method: str, rig: SensorRig, work: Path, *, patience_s: float = 60.0) -> None:
        self.system = system_of(method)
        if self.system.missing:
            raise MissingDependencyError(self.system.missing)
        if self.system.is_visual:
            raise EvaluationError(f"{self.system.title} reads images; drive by a system that reads a LiDAR")
        self._patience_s, self._log = patience_s, work / LOG
        work.mkdir(parents=True, exist_ok=True)
        self._connection, other = Pipe()
        job = {"method": str(method), "rig": rig.to_yaml(), "connection": other.fileno()}
        (work / "job.json").write_text(json.dumps(job), encoding="utf-8")
        threads = len(usable_cores())
        self._process = start_worker("live_system", work / "job.json", self._log, threads, other)
        self._is_ready = False

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()

    def feed(self, scan: Scan, inertial: Sequence[ImuSample]) -> list[StampedPose]:
        """Give a sweep, and wait until the system asks for the next; return the poses that it gave meanwhile.

        Args:
            scan: The sweep.
            inertial: Inertial samples since the last one.

        Raises:
            DeadSystemError: it has ended, or has not answered in time.
        """
        poses = [] if self._is_ready else self._answers()
        try:
            self._connection.send((scan, list(inertial)))
        except OSError:
            self._raise_ended()
        self._is_ready = False
        return poses + self._answers()

    def close(self) -> None:
        """End it; may be called twice."""
        with suppress(OSError):
            self._connection.send(None)
        self._connection.close()
        self._process.terminate()
        self._process.wait()

    def _answers(self) -> list[StampedPose]:
        poses: list[StampedPose] = []
        try:
            while self._connection.poll(self._patience_s):
                answer = self._connection.recv()
                if answer == NEXT:
                    self._is_ready = True
                    return poses
                poses.append(answer)
        except (EOFError, OSError):
            self._raise_ended()
        raise DeadSystemError(f"{self.system.title} gave no answer for {self._patience_s:g} s")

    def _raise_ended(self) -> None:
        status = self._process.wait()
        reason = last_line(self._log) or f"it ended with {status}"
        raise DeadSystemError(f"{self.system.title} has ended: {reason}; log: {self._log}")


def run_live(job: dict[str, Any]) -> None:
    """Run a system until the drive ends.

    Raises:
        CarlaLocError: there is no such system, or it gives its poses at the end alone.
    """
    connection = Connection(job["connection"])
    system = system_of(job["method"])
    runner = runner_of(system, job["method"])
    if not inspect.isgeneratorfunction(runner):
        raise EvaluationError(
            f"{system.title} returns its poses at the end; to drive by it, yield each pose in place "
            "of returning a list, see docs/your-system.md"
        )
    for stamp_ns, T in runner(LiveSequence(SensorRig.from_yaml(job["rig"]), connection), FrameClock()):
        connection.send((int(stamp_ns), np.asarray(T, np.float64)))


if __name__ == "__main__":
    sys.exit(work_process(run_live))
