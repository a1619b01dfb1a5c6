"""Where buildings stand: rectangles along the outer edges of sidewalks that touch nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from carlaloc_env.core import elementary, rng
from carlaloc_env.core.array_types import Array
from carlaloc_env.town.buildings.buildings import BuildingPlan, draw_plan
from carlaloc_env.town.ground.height_fields import densify
from carlaloc_env.town.ground.lane_strips import PAVED, Strip
from carlaloc_env.town.meshing.mesh_builder import box_quads
from carlaloc_env.town.meshing.polygons import Area

CLEARANCE_M = 0.1
"""Least distance between a building and anything paved [m]."""
VERGE_M = 7.0
"""Distance of buildings from roads without sidewalks [m]."""
FARM_APART_M = 150.0
"""Least distance between two farmsteads in the country [m]."""
FARM_RADIUS_M = 42.0
"""Buildings of a farmstead stand this near to its first one [m]."""
FARM_BUILDINGS = 3
"""Most buildings of a farmstead."""
_STEP_M = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lot:
    """A building and its place."""

    plan: BuildingPlan
    """What stands there."""
    corner_m: Array
    """Left end of the front, seen from the street, world x and y [m], shape (2,)."""
    heading_rad: float
    """Direction of the front from its left to its right end [rad]."""
    name: str
    """Name of the lot's random stream."""

    def footprint(self) -> Area:
        """Ground area."""
        return _rectangle(self.corner_m, self.heading_rad, self.plan.width_m, self.plan.depth_m)


class Farmsteads:
    """Where the country is built upon: few groups of buildings, far between."""

    def __init__(self) -> None:
        self._first_m: list[Array] = []
        self._count: list[int] = []

    def room(self, xy_m: Array, draw: np.random.Generator) -> bool:
        """Whether a building may stand at a point (2,) [m]; new farmsteads begin at random places."""
        found = self._near(xy_m)
        if found is not None:
            return self._count[found] < FARM_BUILDINGS
        apart = all(float(np.hypot(*(first - xy_m))) > FARM_APART_M for first in self._first_m)
        return apart and draw.random() < 0.3

    def add(self, xy_m: Array) -> None:
        """Note a building."""
        found = self._near(xy_m)
        if found is None:
            self._first_m.append(xy_m)
            self._count.append(1)
        else:
            self._count[found] += 1

    def _near(self, xy_m: Array) -> int | None:
        for number, first in enumerate(self._first_m):
            if float(np.hypot(*(first - xy_m))) < FARM_RADIUS_M:
                return number
        return None


class _Footprints:
    """Areas of buildings, found by their boxes."""

    def __init__(self) -> None:
        self._areas: list[Area] = []
        self._boxes = np.zeros((0, 4))

    def add(self, area: Area) -> None:
        """Note a building."""
        if len(self._areas) == len(self._boxes):
            self._boxes = np.concatenate([self._boxes, np.zeros((len(self._boxes) + 16, 4))])
        self._boxes[len(self._areas)] = area.bounds
        self._areas.append(area)

    def near(self, area: Area) -> bool:
        """Whether an area, 1 cm smaller, meets one of them."""
        x0, y0, x1, y1 = area.bounds
        own = self._boxes[: len(self._areas)]
        rows = np.flatnonzero((own[:, 0] <= x1) & (own[:, 2] >= x0) & (own[:, 1] <= y1) & (own[:, 3] >= y0))
        if not len(rows):
            return False
        found = np.array([self._areas[row] for row in rows])
        return bool(shapely.intersects(shapely.buffer(area, -0.01), found).any())


def frontages(strips: Sequence[Strip]) -> list[tuple[str, Array, float]]:
    """Lines along which buildings may stand, with the free side on their right.

    Each has a name, points (N, 3) [m], and the extra distance [m] that roads without sidewalk ask for.
    """
    lines = []
    for strip in strips:
        span = strip.span(PAVED)
        if span is None:
            continue
        name = f"{strip.road_id}/{strip.section}"
        left, right = strip.lane_edges(span[0])[0], strip.lane_edges(span[1] - 1)[1]
        both = ((left[::-1], span[0], "left"), (right, span[1] - 1, "right"))
        for line, lane, side in both:
            walk = strip.kind(lane) == "sidewalk"
            # Connecting roads overlap; only their sidewalks bound a block.
            if strip.junction_id is not None and not walk:
                continue
            extra = 0.0 if walk else VERGE_M
            lines.append((f"{name}/{side}", densify(line, 1.0), extra))
    return lines


def place_lots(
    strips: Sequence[Strip], blocked: Area, zones: Sequence[tuple[str, Area]], seed: int
) -> list[Lot]:
    """Buildings along all roads, in the order of the roads.

    Args:
        strips: All road strips.
        blocked: Where nothing may stand.
        zones: Kinds of scenery with their areas.
        seed: Seed of the town.
    """
    shapely.prepare(blocked)
    for _, area in zones:
        shapely.prepare(area)
    placed: list[Lot] = []
    footprints = _Footprints()
    farmsteads = Farmsteads()
    inside = [strip for strip in strips if strip.junction_id is None]
    joints = [strip for strip in strips if strip.junction_id is not None]
    for name, line, extra in frontages([*inside, *joints]):
        _along(name, line, extra, blocked, zones, seed, placed, footprints, farmsteads)
    return placed


def _along(
    name: str,
    line: Array,
    extra_m: float,
    blocked: Area,
    zones: Sequence[tuple[str, Area]],
    seed: int,
    placed: list[Lot],
    footprints: _Footprints,
    farmsteads: Farmsteads,
) -> None:
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    at, count = 0.5, 0
    while at < length[-1] - 6.0:
        draw = rng.stream(seed, f"lot/{name}", index=count)
        count += 1
        start = _on(line, length, at)
        zone = _zone(zones, start)
        if zone == "rural" and not farmsteads.room(start, draw):
            at += 4 * _STEP_M
            continue
        plan = draw_plan(zone, draw, [lot.plan.appearance for lot in placed[-3:]], length[-1] - at)
        if plan is None:
            at += 4 * _STEP_M
            continue
        lot = _fit(f"lot/{name}/{count}", line, length, at, extra_m, plan, blocked, footprints)
        if lot is None:
            at += _STEP_M
            continue
        placed.append(lot)
        footprints.add(lot.footprint())
        if zone == "rural":
            farmsteads.add(start)
        spread = 2.5 if zone == "industrial" else 1.0
        at += plan.width_m + plan.appearance.style.gap_m * float(draw.uniform(0.6, 1.4)) * spread + 0.02


def _fit(
    name: str,
    line: Array,
    length: Array,
    at: float,
    extra_m: float,
    plan: BuildingPlan,
    blocked: Area,
    footprints: _Footprints,
) -> Lot | None:
    start, end = _on(line, length, at), _on(line, length, at + plan.width_m)
    chord = end - start
    if np.hypot(*chord) < 0.9 * plan.width_m:
        return None
    heading = float(elementary.arctan2(chord[1], chord[0]))
    right = np.array([chord[1], -chord[0]]) / np.hypot(*chord)
    for shift in (0.0, 0.6, 1.5):
        distance = CLEARANCE_M + 0.05 + plan.appearance.style.front_m + extra_m + shift
        # The building's own front runs the other way round: its left end lies at the line's end.
        corner = start + right * distance + chord / np.hypot(*chord) * plan.width_m
        lot = Lot(plan=plan, corner_m=corner, heading_rad=heading + np.pi, name=name)
        area = lot.footprint()
        if shapely.dwithin(blocked, area, CLEARANCE_M):
            continue
        if footprints.near(area):
            continue
        return lot
    return None


def _zone(zones: Sequence[tuple[str, Area]], xy: Array) -> str:
    point = shapely.Point(*xy)
    for kind, area in zones:
        if shapely.intersects(area, point):
            return kind
    return zones[-1][0]


def _on(line: Array, length: Array, at: float) -> Array:
    return np.array([np.interp(at, length, line[:, 0]), np.interp(at, length, line[:, 1])])


def _rectangle(corner: Array, heading: float, width: float, depth: float) -> Area:
    along = np.array([elementary.cos(heading), elementary.sin(heading)])
    inward = np.array([-along[1], along[0]])
    points = [
        corner,
        corner + along * width,
        corner + along * width + inward * depth,
        corner + inward * depth,
    ]
    return shapely.Polygon(points)


def lot_boxes(lots: Sequence[Lot], base_m: Sequence[float]) -> Array:
    """Walls and roofs of buildings, shape (N, 4, 3)."""
    faces = []
    for lot, base in zip(lots, base_m, strict=True):
        plan = lot.plan
        box = box_quads([0.0, 0.0, base - 1.0], [plan.width_m, plan.depth_m, base + plan.height_m])
        c, s = elementary.cos(lot.heading_rad), elementary.sin(lot.heading_rad)
        turned = box.copy()
        turned[..., 0] = lot.corner_m[0] + c * box[..., 0] - s * box[..., 1]
        turned[..., 1] = lot.corner_m[1] + s * box[..., 0] + c * box[..., 1]
        faces.append(turned)
    return np.concatenate(faces) if faces else np.zeros((0, 4, 3))
