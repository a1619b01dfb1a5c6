"""Junctions on a slope: one plane for all their roads, which lean into it and out of it again."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from carlaloc_env.authoring.geometry.elevation import Record, height_at, hermite
from carlaloc_env.authoring.geometry.newton import PlanError
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Pose, curvature

STEP_M = 0.5
"""Distance of the points at which a bend is compared with the plane [m]."""
HEIGHT_TOLERANCE_M, TILT_TOLERANCE_RAD = 1e-4, 2e-5
"""How far cubics may miss the plane; 2e-5 rad are 0.1 mm at a distance of 5 m."""
LEAN_M = 15.0
"""Way on which a road turns from the plane's cross fall to a level cross-section [m]."""


@dataclass(frozen=True, slots=True)
class Plane:
    """Height z + east·(x − x0) + north·(y − y0) of a junction."""

    x: float
    y: float
    z: float
    east: float = 0.0
    """Slope towards east."""
    north: float = 0.0
    """Slope towards north."""

    @property
    def is_level(self) -> bool:
        """Whether it does not slope at all."""
        return self.east == 0.0 == self.north

    def height(self, pose: Pose) -> tuple[float, float]:
        """Height at a point [m], and the grade along its heading."""
        z = self.z + self.east * (pose.x - self.x) + self.north * (pose.y - self.y)
        return round(z, 9), round(self.east * math.cos(pose.h) + self.north * math.sin(pose.h), 11)

    def tilt(self, pose: Pose) -> float:
        """Superelevation [rad] with which a road of this heading lies in the plane, left side up positive."""
        return round(math.atan(self.north * math.cos(pose.h) - self.east * math.sin(pose.h)), 11)


def in_plane(plane: Plane, path: Path) -> tuple[list[Record], list[Record]]:
    """Elevation and superelevation of a road all of whose points lie in the plane.

    Both are sines of the heading, which cubics follow from their values and slopes: along s the grade is
    g = E·cos h + N·sin h and the cross fall f = N·cos h − E·sin h, so that f' = −κ·g.

    Raises:
        PlanError: The path has cubics, which cannot be sampled.
    """
    if any(piece.cubic is not None for piece in path.pieces):
        raise PlanError("a path through a sloping junction has a cubic: give its legs more room")
    count = max(1, math.ceil(path.length / STEP_M))
    stations = [round(path.length * k / count, 10) for k in range(count)] + [path.length]
    heights, tilts = [], []
    for s in stations:
        pose = path.at(s) if s < path.length else path.end
        z, grade = plane.height(pose)
        tilt = plane.tilt(pose)
        heights.append((z, grade))
        tilts.append((tilt, -curvature(path, s) * grade * math.cos(tilt) ** 2))
    return _cubics(stations, heights, HEIGHT_TOLERANCE_M), _cubics(stations, tilts, TILT_TOLERANCE_RAD)


def _cubics(
    stations: Sequence[float], heights: Sequence[tuple[float, float]], tolerance: float
) -> list[Record]:
    """As few cubics as possible through values with their slopes, each as long as it misses none of them."""
    records: list[Record] = []
    first, last = 0, len(stations) - 1
    while first < last:
        best = first + 1
        cubic = _between(stations, heights, first, best)
        for end in range(first + 2, last + 1):
            trial = _between(stations, heights, first, end)
            inner = range(first + 1, end)
            if any(abs(height_at([trial], stations[k])[0] - heights[k][0]) > tolerance for k in inner):
                break
            best, cubic = end, trial
        records.append(cubic)
        first = best
    return records


def _between(
    stations: Sequence[float], heights: Sequence[tuple[float, float]], first: int, last: int
) -> Record:
    length = stations[last] - stations[first]
    return (stations[first], *hermite(*heights[first], *heights[last], length)[0][1:])


def leaning(first: float, last: float, length: float) -> list[Record]:
    """Superelevation of a road between two tilts [rad], level between them where it is long enough."""
    if first == last == 0.0:
        return []
    if length < 2 * LEAN_M:
        return hermite(first, 0.0, last, 0.0, length)
    middle = round(length - LEAN_M, 10)
    records = hermite(first, 0.0, 0.0, 0.0, LEAN_M)
    records.append((LEAN_M, 0.0, 0.0, 0.0, 0.0))
    records += [(middle, *record[1:]) for record in hermite(0.0, 0.0, last, 0.0, length - middle)]
    return records
