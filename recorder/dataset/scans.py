"""Point clouds of bags, as LiDAR odometry systems take them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from carlaloc_env.core.errors import EvaluationError
from recorder.bags.reader import messages_by_stamp, open_bag, refused_in_one_line
from recorder.dataset.clouds import Cloud, read_cloud
from recorder.dataset.lidar_topics import cloud_connections, of_one_frame
from recorder.dataset.point_times import NO_TIMES, TimeRule, time_rule

_LOG = logging.getLogger(__name__)
_LOOKED_AT = 10
"""Number of clouds with points by which the rule of times is chosen."""
Progress = Callable[[int, int], None]
"""Called with scans done and scans in all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """One point cloud as a LiDAR odometry takes it."""

    stamp_ns: int
    """Unix time of the first point [ns]."""
    points_xyz_m: NDArray[np.float64]
    """Points in the sensor frame [m], shape (N, 3)."""
    time_s: NDArray[np.float64]
    """Time of each point after `stamp_ns` [s], shape (N,); zeros: the cloud has no times."""
    ring: NDArray[np.int64] | None = None
    """Beam of each point, from below, shape (N,)."""
    intensity: NDArray[np.float64] | None = None
    """Intensity, shape (N,)."""
    tag: NDArray[np.uint8] | None = None
    """Semantic tag of each point, where the cloud is labelled, shape (N,)."""
    doppler_mps: NDArray[np.float64] | None = None
    """Rate of each range [m/s], receding positive, where the LiDAR measures it, shape (N,)."""

    @property
    def deskew_time_s(self) -> NDArray[np.float64]:
        """Times for the correction of motion [s], shape (N,); empty: none, or all the same."""
        differ = self.time_s.max(initial=-np.inf) > self.time_s.min(initial=np.inf)
        return self.time_s if differ else self.time_s[:0]

    def take(self, rows: NDArray[np.bool_]) -> Scan:
        """Scan of some of the points."""

        def part(values: Any) -> Any:
            return None if values is None else values[rows]

        return replace(
            self,
            points_xyz_m=self.points_xyz_m[rows],
            time_s=self.time_s[rows],
            ring=part(self.ring),
            intensity=part(self.intensity),
            tag=part(self.tag),
            doppler_mps=part(self.doppler_mps),
        )


class ScanSource(Protocol):
    """A source of sweeps: a sequence of a dataset, or a topic of a bag."""

    def scans(self) -> Iterator[Scan]:
        """All sweeps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanTimes:
    """The user's options for the times of points."""

    field: str | None = None
    """Field of the times, or `NO_TIMES`; None: the first with a name of times."""
    unit: str | None = None
    """Their unit, s, ms, us or ns; None: by their size."""


def read_scans(
    bag: Path, topic: str | None = None, times: TimeRule | ScanTimes = ScanTimes()
) -> Iterator[tuple[int, Scan]]:
    """Point clouds of a topic, each with the number of all.

    Args:
        bag: A bag as `open_bag` takes it.
        topic: Topic of clouds, or ``topic:frame`` where several sensors share it; None: that of our bags,
            else the only one that looks like a LiDAR's.
        times: Rule by which times are read of a topic of ours, or options for choosing it by the first ones.

    Raises:
        EvaluationError: the bag is missing or damaged, has no such topic, or a cloud lacks x, y, z.
        ConfigError: there is no such unit of time.
    """
    with open_bag(bag) as reader:
        chosen, frame = cloud_connections(bag, reader, topic, is_ours=isinstance(times, TimeRule))
        count = sum(connection.msgcount for connection in chosen)
        field = times.field if isinstance(times, ScanTimes) else None
        clouds = _clouds(bag, reader, chosen, None if field == NO_TIMES else field)
        where = f"{bag}: {chosen[0].topic}"
        for scan in scans_of(of_one_frame(clouds, where, frame), where, times):
            yield count, scan


def scans_of(
    clouds: Iterator[tuple[int, Cloud]], where: str, times: TimeRule | ScanTimes = ScanTimes()
) -> Iterator[Scan]:
    """Clouds with the times of their points.

    Args:
        clouds: Clouds, each with the Unix time at which it was recorded [ns].
        where: Bag and topic, for notes and errors.
        times: Rule by which times are read, or options for choosing it by the first clouds.

    Raises:
        EvaluationError: times are missing in a cloud, or are not numbers.
        ConfigError: there is no such unit of time.
    """
    has_stamps = True
    if isinstance(times, ScanTimes):
        first, seen = [], 0
        while seen < _LOOKED_AT and (item := next(clouds, None)) is not None:
            first.append(item)
            seen += bool(len(item[1].points_xyz_m))
        has_stamps = len(first) < 2 or len({cloud.stamp_ns for _, cloud in first}) > 1
        if not has_stamps:
            _LOG.warning("%s: headers have no stamps; the times of the recording are taken", where)
        rule = time_rule(
            [cloud if has_stamps else replace(cloud, stamp_ns=at) for at, cloud in first],
            where, field=times.field, unit=times.unit,
        )  # fmt: skip
        clouds = chain(first, clouds)
    else:
        rule = times
    for recorded_ns, cloud in clouds:
        yield _scan(cloud if has_stamps else replace(cloud, stamp_ns=recorded_ns), rule, where)


def _clouds(
    bag: Path, reader: AnyReader, connections: list[Connection], time_field: str | None
) -> Iterator[tuple[int, Cloud]]:
    with refused_in_one_line(bag):
        for connection, recorded_ns, raw in messages_by_stamp(reader, connections):
            yield recorded_ns, read_cloud(reader, connection, raw, time_field)


def _scan(cloud: Cloud, rule: TimeRule, where: str) -> Scan:
    try:
        stamp_ns, time_s = rule.read(cloud)
    except (ValueError, OverflowError) as error:
        raise EvaluationError(
            f"{where}: a cloud's times of points are no numbers; --time-field none leaves them out"
        ) from error
    if not 0 <= stamp_ns < 2**63:
        raise EvaluationError(
            f"{where}: a cloud's time is {stamp_ns / 1e9:.6g} s; --time-field none leaves them out"
        )
    scan = Scan(
        stamp_ns=stamp_ns,
        points_xyz_m=cloud.points_xyz_m,
        time_s=time_s,
        ring=cloud.ring,
        intensity=cloud.intensity,
        tag=cloud.tag,
        doppler_mps=cloud.doppler_mps,
    )
    timed = np.isfinite(time_s)
    return scan if timed.all() else scan.take(timed)
