"""The process of a system by which a car drives: ``python -m recorder.slam.live_worker job.json``."""

import inspect
import sys
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.rigs.rig import SensorRig
from recorder.dataset.live_sequence import LiveSequence
from recorder.slam.system import FrameClock
from recorder.slam.systems import system_of
from recorder.slam.worker import runner_of, work_process


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
