"""The SLAM systems that can be run, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import cast

from carlaloc_env.core.errors import ConfigError, unknown_name
from recorder.evaluation.trajectory import Trajectory
from recorder.slam.scans import sweep_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """A system and where it comes from."""

    what: str
    """A few words on it."""
    library: str
    """Module that brings it."""
    runner: str
    """Function that runs it over a bag, as ``module:name``."""

    @property
    def is_installed(self) -> bool:
        """Whether its library can be imported."""
        return find_spec(self.library) is not None


METHODS = {
    "kiss_icp": Method(
        what="LiDAR odometry KISS-ICP (Vizzo et al. 2023)",
        library="kiss_icp",
        runner="recorder.slam.kiss_icp:kiss_icp_odometry",
    ),
    "gicp": Method(
        what="scan-to-map GICP of small_gicp (Koide 2024)",
        library="small_gicp",
        runner="recorder.slam.gicp:gicp_odometry",
    ),
}
"""Systems by name."""


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
    module, name = METHODS[method].runner.split(":")
    run = getattr(import_module(module), name)
    sweep_s = sweep_of(bag, topic)

    def tell(done: int, count: int) -> None:
        if progress is not None:
            progress(done * sweep_s, count * sweep_s)

    return cast(Trajectory, run(bag, topic, sweep_s, name=method, progress=tell))
