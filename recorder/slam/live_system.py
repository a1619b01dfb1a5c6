"""Runs a SLAM system in a separate process, which takes a drive sweep by sweep."""

import json
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing import Pipe
from pathlib import Path

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import EvaluationError, MissingDependencyError
from carlaloc_env.core.files.text_files import last_line
from carlaloc_env.rigs.rig import SensorRig
from recorder.dataset.feed_readings import NEXT
from recorder.dataset.readings import ImuSample
from recorder.dataset.scans import Scan
from recorder.slam.supervisor import LOG, start_worker
from recorder.slam.system import StampedPose
from recorder.slam.systems import system_of


class DeadSystemError(EvaluationError):
    """A system has ended, hangs, or gives no pose that can be driven by."""


class LiveSystem:
    """The process of a system, in lock-step with a drive.

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
        self._process = start_worker("live_worker", work / "job.json", self._log, threads, other)
        self._is_ready = False

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
