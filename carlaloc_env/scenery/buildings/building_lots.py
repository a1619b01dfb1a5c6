"""Lots of buildings: rectangles along the outer edges of sidewalks that touch nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import densify, distance_along, interpolated
from carlaloc_env.scenery.buildings.buildings import BuildingPlan, draw_plan
from carlaloc_env.scenery.ground.lane_strips import PAVED, Strip
from carlaloc_env.scenery.ground.terrain import Zones
from carlaloc_env.scenery.meshing.mesh_builder import box_quads, turned

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
    """The building."""
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
    """Groups of buildings in the country: few, and far between."""

    def __init__(self) -> None:
        self._first_m: list[Array] = []
        self._count: list[int] = []

    def room(self, xy_m: Array, draw: np.random.Generator) -> bool:
        """Whether a building may stand at a point (2,) [m]; new farmsteads begin at random places."""
        farmstead = self._near(xy_m)
        if farmstead is not None:
            return self._count[farmstead] < FARM_BUILDINGS
        apart = all(float(np.hypot(*(first - xy_m))) > FARM_APART_M for first in self._first_m)
        return apart and draw.random() < 0.3

    def add(self, xy_m: Array) -> None:
        """Note a building."""
        farmstead = self._near(xy_m)
        if farmstead is None:
            self._first_m.append(xy_m)
            self._count.append(1)
        else:
            self._count[farmstead] += 1

    def _near(self, xy_m: Array) -> int | None:
        for number, first in enumerate(self._first_m):
            if float(np.hypot(*(first - xy_m))) < FARM_RADIUS_M:
                return number
        return None


class _Footprints:
    """Areas of buildings, looked up by their boxes."""

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
        box = self._boxes[: len(self._areas)]
        rows = np.flatnonzero((box[:, 0] <= x1) & (box[:, 2] >= x0) & (box[:, 1] <= y1) & (box[:, 3] >= y0))
        if not len(rows):
            return False
        candidates = np.array([self._areas[row] for row in rows])
        return bool(shapely.intersects(shapely.buffer(area, -0.01), candidates).any())


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


def place_lots(strips: Sequence[Strip], blocked: Area, zones: Zones, seed: int) -> list[Lot]:
    """Buildings along all roads, in the order of the roads.

    Args:
        strips: All road strips.
        blocked: Where nothing may stand.
        zones: Kinds of scenery with their areas.
        seed: Seed of the town.
    """
    street = _Placer(blocked, zones, seed)
    inside = [strip for strip in strips if strip.junction_id is None]
    joints = [strip for strip in strips if strip.junction_id is not None]
    for name, line, extra in frontages([*inside, *joints]):
        street.line_up(name, line, extra)
    return street.placed


class _Placer:
    """Lines up buildings where nothing is in their way."""

    def __init__(self, blocked: Area, zones: Zones, seed: int) -> None:
        for area in (blocked, *(area for _, area in zones)):
            shapely.prepare(area)
        self._blocked, self._zones, self._seed = blocked, zones, seed
        self._footprints, self._farmsteads = _Footprints(), Farmsteads()
        self.placed: list[Lot] = []

    def line_up(self, name: str, line: Array, extra_m: float) -> None:
        """Place buildings along one line, `extra_m` farther from it than their style asks for."""
        length = distance_along(line)
        at, count = 0.5, 0
        while at < length[-1] - 6.0:
            draw = clock.stream(self._seed, f"lot/{name}", index=count)
            count += 1
            start = interpolated(np.array([at]), length, line[:, :2])[0]
            zone = self._zones.kind_at(start, self._zones.default)
            rural = zone == "rural"
            plan = None
            if not rural or self._farmsteads.room(start, draw):
                before = [lot.plan.appearance for lot in self.placed[-3:]]
                plan = draw_plan(zone, draw, before, length[-1] - at)
            if plan is None:
                at += 4 * _STEP_M
                continue
            end = interpolated(np.array([at + plan.width_m]), length, line[:, :2])[0]
            lot = self._fit(f"lot/{name}/{count}", start, end, extra_m, plan)
            if lot is None:
                at += _STEP_M
                continue
            self.placed.append(lot)
            self._footprints.add(lot.footprint())
            if rural:
                self._farmsteads.add(start)
            spread = 2.5 if zone == "industrial" else 1.0
            at += plan.width_m + plan.appearance.style.gap_m * float(draw.uniform(0.6, 1.4)) * spread + 0.02

    def _fit(self, name: str, start: Array, end: Array, extra_m: float, plan: BuildingPlan) -> Lot | None:
        """The lot of a building between two points (2,) of a line, None where something is in the way."""
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
            if not (shapely.dwithin(self._blocked, area, CLEARANCE_M) or self._footprints.near(area)):
                return lot
        return None


def _rectangle(corner: Array, heading: float, width: float, depth: float) -> Area:
    along = np.array([elementary.cos(heading), elementary.sin(heading)])
    inward = np.array([-along[1], along[0]])
    end = corner + along * width
    return shapely.Polygon([corner, end, end + inward * depth, corner + inward * depth])


def lot_boxes(lots: Sequence[Lot], base_m: Sequence[float]) -> Array:
    """Walls and roofs of buildings, shape (N, 4, 3)."""
    faces = []
    for lot, base in zip(lots, base_m, strict=True):
        plan = lot.plan
        box = box_quads([0.0, 0.0, base - 1.0], [plan.width_m, plan.depth_m, base + plan.height_m])
        faces.append(turned(box, lot.corner_m, lot.heading_rad))
    return np.concatenate(faces) if faces else np.zeros((0, 4, 3))
