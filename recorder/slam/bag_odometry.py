"""LiDAR odometry over the point clouds of a bag, which need not lie in a dataset."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import (
    CarlaLocError,
    ConfigError,
    EvaluationError,
    MissingDependencyError,
    unknown_name,
)
from recorder.dataset.layout import SEQUENCE, whole_path
from recorder.dataset.lidar_topics import lidar_topic, thinned
from recorder.dataset.reading_checks import faults_of_foreign
from recorder.dataset.scans import Progress, Scan, ScanTimes, read_scans
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.trajectory import Trajectory
from recorder.slam.system import MIDDLE, FrameClock, StampedPose, System, trajectory_of
from recorder.slam.systems import SYSTEMS

_LOG = logging.getLogger(__name__)

METHODS = {name: name for name, system in SYSTEMS.items() if system.needs == ("lidar",)} | {
    "gicp": "small_gicp"
}
"""Names on the command line, and the systems that they mean: those that need nothing but sweeps."""


_TRAVELLED_M, _STILL_SHARE, _TURNED_RAD = 1.0, 0.4, 0.2
"""Least way of clouds [m], and greatest share and turn of the estimate, by which clouds look registered."""


@dataclass(slots=True)
class BagScans:
    """Sweeps of one topic of a bag, as runners of systems read them.

    Args:
        bag: A bag as `open_bag` takes it.
        topic: Topic of the point clouds; None: as `read_scans` chooses.
        times: Settings of the times of points.
        progress: Called after every scan.
    """

    bag: Path
    topic: str | None
    times: ScanTimes = field(default_factory=ScanTimes)
    progress: Progress = lambda *_: None
    stamps_ns: list[int] = field(default_factory=list, init=False)
    """Times of the first points of the scans that were read [ns]."""
    spans_s: list[float] = field(default_factory=list, init=False)
    """Times of their last points after that [s]."""
    middles_m: list[NDArray[np.float64]] = field(default_factory=list, init=False)
    """Medians of their points [m], each of shape (3,)."""

    def scans(self) -> Iterator[Scan]:
        """All sweeps that have points.

        Raises:
            EvaluationError: the bag is damaged or has no such topic, or a cloud lacks a field.
        """
        number = 0
        for number, (count, scan) in enumerate(read_scans(self.bag, self.topic, self.times), start=1):
            if len(scan.points_xyz_m):
                self.stamps_ns.append(scan.stamp_ns)
                self.spans_s.append(float(scan.time_s.max()))
                self.middles_m.append(np.median(thinned(scan.points_xyz_m), axis=0))
                yield scan
            self.progress(number, count)
        if empty := number - len(self.stamps_ns):
            _LOG.warning("%s: %d of %d clouds have no points and are left out", self.bag, empty, number)

    @property
    def has_times(self) -> bool:
        """Whether the points have times."""
        return any(self.spans_s)

    @property
    def sweep_s(self) -> float:
        """Length of a sweep [s]: the median interval, or the time up to its last point where that is another.

        Raises:
            EvaluationError: there are less than two scans.
        """
        if len(self.stamps_ns) < 2:
            raise EvaluationError(f"{self.bag} has no two point clouds; name another topic or a longer bag")
        interval_s = median(after - before for before, after in pairwise(self.stamps_ns)) / 1e9
        span_s = median(self.spans_s)
        # A sensor that turns all the time leaves out no more than the returns of a few columns.
        return span_s if self.has_times and not 0.9 < span_s / interval_s < 1.1 else interval_s


def system_of_bags(method: str) -> System:
    """The system of a name of `METHODS`.

    Raises:
        ConfigError: there is no such method.
        MissingDependencyError: its library is not installed.
    """
    if method not in METHODS:
        other = f"; of datasets: carlaloc benchmark DATA --methods {method}" if method in SYSTEMS else ""
        raise ConfigError(unknown_name("method of bags", method, METHODS) + other)
    system = SYSTEMS[METHODS[method]]
    if system.missing:
        raise MissingDependencyError(system.missing)
    return system


def clouds_of(bag: Path, lidar: str | None, topic: str | None) -> tuple[str | None, str]:
    """Name of the LiDAR whose clouds are read, where a dataset tells it, and their topic.

    Args:
        bag: The bag.
        lidar: Name of a LiDAR of its dataset's rig; None: the first.
        topic: Topic that is read instead; None: that of the LiDAR, else as `read_scans` chooses.

    Raises:
        EvaluationError: there is no such LiDAR, or no dataset that has one, or no topic to choose.
    """
    if topic is not None:
        return None, topic
    folder = next((path for path in whole_path(bag).parents[:2] if (path / SEQUENCE).is_file()), None)
    try:
        if folder is None:
            raise EvaluationError(f"{bag} lies in no dataset, which would name its LiDARs; give --topic")
        sequence = SlamSequence(folder, lidar=lidar)
        return sequence.lidar.name, sequence.cloud_topic
    except CarlaLocError:
        if lidar is not None:
            raise
        return None, lidar_topic(bag)


def run_odometry(
    bag: str | Path,
    method: str,
    topic: str | None = None,
    progress: Progress = lambda *_: None,
    *,
    times: ScanTimes | None = None,
) -> Trajectory:
    """Poses of the LiDAR that a system estimates from a bag, at the instants of sweeps that they belong to.

    Without times of points nothing corrects the motion during a sweep, whose middle such clouds show best.

    Args:
        bag: A file of ROS 1, MCAP or SQLite, or the folder of a bag of ROS 2.
        method: Name of one of `METHODS`.
        topic: Topic of the point clouds, as in `read_scans`; None: that of our bags, else the only one that
            looks like a LiDAR's.
        progress: Called after every scan with the scans done and their total.
        times: Settings of the times of points; None: as the clouds show them.

    Raises:
        ConfigError: there is no such method, or no such unit of time.
        MissingDependencyError: its library is not installed.
        EvaluationError: the bag is damaged or has no such topic.
    """
    bag = Path(bag)
    system = system_of_bags(method)
    for fault in faults_of_foreign(bag):
        _LOG.warning("%s: %s", bag, fault)
    module, function = system.runner.split(":")
    source = BagScans(bag, topic, times or ScanTimes(), progress)
    poses = list(getattr(import_module(module), function)(source, FrameClock()))
    offset_ns = round((system.instant if source.has_times else MIDDLE) * source.sweep_s * 1e9)
    _warn_of_registered(source, poses)
    return trajectory_of(poses, offset_ns, method)


def _warn_of_registered(source: BagScans, poses: Sequence[StampedPose]) -> None:
    """Report clouds that travel while the estimate stays: they are in a fixed frame already."""
    some = max(1, len(source.middles_m) // 10)
    first, last = (np.mean(part, axis=0) for part in (source.middles_m[:some], source.middles_m[-some:]))
    travelled_m = float(np.linalg.norm(last - first))
    T = np.linalg.inv(poses[0][1]) @ poses[-1][1]
    moved_m, is_turned = float(np.linalg.norm(T[:3, 3])), np.trace(T[:3, :3]) < 1 + 2 * np.cos(_TURNED_RAD)
    if travelled_m > _TRAVELLED_M and moved_m < _STILL_SHARE * travelled_m and not is_turned:
        _LOG.warning(
            "%s: clouds travel by %.1f m while the estimate moves by %.1f m: they look registered already; "
            "--topic names the sensor's own", source.bag, travelled_m, moved_m,
        )  # fmt: skip
