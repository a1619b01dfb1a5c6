"""Plan-view areas of a town: carriageways, sidewalks, junctions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from carlaloc_env.core.areas import (
    Area,
    areas_only,
    fill_holes,
    polygons_of,
    rings,
    strip_polygon,
    union,
    without,
)
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scenery.ground.height_fields import EdgeField
from carlaloc_env.scenery.ground.lane_strips import KERB_M, Strip

FILLED_HOLE_M2 = 90.0
"""Gaps between the turning paths of a junction up to this size are asphalt [m²]."""

LARGEST_ISLAND_M2 = 2500.0
"""Larger enclosed areas are blocks of the town, not islands [m²]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JunctionArea:
    """One junction in plan view."""

    id: str
    """Id of the junction."""
    strips: tuple[Strip, ...]
    """Its connecting roads."""
    roadway: Area
    """Asphalt, the union of all connecting lanes."""
    sidewalk: Area
    """Raised corners between the roads that meet here."""
    kerb_m: float
    """Height of the corners above the road [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TownAreas:
    """All areas of a town."""

    roadway: Area
    """Everything at road level."""
    raised: Area
    """Sidewalks, medians and corners."""
    junctions: tuple[JunctionArea, ...]
    """Junctions in the order of their first road in the file."""
    islands: Area
    """Ground enclosed by roads, such as the middle of a roundabout; raised as well."""
    low_paved: Area
    """Everything paved that does not pass overhead."""
    carried: frozenset[str] = frozenset()
    """Junctions that stand above the ground."""

    @cached_property
    def paved(self) -> Area:
        """Roadway and raised areas together."""
        return shapely.union(self.roadway, self.raised)


def lane_area(strip: Strip, kinds: Sequence[str]) -> list[Area]:
    """Areas of the strip's lanes of some kinds."""
    areas = []
    for lane in range(len(strip.lanes)):
        if strip.kind(lane) in kinds:
            left, right = strip.lane_edges(lane)
            area = strip_polygon(left, right)
            if area.area > 1e-4:
                areas.append(area)
    return areas


def town_areas(
    strips: Sequence[Strip],
    roads: Sequence[Road],
    overhead: Mapping[int, Area] | None = None,
    carried: frozenset[str] = frozenset(),
) -> TownAreas:
    """All areas of a map.

    Args:
        strips: All roads as strips.
        roads: All roads.
        overhead: What of each strip, by its number, passes over others; the ground does not see it.
        carried: Junctions that stand above the ground; they see all of it and nothing below.
    """
    above = overhead or {}
    plain = [strip for strip in strips if strip.junction_id is None]
    low_road, high_road = _plain_areas(strips, ("roadway",), above)
    low_raised, high_raised = _plain_areas(strips, ("sidewalk", "median"), above)
    groups: dict[str, list[Strip]] = {}
    for strip in strips:
        if strip.junction_id is not None:
            groups.setdefault(strip.junction_id, []).append(strip)
    widths = _corner_widths(plain, roads)
    on_ground = {name: group for name, group in groups.items() if name not in carried}
    low = _level(low_road, low_raised, on_ground, widths)
    if not above:
        return low
    in_air = {name: group for name, group in groups.items() if name in carried}
    high = _level(high_road, high_raised, in_air, widths)
    by_id = {junction.id: junction for junction in (*low.junctions, *high.junctions)}
    return TownAreas(
        roadway=shapely.union(low.roadway, high.roadway),
        raised=shapely.union(low.raised, high.raised),
        junctions=tuple(by_id[name] for name in groups),
        islands=low.islands,
        low_paved=low.low_paved,
        carried=carried,
    )


def _plain_areas(
    strips: Sequence[Strip], kinds: Sequence[str], above: Mapping[int, Area]
) -> tuple[Area, Area]:
    """Lanes of some kinds outside junctions: on the ground, and overhead."""
    low: list[Area] = []
    high: list[Area] = []
    for number, strip in enumerate(strips):
        if strip.junction_id is not None:
            continue
        lanes = lane_area(strip, kinds)
        if number not in above:
            low += lanes
            continue
        overhead = above[number]
        low += [shapely.difference(lane, overhead) for lane in lanes]
        high += [shapely.intersection(lane, overhead) for lane in lanes]
    return union(low), union(high)


def _level(
    plain_road: Area,
    plain_raised: Area,
    groups: Mapping[str, Sequence[Strip]],
    widths: Mapping[str, tuple[float, float]],
) -> TownAreas:
    """Areas of one level, which sees nothing of the others."""
    beside = shapely.union(plain_road, plain_raised)
    asphalt = {name: _asphalt(group, beside) for name, group in groups.items()}
    roadway = union([plain_road, *asphalt.values()])
    taken = shapely.union(roadway, plain_raised)
    for area in (taken, plain_raised):
        shapely.prepare(area)
    junctions: list[JunctionArea] = []
    for name, group in groups.items():
        width, kerb = widths.get(name, (0.0, KERB_M))
        others = [junction.sidewalk for junction in junctions]
        junctions.append(
            JunctionArea(
                id=name,
                strips=tuple(group),
                roadway=asphalt[name],
                sidewalk=_corners(group, asphalt[name], taken, others, plain_raised, width),
                kerb_m=kerb,
            )
        )
    raised = union([plain_raised, *(junction.sidewalk for junction in junctions)])
    islands = _islands(roadway, raised)
    raised = shapely.union(raised, islands)
    return TownAreas(
        roadway=roadway,
        raised=raised,
        junctions=tuple(junctions),
        islands=islands,
        # Hairlines between both would let grass grow along kerbs.
        low_paved=union([roadway, raised]),
    )


def _asphalt(group: Sequence[Strip], beside: Area) -> Area:
    """A junction's own asphalt, without what belongs to the roads `beside` it."""
    joined = union(area for strip in group for area in lane_area(strip, ("roadway",)))
    return areas_only(without(fill_holes(joined, FILLED_HOLE_M2), beside), 1e-2)


def _islands(roadway: Area, raised: Area) -> Area:
    """Holes in everything paved that are bounded by carriageways alone."""
    islands = []
    walks = shapely.buffer(raised, 0.05)
    shapely.prepare(walks)
    for part in polygons_of(shapely.union(roadway, raised)):
        for ring in part.interiors:
            hole = shapely.Polygon(ring)
            rim = shapely.length(shapely.intersection(ring, walks))
            if 2.0 < hole.area < LARGEST_ISLAND_M2 and rim < 0.1 * ring.length:
                islands.append(hole)
    return shapely.MultiPolygon(islands)


def _corner_widths(plain: Sequence[Strip], roads: Sequence[Road]) -> dict[str, tuple[float, float]]:
    """Width of the widest sidewalk that arrives at each junction, and its height [m]."""
    widths: dict[str, tuple[float, float]] = {}
    for strip in plain:
        road = roads[strip.road]
        ends = []
        for link, section, at in ((road.predecessor, 0, 0), (road.successor, len(road.sections) - 1, -1)):
            if link is not None and link.element_type == "junction" and strip.section == section:
                ends.append((link.element_id, at))
        for junction, at in ends:
            for lane in range(len(strip.lanes)):
                if strip.kind(lane) == "sidewalk":
                    width = float(strip.t_m[lane, at] - strip.t_m[lane + 1, at])
                    kerb = float(strip.raised_m[lane, :, at].mean())
                    widths[junction] = max(widths.get(junction, (0.0, KERB_M)), (width, kerb))
    return widths


def _corners(
    group: Sequence[Strip],
    asphalt: Area,
    taken: Area,
    others: Sequence[Area],
    plain_raised: Area,
    width_m: float,
) -> Area:
    """Sidewalks of a junction, without what is `taken` or belongs to `others`."""
    walks = union(area for strip in group for area in lane_area(strip, ("sidewalk", "median")))
    parts = [walks]
    if width_m > 0.3:
        parts.append(shapely.buffer(asphalt, width_m, quad_segs=12))
    wanted = union(parts)
    # Joining the few neighbours that matter spares a union of the whole town for every junction.
    near = [area for area in others if shapely.intersects(area, wanted)]
    area = areas_only(without(wanted, shapely.union_all([taken, *near]) if near else taken), 0.3)
    shapely.prepare(walks)
    kept = [
        part
        for part in area.geoms
        if shapely.dwithin(plain_raised, part, 0.15) or shapely.dwithin(walks, part, 0.15)
    ]
    return shapely.MultiPolygon(kept)


def corner_edges(junction: JunctionArea, edge: EdgeField) -> list[Array]:
    """Boundary lines (N, 3) of a junction's sidewalks at their top."""
    lines = []
    for ring in rings(junction.sidewalk, 0.5):
        lines.append(np.column_stack([ring, edge.nearest(ring)[0] + junction.kerb_m]))
    return lines
