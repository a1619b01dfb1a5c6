"""Finds the times of the points of clouds: which field they are, in which unit, and after which instant.

Drivers differ: seconds after the header's stamp or before it, nanoseconds since 1970, a clock inside the
sensor. The first clouds of a topic decide: relative times restart in each, absolute ones follow the headers.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from statistics import median

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import ConfigError, EvaluationError, unknown_name
from recorder.dataset.clouds import Cloud, unit_in_name

_LOG = logging.getLogger(__name__)
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
    """Field, unit and zero by which times of points are read."""

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
    """Rule for the times of a topic's clouds, by its first ones; uncertain guesses are logged.

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
        seen = [span for cloud in clouds if (span := _seen(cloud, name))]
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
