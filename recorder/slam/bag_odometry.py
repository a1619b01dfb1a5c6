"""LiDAR odometry over the point clouds of a bag, which need not lie in a dataset."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from statistics import median

from carlaloc_env.core.errors import ConfigError, EvaluationError, MissingDependencyError, unknown_name
from recorder.dataset.readings import faults_of_foreign
from recorder.dataset.scans import Progress, Scan, ScanTimes, read_scans
from recorder.evaluation.trajectory import Trajectory
from recorder.slam.system import MIDDLE, FrameClock, trajectory_of
from recorder.slam.systems import SYSTEMS

_LOG = logging.getLogger(__name__)

METHODS = {name: name for name, system in SYSTEMS.items() if system.needs == ("lidar",)} | {
    "gicp": "small_gicp"
}
"""Names on the command line, and the systems that they mean: those that need nothing but sweeps."""


@dataclass(slots=True)
class BagScans:
    """Sweeps of one topic of a bag, as runners of systems read them.

    Args:
        bag: A bag as `open_bag` takes it.
        topic: Topic of the point clouds; None: the only one.
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


def run_odometry(
    bag: Path,
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
        topic: Topic of the point clouds; None: ``/lidar/points`` if it is there, else the only one.
        progress: Called after every scan with the scans done and their total.
        times: Settings of the times of points; None: as the clouds show them.

    Raises:
        ConfigError: there is no such method, or no such unit of time.
        MissingDependencyError: its library is not installed.
        EvaluationError: the bag is damaged or has no such topic.
    """
    if method not in METHODS:
        raise ConfigError(unknown_name("method", method, METHODS))
    system = SYSTEMS[METHODS[method]]
    if system.missing:
        raise MissingDependencyError(system.missing)
    for fault in faults_of_foreign(bag):
        _LOG.warning("%s: %s", bag, fault)
    module, function = system.runner.split(":")
    source = BagScans(bag, topic, times or ScanTimes(), progress)
    found = list(getattr(import_module(module), function)(source, FrameClock()))
    offset_ns = round((system.instant if source.has_times else MIDDLE) * source.sweep_s * 1e9)
    return trajectory_of(found, offset_ns, method)
