"""Finds the columns of times, positions and attitudes in a table, by a header's names, else by place."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array

_POSITIONS = {"p", "pos", "position", "t", "trans", "translation", "location", "pose", "xyz"}
_ATTITUDES = {"q", "quat", "quaternion", "o", "ori", "orient", "orientation", "rot", "rotation", "attitude"}
_OTHERS = {
    "v", "vel", "velocity", "twist", "lin", "linear", "ang", "angular", "a", "acc", "accel", "acceleration",
    "w", "omega", "gyro", "b", "bias", "bg", "ba", "bw", "cov", "covariance", "std", "sigma", "var", "err",
    "error", "mag", "gravity",
}  # fmt: skip
"""What x, y, z may be of. The last such word of a name counts; of letters, which may be frames, the first."""
_TIMES = ("timestamps", "t", "ts", "epoch")
_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosec", "nanosecs", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("cm", "mm", "km"), "other length"),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("rad", "radian", "radians"), "rad"),
}
_TIME_UNITS = ("s", "ms", "us", "ns")
_TURNS = ("roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseColumns:
    """Places of a pose's parts in the rows of a table."""

    stamp: int
    """Time."""
    position: tuple[int, ...]
    """x, y, z [m]."""
    attitude: tuple[int, ...]
    """Quaternion, or roll, pitch, yaw; empty: there is none."""
    form: str
    """What a row is, for errors."""
    nanosecond: int | None = None
    """Nanoseconds beside whole seconds."""
    time_unit: str | None = None
    """Unit of the time, where the header names it."""
    order: str | None = None
    """``xyzw`` or ``rpy``; None: a quaternion as it stands, of unknown order."""
    angle_unit: str | None = None
    """``deg`` or ``rad`` of roll, pitch, yaw, where the header names it."""
    note: str | None = None
    """What is remarkable about the choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Name:
    words: tuple[str, ...]
    unit: str | None

    @staticmethod
    def of(text: str) -> _Name:
        bracket = re.search(r"[\[(]\s*([^\])]*?)\s*[\])]", text)
        bare = re.sub(r"[\[(].*?[\])]", "", text).replace("°", " deg")
        parts = re.split(r"[^a-z0-9µμ]+", re.sub(r"([a-z])([A-Z])", r"\1_\2", bare).lower())
        words = [part for part in parts if part]
        unit = _UNITS.get(bracket[1].lower()) if bracket else None
        # A time may be called by its unit alone, as in "header.stamp.secs" or "nsec".
        if unit is None and words and words[-1] in _UNITS and (len(words) > 1 or len(words[0]) > 1):
            unit = _UNITS[words.pop()]
        return _Name(words=tuple(words), unit=unit)

    @property
    def is_time(self) -> bool:
        if not self.words:
            return self.unit in _TIME_UNITS
        return self.words[-1] in _TIMES or self.words[-1].endswith(("time", "stamp"))

    def axis(self) -> tuple[str, tuple[str, ...], str] | None:
        """Kind ("p", "q" or "?"), the words before the axis, and the axis."""
        if not self.words:
            return None
        *stem, last = self.words
        if last in _TURNS:
            axis = last
        elif re.fullmatch(r".*[wxyz]|q[0-3]", last):
            axis = last[-1]
            stem = [*stem, last[:-1]] if len(last) > 1 else stem
        elif re.fullmatch(r"[0-3]", last):
            axis = last
        else:
            return None
        words = [word for word in stem if word in _POSITIONS | _ATTITUDES | _OTHERS]
        long = [word for word in words if len(word) > 1]
        word = long[-1] if long else next(iter(words), None)
        if word in _OTHERS:
            return None
        if axis in _TURNS:
            return "r", tuple(stem), axis
        if not stem or word is None:
            return ("q" if axis == "w" else "p") if not stem else "?", tuple(stem), axis
        return "q" if word in _ATTITUDES else "p", tuple(stem), axis


def columns_by_name(texts: Sequence[str], sample: Array) -> PoseColumns | str:
    """Columns that a header names.

    Args:
        texts: Names of all columns.
        sample: Some rows, shape (N, len(texts)).

    Returns:
        A str: what the header does not name.
    """
    names = [_Name.of(text) for text in texts]
    groups: dict[tuple[str, tuple[str, ...]], dict[str, int]] = {}
    for place, name in enumerate(names):
        if (axis := name.axis()) is not None:
            groups.setdefault(axis[:2], {}).setdefault(axis[2], place)
    positions = _complete(groups, "p", "xyz") or _complete(groups, "?", "xyz")
    quaternions = _complete(groups, "q", "xyzw")
    numbered = _complete(groups, "q", "0123")
    turns = _complete(groups, "r", _TURNS)
    stamp = _time(names)
    # A table of positions alone has nothing that could be a part of an attitude.
    no_part = not any(kind in "qr" for kind, _ in groups)
    missing = [
        what
        for what, is_named in (
            ("time", stamp is not None),
            ("x y z", bool(positions)),
            ("qx qy qz qw or roll pitch yaw", bool(quaternions or numbered or turns) or no_part),
        )
        if not is_named
    ]
    if missing or stamp is None:
        return " and ".join(missing)
    if any(names[place].unit == "other length" for place in positions[0]):
        return "x y z in metres"
    attitude = (quaternions or numbered or turns or [()])[0]
    several = len(positions) > 1 or len(quaternions or turns) > 1
    chosen = [texts[place] for place in (stamp, *positions[0], *attitude)]
    return PoseColumns(
        stamp=stamp,
        nanosecond=_nanosecond(names, stamp, sample),
        position=positions[0],
        attitude=attitude,
        form=" ".join(chosen),
        time_unit=names[stamp].unit if names[stamp].unit in _TIME_UNITS else None,
        order="xyzw" if quaternions else None if numbered else "rpy",
        angle_unit=names[attitude[0]].unit if attitude else None,
        note=f"several poses a row; columns {', '.join(chosen)} are read" if several else None,
    )


def _complete(
    groups: dict[tuple[str, tuple[str, ...]], dict[str, int]], kind: str, axes: Sequence[str]
) -> list[tuple[int, ...]]:
    return [
        tuple(places[axis] for axis in axes)
        for (of, _), places in groups.items()
        if of == kind and all(axis in places for axis in axes)
    ]


def _time(names: Sequence[_Name]) -> int | None:
    """The measurement's stamp before any other time, seconds before their nanoseconds."""
    times = [place for place, name in enumerate(names) if name.is_time]

    def rank(place: int) -> tuple[bool, bool]:
        name = names[place]
        return not any("stamp" in word for word in name.words), name.unit == "ns"

    return min(times, key=rank, default=None)


def _nanosecond(names: Sequence[_Name], stamp: int, sample: Array) -> int | None:
    if names[stamp].unit != "s":
        return None
    for place, name in enumerate(names):
        if name.is_time and name.unit == "ns" and name.words == names[stamp].words:
            return place if _is_split(sample[:, stamp], sample[:, place]) else None
    return None


def _is_split(seconds: Array, nanoseconds: Array) -> bool:
    """Whether two columns are whole seconds and the nanoseconds after them."""
    whole = np.all(seconds == np.round(seconds)) and np.all(nanoseconds == np.round(nanoseconds))
    return bool(whole and np.all((nanoseconds >= 0) & (nanoseconds < 1e9)) and np.any(nanoseconds >= 1000))


def columns_by_place(sample: Array) -> PoseColumns | None:
    """Columns of a table without names: a time, a position, a quaternion, and before them perhaps a number.

    Four columns are a time and a position.

    Args:
        sample: Some rows, shape (N, M).

    Returns:
        None: it has too few columns.
    """
    count = sample.shape[1]
    if count == 4:
        return PoseColumns(stamp=0, position=(1, 2, 3), attitude=(), form="time x y z")
    if count < 8:
        return None
    first = 0
    nanosecond = None
    if count >= 9 and not has_units(sample[:, 4:8]) and has_units(sample[:, 5:9]):
        split = _is_split(sample[:, 0], sample[:, 1]) and not _is_running(sample[:, 0])
        nanosecond = 1 if split else None
        first = 0 if split else 1
    begin = first + 1 if nanosecond is None else 2
    return PoseColumns(
        stamp=first,
        nanosecond=nanosecond,
        position=(begin, begin + 1, begin + 2),
        attitude=(begin + 3, begin + 4, begin + 5, begin + 6),
        form=("number " if first else "") + "time tx ty tz qx qy qz qw",
        time_unit=None if nanosecond is None else "s",
        note="the first column is a running number" if first else None,
    )


def has_units(quat: Array) -> bool:
    """Whether most rows that are numbers, shape (N, 4), have length 1."""
    norm = np.linalg.norm(quat[np.isfinite(quat).all(axis=1)], axis=1)
    return len(norm) > 0 and float(np.mean(np.abs(norm - 1.0) < 0.01)) > 0.8


def _is_running(column: Array) -> bool:
    return len(column) < 2 or bool(np.all(np.diff(column) == 1.0))
