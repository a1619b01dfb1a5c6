"""Systems that are programs of their own: a command that reads a bag or a folder and writes a trajectory."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.sequence import SlamSequence
from recorder.dataset.trajectories import read_trajectory
from recorder.evaluation.covariance_files import read_covariances
from recorder.slam.system import FrameClock, StampedPose, stamped_poses

_PATHS: dict[str, Callable[[SlamSequence], Path]] = {
    "{bag}": lambda sequence: sequence.bag,
    "{euroc}": lambda sequence: sequence.euroc,
    "{calibration}": lambda sequence: sequence.calibration,
}

_NOT_FOUND = 127
"""Exit status of a shell whose program is missing."""


def run_command(
    sequence: SlamSequence,
    clock: FrameClock,
    command: Sequence[str],
    *,
    sensor: str,
    topic: str | None = None,
) -> list[StampedPose]:
    """Poses that a program has written.

    Args:
        sequence: Its input.
        clock: Receives the run's time, shared out over the frames.
        command: Program and words; ``{bag}``, ``{euroc}`` and ``{calibration}`` in them become paths of
            the sequence, ``{out}`` the TUM file that it has to write, ``{work}`` an empty folder. Beside the
            TUM file it may write its covariances, see `recorder.evaluation.trajectory`.
        sensor: Sensor whose samples are frames: ``lidar`` or ``stereo``.
        topic: Topic of the poses in ``{out_bag}``, a ROS 1 bag that it writes in place of ``{out}``.

    Raises:
        EvaluationError: the program is not there, fails or writes nothing.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "estimate.tum" if topic is None else "estimate.bag")
        work = Path(folder, "work")
        work.mkdir()
        words = filled(command, sequence, {"{out}": out, "{out_bag}": out, "{work}": work})
        with clock.frame(sequence.frames(sensor)):
            _run_program(words)
        if not out.is_file():
            raise EvaluationError(
                f"{words[0]} ended well, but wrote no {'{out}' if topic is None else '{out_bag}'}"
            )
        if topic is None:
            written = read_trajectory(out, quaternion="xyzw")
            stated = read_covariances(out, written)
            if stated is not None:
                clock.covariances.update(zip(written.stamp_ns.tolist(), stated, strict=True))
        return poses_in(out, topic=topic)


def filled(command: Sequence[str], sequence: SlamSequence, given: Mapping[str, Path]) -> list[str]:
    """Words of a command with the paths of a sequence, and those that are given, in place of names in braces.

    Raises:
        EvaluationError: the sequence has no such path.
    """
    words = list(command)
    for name, place in given.items():
        words = [word.replace(name, str(place)) for word in words]
    for name, path in _PATHS.items():
        words = [w.replace(name, str(path(sequence))) if name in w else w for w in words]
    return words


def poses_in(file: Path, *, topic: str | None) -> list[StampedPose]:
    """Poses of a TUM file, or on a topic of a bag.

    Raises:
        EvaluationError: there are none.
    """
    return stamped_poses(read_trajectory(file, topic=topic, quaternion="xyzw"))


def program_path() -> str:
    """Folders in which programs are looked for: those of ``PATH``, then that of this Python.

    So the programs that pip put beside it are found although its environment is not activated.
    """
    return os.pathsep.join([os.environ.get("PATH", os.defpath), str(Path(sys.executable).parent)])


def _run_program(words: list[str]) -> None:
    environment = {**os.environ, "PATH": program_path()}
    try:
        subprocess.run(words, check=True, env=environment)
    except OSError as error:
        raise EvaluationError(f"cannot start {words[0]}: {error.strerror}; install it") from error
    except subprocess.CalledProcessError as error:
        if error.returncode == _NOT_FOUND:
            raise EvaluationError(
                f"{words[0]} did not find a program of its command; install it, its name is in log.txt"
            ) from error
        raise EvaluationError(f"{words[0]} ended with {error.returncode}; see log.txt") from error
