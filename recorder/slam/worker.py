"""The process in which a SLAM system runs: ``python -m recorder.slam.worker job.json``.

Nothing else imports a system's library, so that its licence, its crashes and its memory stay in here.
"""

import json
import runpy
import signal
import sys
from collections.abc import Callable
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, cast

import numpy as np

from carlaloc_env.core.errors import CarlaLocError
from recorder.dataset.feed_readings import FeedReadings
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.covariance_files import SUFFIX, write_covariances
from recorder.evaluation.trajectory_files import write_tum
from recorder.slam.system import FrameClock, Runner, System, trajectory_of
from recorder.slam.system_file import is_system_file, read_system_file
from recorder.slam.systems import system_of

ESTIMATE, FRAMES, FACTS = "estimate.tum", "frames.csv", "facts.json"
"""Files that it leaves: poses, times of frames, version and counts."""


def work_process(work: Callable[[dict[str, Any]], None]) -> int:
    """Do the job whose file is named on the command line; an error is the last line on stderr."""
    # Asked to end, it ends without words: the last line of its log is the system's.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        work(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    except CarlaLocError as error:
        print(error, file=sys.stderr)  # noqa: T201
        return 1
    return 0


def run_job(job: dict[str, Any]) -> None:
    """Feed a sequence to a system and write its poses, times and version.

    Args:
        job: ``method``, ``sequence``, ``cloud``, ``lidar``, ``out`` and ``feed``, the file descriptor of the
            connection from which it reads in place of the sequence's folder, or None.

    Raises:
        CarlaLocError: the sequence lacks what the system needs, or the system gave no pose.
    """
    out = Path(job["out"])
    system = system_of(job["method"])
    readings = None if job["feed"] is None else FeedReadings(Connection(job["feed"]))
    folder, lidar = Path(job["sequence"]), job["lidar"]
    sequence = SlamSequence(folder, cloud=job["cloud"], readings=readings, lidar=lidar)
    clock, frames = FrameClock(), sequence.frames(system.sensor)
    poses = list(runner_of(system, job["method"])(sequence, clock))
    offset_ns = round(system.instant * sequence.lidar.sweep_ns) if system.sensor == "lidar" else 0
    estimate = trajectory_of(poses, offset_ns, system.title)
    write_tum(out / ESTIMATE, estimate)
    stated = [clock.covariances.get(stamp - offset_ns) for stamp in estimate.stamp_ns.tolist()]
    if clock.covariances and all(covariance is not None for covariance in stated):
        write_covariances(out / ESTIMATE, estimate, np.array(stated))
    else:
        (out / ESTIMATE).with_suffix(SUFFIX).unlink(missing_ok=True)
    rows = [f"{w:.6f},{c:.6f}" for w, c in zip(clock.wall_s, clock.cpu_s, strict=True)]
    (out / FRAMES).write_text("\n".join(["wall [s],cpu [s]", *rows]) + "\n", encoding="utf-8")
    version = ", ".join([system.version, *clock.notes])
    facts = {"version": version, "frames": frames if clock.due is None else clock.due, "poses": len(poses)}
    (out / FACTS).write_text(json.dumps(facts) + "\n", encoding="utf-8")


def runner_of(system: System, word: str) -> Runner:
    """The function that feeds a system, by the word that named the system."""
    if is_system_file(word):
        return read_system_file(Path(word)).run
    module, name = system.runner.split(":")
    runner = runpy.run_path(word)[name] if word.endswith(".py") else getattr(import_module(module), name)
    return cast(Runner, runner)


if __name__ == "__main__":
    sys.exit(work_process(run_job))
