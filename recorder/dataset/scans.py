"""Point clouds of bags, as LiDAR odometry systems take them."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from carlaloc_env.core.errors import EvaluationError, unknown_name
from recorder.bags import open_bag, refused_in_one_line
from recorder.dataset.clouds import (
    LIVOX,
    POINT_CLOUD,
    READ,
    Cloud,
    check_livox,
    cloud_of_fields,
    cloud_of_livox,
)
from recorder.dataset.point_times import NO_TIMES, TimeRule, time_rule

_LOG = logging.getLogger(__name__)

DEFAULT_TOPIC = "/lidar/points"
"""Topic of the clouds of our bags."""
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

    @property
    def deskew_time_s(self) -> NDArray[np.float64]:
        """Times for the correction of motion [s], shape (N,); empty: none, or all the same."""
        known = self.time_s.max(initial=-np.inf) > self.time_s.min(initial=np.inf)
        return self.time_s if known else self.time_s[:0]

    def take(self, rows: NDArray[np.bool_]) -> Scan:
        """Some of the points."""

        def part(values: Any) -> Any:
            return None if values is None else values[rows]

        return replace(
            self,
            points_xyz_m=self.points_xyz_m[rows],
            time_s=self.time_s[rows],
            ring=part(self.ring),
            intensity=part(self.intensity),
            tag=part(self.tag),
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
        topic: Topic of `sensor_msgs/PointCloud2` or Livox's `CustomMsg`; None: ``/lidar/points`` if there are
            clouds on it, else the only one.
        times: Rule by which times are read, or options for choosing it by the first clouds.

    Raises:
        EvaluationError: the bag is missing or damaged, has no such topic, or a cloud lacks x, y, z.
        ConfigError: there is no such unit of time.
    """
    with open_bag(bag) as reader:
        chosen = cloud_connections(bag, reader.connections, topic)
        count = sum(connection.msgcount for connection in chosen)
        field = times.field if isinstance(times, ScanTimes) else None
        clouds = _clouds(bag, reader, chosen, None if field == NO_TIMES else field)
        for scan in scans_of(clouds, f"{bag}: {chosen[0].topic}", times):
            yield count, scan


def cloud_connections(bag: Path, connections: Sequence[Connection], topic: str | None) -> list[Connection]:
    """Connections of the topic whose clouds are read.

    Raises:
        EvaluationError: there is none, or several that may be meant.
    """
    fitting = [c for c in connections if c.msgtype == POINT_CLOUD or LIVOX.fullmatch(c.msgtype)]
    topics = sorted({c.topic for c in fitting if c.msgcount})
    if topic is None and (DEFAULT_TOPIC in topics or len(topics) == 1):
        topic = DEFAULT_TOPIC if DEFAULT_TOPIC in topics else topics[0]
    if topic is None and topics:
        raise EvaluationError(f"{bag} has several topics with clouds; choose by --topic: {', '.join(topics)}")
    chosen = [c for c in fitting if c.topic == topic]
    if chosen:
        return chosen
    others = {c.topic: c.msgtype for c in connections if topic in (None, c.topic)}
    if topic is not None and not others:
        raise EvaluationError(f"{bag}: {unknown_name('topic with point clouds', topic, topics)}")
    found = ", ".join(f"{name} is {kind}" for name, kind in sorted(others.items(), key=_unlike_a_cloud))
    raise EvaluationError(f"{bag}: no point clouds that are read here ({READ}); {found or 'it is empty'}")


def _unlike_a_cloud(item: tuple[str, str]) -> tuple[bool, str]:
    return not re.search("scan|packet|cloud|lidar|laser", item[1], re.IGNORECASE), item[0]


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
    livox = connections[0].msgtype.replace("CustomMsg", "CustomPoint")
    if livox != POINT_CLOUD and (defined := reader.typestore.fielddefs.get(livox)):
        check_livox([name for name, _ in defined[1]])
    with refused_in_one_line(bag):
        for connection, recorded_ns, raw in reader.messages(connections=connections):
            if connection.msgtype == POINT_CLOUD:
                message = reader.deserialize(raw, POINT_CLOUD)
                yield recorded_ns, cloud_of_fields(message, time_field)
            else:
                yield recorded_ns, cloud_of_livox(raw, is_cdr=reader.is2, time_field=time_field)


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
    )
    timed = np.isfinite(time_s)
    return scan if timed.all() else scan.take(timed)
