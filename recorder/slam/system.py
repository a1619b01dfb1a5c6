"""Description of a SLAM system: all that is needed to run it and to score it."""

import os
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import TypeAlias

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.transforms import matrix_to_quat, transform
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.align import Alignment
from recorder.evaluation.trajectory import Trajectory

StampedPose: TypeAlias = tuple[int, Array]
"""Stamp of the input that a pose belongs to [ns], and the pose (4, 4), system's frame to its world."""

START, MIDDLE = 0.0, 0.5
"""Instants within a sweep, as a share of its length after the first point."""
END = 1.0
"""The instant of a sweep's last point, as such a share."""


@dataclass(slots=True)
class FrameClock:
    """Times what a system does with each frame; reading the data is left out."""

    wall_s: list[float] = field(default_factory=list)
    """Wall-clock time of each frame [s]."""
    cpu_s: list[float] = field(default_factory=list)
    """CPU time of each frame, all threads of this process together [s]."""
    due: int | None = None
    """Frames that should have a pose; None: all of the sequence."""
    notes: list[str] = field(default_factory=list)
    """Notes for readers of the results, shown behind the version."""
    covariances: dict[int, Array] = field(default_factory=dict)
    """Covariance of the pose of each stamp [ns], if a system states it, (6, 6), in the pose's own axes:
    x, y, z [m], then the rotation about them [rad] (`recorder.evaluation.trajectory`)."""

    @contextmanager
    def frame(self, count: int = 1) -> Iterator[None]:
        """Around all that the system does with one frame, or with several that cannot be timed one by one."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        self.wall_s += [(time.perf_counter() - wall) / count] * count
        self.cpu_s += [(time.process_time() - cpu) / count] * count


def trajectory_of(poses: Sequence[StampedPose], offset_ns: int, name: str) -> Trajectory:
    """Poses at the instants that they belong to; those that are not finite are left out.

    Args:
        poses: Poses by the stamps of their inputs.
        offset_ns: Time from such a stamp to the instant of the pose [ns].
        name: What gave them.

    Raises:
        EvaluationError: no pose is finite.
    """
    if not poses:
        raise EvaluationError(f"{name} gave no pose")
    T = np.stack([pose for _, pose in poses])
    finite = np.isfinite(T).all(axis=(1, 2))
    if not finite.any():
        raise EvaluationError(f"{name} gave no pose that is finite")
    return Trajectory(
        stamp_ns=np.array([stamp for stamp, _ in poses], np.int64)[finite] + offset_ns,
        position_m=T[finite, :3, 3].copy(),
        quat_xyzw=matrix_to_quat(T[finite, :3, :3]),
        name=name,
    )


def stamped_poses(trajectory: Trajectory) -> list[StampedPose]:
    """The poses of a trajectory, each with its stamp."""
    poses = transform(trajectory.position_m, trajectory.quat_xyzw)
    return list(zip(trajectory.stamp_ns.tolist(), poses, strict=True))


Runner: TypeAlias = Callable[[SlamSequence, FrameClock], Iterable[StampedPose]]
"""Feeds a sequence to a system; a generator yields each pose before it takes the next frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """A SLAM system: its inputs, the meaning of its poses, and its runner."""

    name: str
    """Name on the command line."""
    title: str
    """Name in tables."""
    what: str
    """A few words on it."""
    needs: tuple[str, ...]
    """Its inputs: ``lidar``, ``imu``, ``stereo``."""
    runner: str
    """Function that feeds it, as ``module:name``, imported only in the process that runs it."""
    frame: str
    """Frame of its poses: ``lidar``, ``imu``, ``camera`` (the left one) or ``base_link``."""
    instant: float = START
    """Instant of its poses within a sweep, 0 start to 1 end."""
    instant_source: str = "image's exposure"
    """Source of that instant."""
    library: str | None = None
    """Module that brings it; None: this package."""
    package: str | None = None
    """Its name in pip."""
    extra: str = "slam"
    """Extra of this package that installs it."""
    python: str | None = None
    """Environment variable that names the Python which has the library, if not this one."""
    file: str | None = None
    """Environment variable that names a file without which it does not start."""
    file_hint: str = ""
    """How to get that file."""
    takes_seg: bool = True
    """Whether movers can be kept from it; a program that reads files gets them as they are."""
    alignment: Alignment = Alignment.SE3
    """Fit before errors are measured; never scale for stereo, LiDAR or inertial systems."""

    @property
    def is_installed(self) -> bool:
        """Whether it could run; its library is not imported for that."""
        return not self.missing

    @property
    def missing(self) -> str:
        """Missing library or file, and the next step; empty: nothing is missing."""
        if self.library is not None and not self._installed_version:
            where = f" for {os.environ[self.python]}" if self.python and os.environ.get(self.python) else ""
            return f'{self.title} is not installed{where}; pip install "carlaloc[{self.extra}]"'
        if self.file and not Path(os.environ.get(self.file, "")).is_file():
            return f"{self.title} needs a file that {self.file} names; {self.file_hint}"
        return ""

    @property
    def version(self) -> str:
        """Version of the library."""
        return self._installed_version if self.package and self._installed_version else "own"

    @property
    def _installed_version(self) -> str:
        """Version of the library; empty: it is not there."""
        other = os.environ.get(self.python) if self.python else None
        if other:
            return _version_by(other, self.package or "")
        if self.library is None or find_spec(self.library) is None:
            return ""
        return metadata.version(self.package) if self.package else "own"

    @property
    def sensor(self) -> str:
        """Sensor whose samples are frames: ``lidar`` or ``stereo``."""
        return "lidar" if "lidar" in self.needs else "stereo"

    @property
    def is_visual(self) -> bool:
        """Whether it reads images, so that weather and light matter to it."""
        return "stereo" in self.needs


@lru_cache
def _version_by(python: str, package: str) -> str:
    """Version of a package in another Python; empty: it is not there."""
    words = [python, "-c", "import importlib.metadata as m, sys; print(m.version(sys.argv[1]))", package]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=True, timeout=60).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
