"""Elevation along a road: straight grades joined by parabolic vertical curves."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from .newton import PlanError

Record = tuple[float, float, float, float, float]
"""s, a, b, c, d of z = a + b·ds + c·ds² + d·ds³."""


@dataclass(frozen=True, slots=True)
class Climb:
    """One steady grade between two level ends."""

    grade: float
    k_m: float
    """Length of the vertical curves per per cent of grade change [m/%]."""
    centre: float = 0.5
    """Where the middle of the climb lies, as a part of the road's length."""


@dataclass(frozen=True, slots=True)
class Dip:
    """Down and up again under something, with level ends."""

    bottom_m: float
    """Height of the lowest point [m]."""
    grade: float
    k_m: float
    x: float
    y: float
    """The lowest point in the plan [m]."""


def level(z: float) -> list[Record]:
    """Constant height."""
    return [(0.0, z, 0.0, 0.0, 0.0)]


def smooth(z0: float, z1: float, length: float) -> list[Record]:
    """One cubic with level ends; its steepest grade is 1.5·Δz/length."""
    rise = z1 - z0
    return [(0.0, z0, 0.0, 3 * rise / length**2, -2 * rise / length**3)]


def climb(z0: float, z1: float, length: float, spec: Climb) -> list[Record]:
    """Records of a `Climb`."""
    run = abs(z1 - z0) / spec.grade
    middle = spec.centre * length
    return vertical_curves([(middle - run / 2, z0), (middle + run / 2, z1)], length, spec.k_m)


def dip(z0: float, z1: float, length: float, spec: Dip, bottom_s: float) -> list[Record]:
    """Records of a `Dip` whose lowest point lies at `bottom_s`."""
    sag = spec.k_m * 200 * spec.grade
    lowest = spec.bottom_m - 2 * spec.grade * sag / 8
    points = [
        (bottom_s - (z0 - lowest) / spec.grade, z0),
        (bottom_s, lowest),
        (bottom_s + (z1 - lowest) / spec.grade, z1),
    ]
    return vertical_curves(points, length, spec.k_m)


def vertical_curves(points: Sequence[tuple[float, float]], length: float, k_m: float) -> list[Record]:
    """Records through points of intersection (s, z); level before the first and after the last.

    Each curve is `k_m` metres long per per cent of grade change.

    Raises:
        PlanError: the curves do not fit on the road or overlap.
    """
    grades = [0.0]
    grades += [(b[1] - a[1]) / (b[0] - a[0]) for a, b in itertools.pairwise(points)]
    grades.append(0.0)
    records: list[Record] = level(points[0][1])
    reached = 0.0
    for (s, z), before, after in zip(points, grades, grades[1:], strict=False):
        half = 50 * k_m * abs(after - before)
        if s - half < reached - 1e-9 or s + half > length + 1e-9:
            raise PlanError(
                f"vertical curve at s = {s:.1f} ± {half:.1f} m does not fit (free from {reached:.1f}, "
                f"road {length:.1f} m): steepen the grade or move the point"
            )
        z_in = z - before * half
        records.append((s - half, z_in, before, (after - before) / (4 * half), 0.0))
        records.append((s + half, z + after * half, after, 0.0, 0.0))
        reached = s + half
    if records[1][0] < 1e-6:
        records.pop(0)
    if records[-1][0] > length - 1e-6:
        records.pop()
    return records
