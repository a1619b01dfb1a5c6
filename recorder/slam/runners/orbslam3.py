"""ORB-SLAM3 (Campos et al., T-RO 2021; GPLv3), stereo and stereo-inertial, loop closing off.

It runs in a process of its own with a Python that may be one of its own (``orbslam3_server.py``), and gets
the calibration file that every dataset holds. The trajectory is the one that it writes at the end: of the
left camera, or with inertia of the IMU.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.text_files import read_text
from recorder.dataset.readings import StereoPair
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.system import FrameClock, StampedPose, stamped_poses

PYTHON, VOCABULARY = "CARLALOC_ORBSLAM3_PYTHON", "CARLALOC_ORBSLAM3_VOCABULARY"
"""Environment variables: the Python that has pyorbslam3, if not this one, and the vocabulary's file."""


def stereo(sequence: SlamSequence, clock: FrameClock) -> list[StampedPose]:
    """Poses of the left camera."""
    return _run_orbslam3(sequence, clock, inertial=False)


def stereo_inertial(sequence: SlamSequence, clock: FrameClock) -> list[StampedPose]:
    """Poses of the IMU; there are none before it has moved enough to start."""
    return _run_orbslam3(sequence, clock, inertial=True)


def _run_orbslam3(sequence: SlamSequence, clock: FrameClock, *, inertial: bool) -> list[StampedPose]:
    vocabulary = Path(os.environ.get(VOCABULARY, ""))
    clock.notes.append(f"vocabulary {vocabulary.name}, {_shape(vocabulary)}")
    with tempfile.TemporaryDirectory() as folder:
        settings, out = Path(folder, "settings.yaml"), Path(folder, "trajectory.txt")
        settings.write_text(_settings(sequence, inertial=inertial), encoding="utf-8")
        paths = {"vocabulary": vocabulary.resolve(), "settings": settings, "out": out}
        job = {"inertial": inertial, **{name: str(path) for name, path in paths.items()}}
        with _server(job) as server:
            for pair, samples in _fed(sequence, inertial=inertial):
                with clock.frame():
                    _tracked(server, pair, samples)
            server.stdin.close()
            started = server.stdout.readline().strip()
        if started != b"1":
            raise EvaluationError("ORB-SLAM3 never started: " + ("too little moves" if inertial else "lost"))
        if not out.is_file():
            raise EvaluationError("ORB-SLAM3 lost its map and kept none: it wrote no trajectory")
        return stamped_poses(read_tum(out))


def _settings(sequence: SlamSequence, *, inertial: bool) -> str:
    name = "orbslam3_stereo_inertial.yaml" if inertial else "orbslam3_stereo.yaml"
    text = read_text(sequence.calibration / name, "ORB-SLAM3's calibration", EvaluationError)
    return text if "loopClosing" in text else text + "\nloopClosing: 0\n"


def _shape(vocabulary: Path) -> str:
    """Branches and levels of a vocabulary, by its first line."""
    try:
        with vocabulary.open(encoding="ascii") as file:
            branches, levels, *_ = (int(word) for word in file.readline().split())
    except (OSError, ValueError) as error:
        raise EvaluationError(
            f"{VOCABULARY}: '{vocabulary}' is no vocabulary; name ORBvoc.txt or one of `carlaloc vocabulary`"
        ) from error
    return f"{branches}^{levels} words"


def _fed(sequence: SlamSequence, *, inertial: bool) -> Iterator[tuple[StereoPair, Array]]:
    """Images, each with the inertial samples since the last: time [s], gyroscope, accelerometer."""
    none = np.zeros((0, 7))
    if not inertial:
        for pair in sequence.stereo_pairs():
            yield pair, none
        return
    samples = list(sequence.imu_samples())
    stamp_ns = np.array([sample.stamp_ns for sample in samples])
    table = np.array([[s.stamp_ns * 1e-9, *s.angular_velocity_radps, *s.acceleration_mps2] for s in samples])
    begin = 0
    for pair in sequence.stereo_pairs():
        end = int(np.searchsorted(stamp_ns, pair.stamp_ns, side="right"))
        yield pair, table[begin:end]
        begin = end


@contextmanager
def _server(job: dict[str, Any]) -> Iterator[Any]:
    program = Path(__file__).with_name("orbslam3_server.py")
    words = [os.environ.get(PYTHON) or sys.executable, str(program)]
    server: Any = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        with suppress(BrokenPipeError):
            server.stdin.write(json.dumps(job).encode() + b"\n")
            server.stdin.flush()
        if server.stdout.readline() != b"ready\n":
            raise EvaluationError(f"ORB-SLAM3 does not start, exit status {server.wait()}; see log.txt")
        yield server
        if server.wait():
            raise EvaluationError(f"ORB-SLAM3 ended with {server.returncode}; see log.txt")
    finally:
        server.kill()
        server.wait()


def _tracked(server: Any, pair: StereoPair, samples: Array) -> None:
    head = {"size": pair.left.shape, "samples": len(samples), "time_s": pair.stamp_ns * 1e-9}
    try:
        server.stdin.write(json.dumps(head).encode() + b"\n" + samples.tobytes())
        server.stdin.write(pair.left.tobytes() + pair.right.tobytes())
        server.stdin.flush()
    except BrokenPipeError:
        raise EvaluationError(f"ORB-SLAM3 ended with {server.wait()}; see log.txt") from None
    if not server.stdout.readline():
        raise EvaluationError(f"ORB-SLAM3 ended with {server.wait()}; see log.txt")
