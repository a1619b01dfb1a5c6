"""Point clouds of bags, as LiDAR odometry systems take them.

Times of the points of clouds: which field they are, in which unit, and after which instant they count.

Drivers differ: seconds after the header's stamp, before it where that is the sweep's end, nanoseconds since
1970, a clock inside the sensor. The first clouds of a topic decide: times that restart in each cloud are
relative, times that advance with the headers are absolute, and their range shows their unit.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import chain, pairwise
from pathlib import Path
from statistics import median
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from carlaloc_env.core.errors import ConfigError, EvaluationError, unknown_name
from recorder.bags import messages_by_stamp, open_bag, refused_in_one_line
from recorder.dataset.clouds import (
    CLOUD,
    DEFAULT_TOPICS,
    Cloud,
    doubt_of,
    of_one_frame,
    read_cloud,
    unit_in_name,
    without_clouds,
)

UNITS_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1000, "ns": 1}
"""Units of times [ns]."""
NO_TIMES = "none"
"""Stands for a field: clouds are read without times."""

_SWEEP_NS = 100_000_000
"""Length of a sweep where there is a single cloud."""
_DRIVER_NS = 1_000_000_000
"""Longest time between points and the header's stamp, if both have the same clock."""
_SWEEP_SHARES = (0.05, 1.5)
"""Least and greatest length of a sweep, as a share of the time between clouds."""
_BEGIN_SHARE = 0.1
"""How much of a sweep may pass before its first return, where the header's stamp is its beginning."""


class Since(Enum):
    """Zero of the times of points."""

    HEADER = "the header's stamp, at which the sweep begins"
    AROUND_HEADER = "the header's stamp, wherever in the sweep it lies"
    EPOCH = "the zero of the clock that the headers have, too"
    OTHER_CLOCK = "the zero of another clock; the header's stamp is the first point's"


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeRule:
    """How times of points are read."""

    field: str | None = None
    """Field of the clouds; None: they have no times."""
    unit_ns: int = UNITS_NS["s"]
    """Unit of the field [ns]."""
    since: Since = Since.HEADER

    def read(self, cloud: Cloud) -> tuple[int, NDArray[np.float64]]:
        """Unix time of the first point [ns], and times of all after it [s], shape (N,); zeros without times.

        Where times count from the sweep's beginning, its time stands for the first point's.

        Raises:
            EvaluationError: the cloud lacks the field, or its times are not numbers.
        """
        count = len(cloud.points_xyz_m)
        if self.field is None or not count:
            return cloud.stamp_ns, np.zeros(count)
        if self.field not in cloud.times:
            raise EvaluationError(f"a point cloud has no field {self.field}, which the first ones have")
        raw, unit_s = cloud.times[self.field], self.unit_ns * 1e-9
        if self.since is Since.HEADER:
            return cloud.stamp_ns, raw.astype(np.float64) * unit_s
        first = np.fmin.reduce(raw)
        time_s = (raw - first).astype(np.float64) * unit_s
        if self.since is Since.OTHER_CLOCK:
            return cloud.stamp_ns, time_s
        first_ns = round(first.item() * self.unit_ns)
        return first_ns + (cloud.stamp_ns if self.since is Since.AROUND_HEADER else 0), time_s


def time_rule(
    clouds: Sequence[Cloud], where: str, *, field: str | None = None, unit: str | None = None
) -> TimeRule:
    """How the times of a topic's clouds are read, by its first ones; uncertain guesses are logged.

    Args:
        clouds: The first clouds; two or more distinguish relative from absolute times.
        where: Bag and topic, for the log.
        field: Field of the times, or `NO_TIMES`; None: the first with a name of times.
        unit: One of `UNITS_NS`; None: by the size of the times.

    Raises:
        ConfigError: there is no such unit.
    """
    if unit is not None and unit not in UNITS_NS:
        raise ConfigError(unknown_name("unit of time", unit, UNITS_NS))
    clouds = [cloud for cloud in clouds if len(cloud.points_xyz_m)]
    names = [name for name in clouds[0].times if all(name in c.times for c in clouds)] if clouds else []
    for name in names:
        seen = [found for cloud in clouds if (found := _seen(cloud, name))]
        if len(seen) == len(clouds) and median(high - low for low, high in seen) > 0:
            return _rule(clouds, name, seen, unit, where)
    if clouds and field != NO_TIMES:
        why = (
            f"field {names[0]} is the same in all points"
            if names
            else f"fields {', '.join(clouds[0].fields)}"
        )
        _LOG.warning(
            "%s: points have no times (%s): no motion correction, poses are those of the sweeps' middles; "
            "--time-field names a field of times",
            where, why,
        )  # fmt: skip
    return TimeRule()


def _seen(cloud: Cloud, name: str) -> tuple[float, float] | None:
    """First and last time of a cloud as they stand there, whole numbers exactly; None: it has none."""
    raw = cloud.times[name]
    raw = raw[np.isfinite(raw)]
    return (raw.min().item(), raw.max().item()) if len(raw) else None


def _rule(
    clouds: Sequence[Cloud], name: str, seen: Sequence[tuple[float, float]], unit: str | None, where: str
) -> TimeRule:
    lows = [low for low, _ in seen]
    span = median(high - low for low, high in seen)
    steps = [after - before for before, after in pairwise(lows)]
    headers = [cloud.stamp_ns for cloud in clouds]
    between = [b - a for a, b in pairwise(headers) if b > a]
    interval_ns = median(between) if between else _SWEEP_NS
    runs_on = median(map(abs, steps)) > 0.5 * span if steps else abs(lows[0]) > 100 * span
    is_float = clouds[0].times[name].dtype.kind == "f"
    unit = unit or unit_in_name(name)
    if unit is None and runs_on:
        fits = (median(steps), interval_ns, (0.5, 2.0)) if steps else (lows[0], headers[0], (0.5, 2.0))
        unit = _unit(name, *fits, is_float, where, is_certain=True)
    elif unit is None:
        unit = _unit(name, span, interval_ns, _SWEEP_SHARES, is_float, where)
    unit_ns = UNITS_NS[unit]
    since = _since([low * unit_ns for low in lows], span * unit_ns, headers, runs_on)
    if since is Since.OTHER_CLOCK:
        away_s = median(low * unit_ns - at for low, at in zip(lows, headers, strict=True)) * 1e-9
        _LOG.warning(
            "%s: times of the points (field %s) are of another clock, %+.3f s from the headers': "
            "a header's stamp is taken for the first point's time", where, name, away_s,
        )  # fmt: skip
    return TimeRule(field=name, unit_ns=unit_ns, since=since)


def _unit(
    name: str, raw: float, real_ns: float, shares: tuple[float, float], is_float: bool, where: str,
    *, is_certain: bool = False,
) -> str:  # fmt: skip
    """The unit in which a time is a fitting share of a known time, else its datatype's usual unit."""
    least, most = shares
    usual = "s" if is_float else "ns"
    fitting = [u for u, ns in UNITS_NS.items() if least * real_ns <= raw * ns <= most * real_ns]
    short = [u for u, ns in UNITS_NS.items() if abs(raw) * ns <= most * real_ns]
    unit = fitting[0] if fitting else usual if usual in short or not short else short[0]
    if not fitting or not (is_certain or unit == usual):
        _LOG.warning(
            "%s: times of the points (field %s) are read as %s; --time-unit sets another", where, name, unit
        )
    return unit


def _since(lows_ns: Sequence[float], span_ns: float, headers_ns: Sequence[int], runs_on: bool) -> Since:
    if runs_on:
        away_ns = median(low - at for low, at in zip(lows_ns, headers_ns, strict=True))
        return Since.EPOCH if abs(away_ns) <= _DRIVER_NS else Since.OTHER_CLOCK
    if all(0 <= low <= _BEGIN_SHARE * span_ns for low in lows_ns):
        return Since.HEADER
    return Since.AROUND_HEADER if abs(median(lows_ns)) <= _DRIVER_NS else Since.OTHER_CLOCK


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


def cloud_connections(
    bag: Path, reader: AnyReader, wanted: str | None, *, is_ours: bool = False
) -> tuple[list[Connection], str]:
    """Connections of the topic whose clouds are read, and the frame of those that count (empty: any).

    Args:
        bag: The bag as the user named it.
        reader: It, open.
        wanted: Topic, or ``topic:frame`` where sensors share it; None: the one that looks like a LiDAR's.
        is_ours: Whether the topic is known to be a LiDAR's.

    Raises:
        EvaluationError: there is none, or there are several that may be meant.
    """
    topics: dict[str, list[Connection]] = {}
    for connection in reader.connections:
        if CLOUD.fullmatch(connection.msgtype):
            topics.setdefault(connection.topic, []).append(connection)
    if wanted is not None:
        topic, _, frame = wanted.partition(":")
        if topic not in topics:
            raise EvaluationError(without_clouds(bag, reader.connections, topic, sorted(topics)))
        if not is_ours and (doubt := doubt_of(bag, reader, topics[topic], frame)):
            _LOG.warning("%s: %s is read as asked for, but %s", bag, topic, doubt)
        return topics[topic], frame
    topics = {topic: found for topic, found in sorted(topics.items()) if any(c.msgcount for c in found)}
    doubts: dict[str, str] = {}
    for topic in sorted(topics, key=lambda topic: topic not in DEFAULT_TOPICS):
        doubts[topic] = doubt_of(bag, reader, topics[topic], "")
        if topic in DEFAULT_TOPICS and not doubts[topic]:
            return topics[topic], ""
    fitting = [topic for topic in topics if not doubts[topic]]
    others = "; ".join(f"{topic}: {doubts[topic]}" for topic in topics if doubts[topic])
    if not topics:
        raise EvaluationError(without_clouds(bag, reader.connections, None, []))
    if not fitting:
        raise EvaluationError(f"{bag}: no topic is surely a LiDAR's; --topic takes one even so ({others})")
    if len(fitting) > 1:
        names = ", ".join(fitting)
        raise EvaluationError(f"{bag} has several topics with clouds; choose by --topic: {names}")
    if others:
        _LOG.warning("%s: %s is read, --topic names another (%s)", bag, fitting[0], others)
    return topics[fitting[0]], ""


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
    )
    timed = np.isfinite(time_s)
    return scan if timed.all() else scan.take(timed)
