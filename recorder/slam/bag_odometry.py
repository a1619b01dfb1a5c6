"""LiDAR odometry over the point clouds of a bag, which need not lie in a dataset."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, MissingDependencyError, unknown_name
from recorder.dataset.scans import Progress, Scan, read_scans, sweep_of, trajectory_of
from recorder.evaluation.trajectory import Trajectory
from recorder.slam.system import FrameClock
from recorder.slam.systems import SYSTEMS

METHODS = {name: name for name, system in SYSTEMS.items() if system.needs == ("lidar",)} | {
    "gicp": "small_gicp"
}
"""Names on the command line, and the systems that they mean: those that need nothing but sweeps."""


@dataclass(frozen=True, slots=True)
class BagScans:
    """Sweeps of one topic of a bag, as runners of systems read them.

    Args:
        bag: ROS 1 or ROS 2 bag.
        topic: Topic of the point clouds, fields x, y, z, time.
        progress: Told of every scan that is done.
    """

    bag: Path
    topic: str
    progress: Progress | None = None

    def scans(self) -> Iterator[Scan]:
        """All sweeps.

        Raises:
            EvaluationError: the bag is damaged, or a cloud lacks a field.
        """
        for number, (count, scan) in enumerate(read_scans(self.bag, self.topic), start=1):
            yield scan
            if self.progress is not None:
                self.progress(number, count)


def run_odometry(
    bag: Path, method: str, topic: str, progress: Callable[[float, float], None] | None = None
) -> Trajectory:
    """Poses of the LiDAR that a system estimates from a bag.

    Args:
        bag: ROS 1 or ROS 2 bag.
        method: Name of one of `METHODS`.
        topic: Topic of the point clouds.
        progress: Told after every scan how many seconds of how many are done.

    Raises:
        ConfigError: there is no such method.
        MissingDependencyError: its library is not installed.
        EvaluationError: the bag is damaged or has no such topic.
    """
    if method not in METHODS:
        raise ConfigError(unknown_name("method", method, METHODS))
    sweep_s = sweep_of(bag, topic)

    def tell(done: int, count: int) -> None:
        if progress is not None:
            progress(done * sweep_s, count * sweep_s)

    return _over_bag(METHODS[method], BagScans(bag, topic, tell), sweep_s, method)


def kiss_icp_odometry(
    bag: Path, topic: str, sweep_s: float, *, name: str = "KISS-ICP", progress: Progress | None = None
) -> Trajectory:
    """Poses of the LiDAR that KISS-ICP estimates from a bag, motion-compensated.

    Args:
        bag: ROS 1 or ROS 2 bag.
        topic: Topic of the point clouds, fields x, y, z, time.
        sweep_s: Length of a sweep [s]; KISS-ICP gives the pose at its end.
        name: Name of the trajectory.
        progress: Told of every scan.

    Raises:
        MissingDependencyError: KISS-ICP is not installed.
        EvaluationError: the bag has no such topic.
    """
    return _over_bag("kiss_icp", BagScans(bag, topic, progress), sweep_s, name)


def gicp_odometry(
    bag: Path, topic: str, sweep_s: float, *, name: str = "GICP", progress: Progress | None = None
) -> Trajectory:
    """Poses of the LiDAR by GICP against a map of Gaussian voxels, without motion compensation.

    Args:
        bag: ROS 1 or ROS 2 bag.
        topic: Topic of the point clouds, fields x, y, z, time.
        sweep_s: Length of a sweep [s]; an uncompensated scan shows its middle best.
        name: Name of the trajectory.
        progress: Told of every scan.

    Raises:
        MissingDependencyError: small_gicp is not installed.
        EvaluationError: the bag has no such topic.
    """
    return _over_bag("small_gicp", BagScans(bag, topic, progress), sweep_s, name)


def _over_bag(method: str, scans: BagScans, sweep_s: float, name: str) -> Trajectory:
    system = SYSTEMS[method]
    if system.missing:
        raise MissingDependencyError(system.missing)
    module, function = system.runner.split(":")
    found = getattr(import_module(module), function)(scans, FrameClock())
    offset_ns = round(system.instant * sweep_s * 1e9)
    stamps, poses = [stamp + offset_ns for stamp, _ in found], [T for _, T in found]
    return trajectory_of(stamps, poses, name, scans.bag, scans.topic)
