"""Where a driver's pose comes from: the truth with a known error, or a SLAM system in the loop."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.transforms import from_rotation, invert, transform
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Imu, PointCloud, Sample
from recorder.dataset.readings import ImuSample
from recorder.dataset.rig_sensors import imu_of, lidar_of
from recorder.slam.live_system import DeadSystemError, LiveSystem
from recorder.slam.system import StampedPose
from recorder.streaming.frames import inertial_of, scan_of
from recorder.writers.base import DEFAULT_EPOCH_NS

_STANDING_MPS = 0.05
"""A car that has not set off yet is slower [m/s]."""


class PoseSource(Protocol):
    """Source of the pose that a driver believes."""

    def begin(self, rig: SensorRig | None) -> None:
        """Begin a drive.

        Raises:
            EvaluationError: the sensors do not serve it.
        """

    def update(self, world: DrivingWorld, samples: Sequence[Sample]) -> None:
        """Update the source with a step and its samples.

        Raises:
            DeadSystemError: there is no estimate any more.
        """

    def believed(self, T_world_base: Array) -> Array:
        """The believed pose of `base_link` for the true one, shapes (4, 4); the same array: no error."""

    def close(self) -> None:
        """End the source; may be called twice."""


class KnownError:
    """The truth, shifted.

    Args:
        lateral_m: How far left of the truth the car is believed [m].
    """

    def __init__(self, lateral_m: float = 0.0) -> None:
        self.lateral_m = lateral_m

    def begin(self, rig: SensorRig | None) -> None:
        """Do nothing."""

    def update(self, world: DrivingWorld, samples: Sequence[Sample]) -> None:
        """Do nothing."""

    def believed(self, T_world_base: Array) -> Array:
        """True pose, shifted to the car's left."""
        if not self.lateral_m:
            return T_world_base
        shifted: Array = T_world_base @ from_rotation(np.eye(3), (0.0, self.lateral_m, 0.0))
        return shifted

    def close(self) -> None:
        """Do nothing."""


class SystemPose:
    """The pose of a SLAM system that runs while the car drives.

    As long as the car stands, the system's map is laid on the world by the true pose, and never afterwards.
    Between two of its poses the belief moves as the car does.

    Args:
        method: Name or ``.py`` file of a system, as ``carlaloc benchmark --methods`` takes it.
        silence_s: Longest time of the drive without a pose [s].
        patience_s: Longest wall-clock time between two answers of the system [s].
        log: Folder of its log; None: none is kept.
    """

    def __init__(
        self, method: str, *, silence_s: float = 2.0, patience_s: float = 60.0, log: Path | None = None
    ) -> None:
        self._method, self._silence_ns, self._patience_s = method, round(silence_s * 1e9), patience_s
        self._log = log
        self._live: LiveSystem | None = None
        self._folder: TemporaryDirectory[str] | None = None

    def begin(self, rig: SensorRig | None) -> None:
        """Start the system anew."""
        self.close()
        if rig is None:
            raise EvaluationError("a SLAM system needs sensors; make the environment with rig='lidar'")
        self._folder = TemporaryDirectory() if self._log is None else None
        work = self._log or Path(self._folder.name if self._folder else "")
        self._live = LiveSystem(self._method, rig, work, patience_s=self._patience_s)
        self._system = system = self._live.system
        T_base = {"base_link": np.eye(4), "lidar": lidar_of(rig).mount.T_base_sensor}
        if "imu" in (system.frame, *system.needs):
            T_base["imu"] = imu_of(rig).mount.T_base_sensor
        self._T_frame_base = invert(T_base[system.frame])
        self._offset_ns = round(system.instant * lidar_of(rig).sweep_ns)
        self._inertial: list[ImuSample] = []
        self._T_world_map, self._T_believed_true = np.eye(4), np.eye(4)
        self._pose_ns, self._stands = 0, True
        self.estimate: list[StampedPose] = []
        """Poses of `base_link` in the system's map so far, by the time since the drive began [ns]."""

    def update(self, world: DrivingWorld, samples: Sequence[Sample]) -> None:
        """Feed the sweeps of a step, and believe the newest pose."""
        assert self._live is not None
        self._inertial += [inertial_of(sample) for sample in samples if isinstance(sample, Imu)]
        clouds: dict[int, list[PointCloud]] = {}
        for sample in samples:
            if isinstance(sample, PointCloud):
                clouds.setdefault(sample.stamp_ns, []).append(sample)
        for _, streams in sorted(clouds.items()):
            inertial, self._inertial = self._inertial, []
            for stamp_ns, T in self._live.feed(scan_of(streams), inertial):
                self._believe(world, stamp_ns - DEFAULT_EPOCH_NS + self._offset_ns, T)
        if world.now_ns - self._pose_ns > self._silence_ns:
            raise DeadSystemError(f"{self._system.title} gave no pose for {self._silence_ns / 1e9:g} s")

    def believed(self, T_world_base: Array) -> Array:
        """True pose, moved by the error of the newest estimate."""
        moved: Array = self._T_believed_true @ T_world_base
        return moved

    def close(self) -> None:
        """End the system."""
        if self._live is not None:
            self._live.close()
            self._live = None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def _believe(self, world: DrivingWorld, at_ns: int, T_map_frame: Array) -> None:
        if not np.isfinite(T_map_frame).all():
            raise DeadSystemError(f"{self._system.title} gave a pose that is not finite")
        T_map_base = T_map_frame @ self._T_frame_base
        motion = world.timeline.ego_motion([at_ns])
        T_true = transform(motion.position_m[0], motion.quat_xyzw[0])
        if self._stands or not self.estimate:
            self._T_world_map = T_true @ invert(T_map_base)
        self._stands = self._stands and abs(world.state.speed_mps) < _STANDING_MPS
        self._T_believed_true = self._T_world_map @ T_map_base @ invert(T_true)
        self._pose_ns = at_ns
        self.estimate.append((at_ns, T_map_base))
