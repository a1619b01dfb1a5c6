"""The process of a system by which a car drives: ``python -m recorder.slam.live_worker job.json``."""

from __future__ import annotations

import inspect
import json
import signal
import sys
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from carlaloc_env.rigs.rig import SensorRig
from recorder.dataset.live_sequence import LiveSequence
from recorder.slam.system import FrameClock
from recorder.slam.systems import system_of
from recorder.slam.worker import runner_of


def main(job_file: str) -> int:
    """Run a system until the drive ends; what went wrong is the last line on stderr."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    job = json.loads(Path(job_file).read_text(encoding="utf-8"))
    connection = Connection(job["connection"])
    try:
        system = system_of(job["method"])
        runner = runner_of(system, job["method"])
        if not inspect.isgeneratorfunction(runner):
            raise EvaluationError(
                f"{system.title} gives its poses when all is over; to drive by it, yield each pose in place "
                "of returning a list, see docs/your-system.md"
            )
        for stamp_ns, T in runner(LiveSequence(SensorRig.from_yaml(job["rig"]), connection), FrameClock()):
            connection.send((int(stamp_ns), np.asarray(T, np.float64)))
    except CarlaLocError as error:
        print(error, file=sys.stderr)  # noqa: T201
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
