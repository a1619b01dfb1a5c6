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
    """Poses of the LiDAR that a system estimates from a bag, at the instants of sweeps that they belong to.

    Args:
        bag: ROS 1 or ROS 2 bag.
        method: Name of one of `METHODS`.
        topic: Topic of the point clouds, fields x, y, z, time.
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

    system = SYSTEMS[METHODS[method]]
    if system.missing:
        raise MissingDependencyError(system.missing)
    module, function = system.runner.split(":")
    found = getattr(import_module(module), function)(BagScans(bag, topic, tell), FrameClock())
    offset_ns = round(system.instant * sweep_s * 1e9)
    stamps, poses = [stamp + offset_ns for stamp, _ in found], [T for _, T in found]
    return trajectory_of(stamps, poses, method, bag, topic)
