"""Profiles of plans: straight grades joined by parabolic vertical curves."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from carlaloc_env.authoring.geometry.elevation import Record, level, moved_cubic
from carlaloc_env.authoring.geometry.newton import PlanError


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


@dataclass(frozen=True, slots=True)
class Profile:
    """Straight grades through given points, rounded by parabolas; level before them and after them."""

    points: tuple[tuple[float, float], ...]
    """Station along the road's axis from node a, and height [m], of every change of grade."""
    k_m: float
    """Length of the vertical curves per per cent of grade change [m/%]."""


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
        if half < 1e-9:
            continue
        if s - half < reached - 1e-9 or s + half > length + 1e-9:
            raise PlanError(
                f"vertical curve at s = {s:.1f} ± {half:.1f} m does not fit (free from {reached:.1f}, "
                f"road {length:.1f} m): steepen the grade or move the point"
            )
        z_in = z - before * half
        records.append((s - half, z_in, before, (after - before) / (4 * half), 0.0))
        records.append((s + half, z + after * half, after, 0.0, 0.0))
        reached = s + half
    if len(records) > 1 and records[1][0] < 1e-6:
        records.pop(0)
    if records[-1][0] > length - 1e-6:
        records.pop()
    return records


def cut_profile(records: Sequence[Record], first_m: float, last_m: float, length: float) -> list[Record]:
    """Elevation of the part between two stations; beyond `length` that of a closed road goes round."""
    result: list[Record] = []
    turns = [0.0] if last_m <= length + 1e-6 else [0.0, length]
    for turn in turns:
        for k, (s, a, b, c, d) in enumerate(records):
            end = records[k + 1][0] if k + 1 < len(records) else length
            if end + turn <= first_m + 1e-6 or s + turn >= last_m - 1e-6:
                continue
            cubic = moved_cubic((a, b, c, d), max(first_m - turn - s, 0.0))
            if not (result and result[-1][2:] == (0.0, 0.0, 0.0) == cubic[1:]):
                result.append((max(s + turn - first_m, 0.0), *cubic))
    return result


def ramp(z0: float, grade0: float, z1: float, grade1: float, length: float, k_m: float) -> list[Record]:
    """One straight grade between two ends that have grades of their own, joined by parabolas.

    The grade g solves Δz = g·L + 50·K·(|g − g0|·(g0 − g) + |g1 − g|·(g1 − g)), which grows with g.

    Raises:
        PlanError: The vertical curves are longer than the road.
    """
    if abs(z1 - z0) < 1e-9 and grade0 == grade1 == 0.0:
        return level(z0)

    def rise(g: float) -> float:
        return g * length + 50 * k_m * (abs(g - grade0) * (grade0 - g) + abs(grade1 - g) * (grade1 - g))

    low, high = -0.3, 0.3
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rise(middle) < z1 - z0 else (low, middle)
    grade = round(0.5 * (low + high), 12)
    first, last = 100 * k_m * abs(grade - grade0), 100 * k_m * abs(grade1 - grade)
    if first + last > length:
        raise PlanError(
            f"a ramp of {length:.0f} m has no room to climb {z1 - z0:.1f} m: its vertical curves need "
            f"{first + last:.0f} m; lengthen it or lower its speed"
        )
    records: list[Record] = []
    z_first = z0 + 0.5 * (grade0 + grade) * first
    z_last = z1 - 0.5 * (grade + grade1) * last
    if first > 1e-6:
        records.append((0.0, z0, grade0, (grade - grade0) / (2 * first), 0.0))
    records.append((first if first > 1e-6 else 0.0, z_first, grade, 0.0, 0.0))
    if last > 1e-6:
        records.append((length - last, z_last, grade, (grade1 - grade) / (2 * last), 0.0))
    return records
