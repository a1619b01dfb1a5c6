"""The groundwork of a town: its roads as strips and areas, their levels, the ground and the waters.

Roads above the ground: their areas, the heights of their edges, and the floor below them.

Sidewalks and medians that the lanes of another road run across lie flush with them there.

Generated maps let roads run into each other, and kerbs must not stand in their lanes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.core.areas import Area, areas_only, strip_polygon
from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.map.opendrive.road_surface import RoadSurface
from carlaloc_env.scenery.ground.grade_graph import runs
from carlaloc_env.scenery.ground.grade_levels import Levels, State, level_fields
from carlaloc_env.scenery.ground.grade_separation import find_levels
from carlaloc_env.scenery.ground.height_fields import (
    NO_LAND,
    EdgeField,
    GroundGrid,
    land_beside,
)
from carlaloc_env.scenery.ground.lane_strips import KERB_M, SAMPLE_M, Strip, road_strips
from carlaloc_env.scenery.ground.paved_areas import JunctionArea, TownAreas, corner_edges, town_areas
from carlaloc_env.scenery.ground.terrain import MARGIN_M, Terrain, Zones, zone_areas
from carlaloc_env.scenery.ground.water import Shore, bank_tops, shores

BELOW_M = 0.01
"""How far such a sidewalk lies below the lanes [m]."""
FLARE_M = 0.6
"""Length of the slope up to the sidewalk on both sides [m]."""
_INSIDE_M = 0.3
"""Lanes are free at this distance from their edges already where sidewalks merely touch them."""
_LEAST_M2 = 0.05
_LEVEL_M = 1.0


def lower_walks(strips: Sequence[Strip]) -> list[Strip]:
    """The same strips with sidewalks lowered wherever driving lanes of other roads cross them."""
    lanes = [(n, area) for n, strip in enumerate(strips) for area in _driven(strip)]
    if not lanes:
        return list(strips)
    tree = shapely.STRtree([area for _, area in lanes])
    result = []
    for number, strip in enumerate(strips):
        walks = [k for k in range(len(strip.lanes)) if strip.kind(k) in ("sidewalk", "median")]
        if strip.junction_id is None and walks:
            left, right = strip.edges_m[walks[0]], strip.edges_m[walks[-1] + 1]
            near = [lanes[k] for k in tree.query(strip_polygon(left, right)) if lanes[k][0] != number]
            for walk in walks if near else ():
                crossing = _crossing(strips, strip, walk, near)
                strip = _lowered(strip, walk, crossing) if crossing is not None else strip
        result.append(strip)
    return result


def _driven(strip: Strip) -> list[Area]:
    """Inner parts of the strip's driving lanes."""
    found = []
    for lane in range(len(strip.lanes)):
        if strip.lanes[lane].type == "driving":
            area = shapely.buffer(strip_polygon(*strip.lane_edges(lane)), -_INSIDE_M)
            if not area.is_empty:
                found.append(area)
    return found


def _crossing(strips: Sequence[Strip], strip: Strip, walk: int, near: Sequence[tuple[int, Area]]) -> Area:
    """Part of a sidewalk that driving lanes at the same level cross; None for nothing."""
    walk_area = strip_polygon(*strip.lane_edges(walk))
    taken = []
    for other, lane in near:
        part = shapely.intersection(walk_area, lane)
        if part.area > _LEAST_M2 and _level_with(strip, strips[other], part):
            taken.append(part)
    return shapely.union_all(taken) if taken else None


def _level_with(a: Strip, b: Strip, part: Area) -> bool:
    """Whether two strips have about the same height where they meet."""
    x, y = shapely.get_coordinates(shapely.centroid(part))[0]
    heights = []
    for strip in (a, b):
        points = strip.edges_m.reshape(-1, 3)
        heights.append(points[np.argmin((points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2), 2])
    return bool(abs(heights[0] - heights[1]) < _LEVEL_M)


def _lowered(strip: Strip, walk: int, crossing: Area) -> Strip:
    """The strip with one lane lowered wherever it lies under lanes, with slopes at both ends."""
    dense = np.linspace(strip.s_m[0], strip.s_m[-1], int(np.ceil(np.ptp(strip.s_m) / SAMPLE_M)) + 1)
    left, right = (interpolated(dense, strip.s_m, edge) for edge in strip.lane_edges(walk))
    across = shapely.linestrings(np.stack([left[:, :2], right[:, :2]], axis=1))
    under = shapely.intersects(across, shapely.buffer(crossing, _INSIDE_M + SAMPLE_M))
    if not under.any():
        return strip
    gap = np.min(np.abs(dense[:, None] - dense[under][None]), axis=1)
    share = np.clip(gap / FLARE_M, 0.0, 1.0)
    kept = (gap < FLARE_M + 2 * SAMPLE_M) | (np.arange(len(dense)) % round(2.0 / SAMPLE_M) == 0)
    s = np.unique(np.concatenate([strip.s_m, dense[kept]]))
    raised = interpolated(s, strip.s_m, np.moveaxis(strip.raised_m, -1, 0).reshape(len(strip.s_m), -1))
    raised = np.moveaxis(raised.reshape(len(s), *strip.raised_m.shape[:2]), 0, -1).copy()
    down = np.interp(s, dense, share)
    raised[walk] = (raised[walk] + BELOW_M) * down - BELOW_M
    return replace(
        strip,
        s_m=s,
        t_m=np.stack([np.interp(s, strip.s_m, row) for row in strip.t_m]),
        edges_m=np.stack([interpolated(s, strip.s_m, edge) for edge in strip.edges_m]),
        raised_m=raised,
    )


DECK_M = 0.9
"""Thickness of a deck [m]."""
FOOTING_M = 0.8
"""How far walls and piers reach into the ground [m]."""
SHORE_M = 8.0
"""Things this far from a water are near it [m]."""
GREY = (224, 222, 216)
"""Linear tint of concrete decks and walls."""
DIM = (205, 203, 197)
"""The same of their undersides."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RaisedParts:
    """Plan-view areas of all that stands above the ground, and the heights of its edges."""

    open: Area
    """Decks: ground, road or water goes on below."""
    filled: Area
    """Roads between retaining walls."""
    road: EdgeField
    """Heights of the roads' edges."""
    top: EdgeField
    """Heights of the outer edges at their top, sidewalks included."""
    below: Area
    """Everything paved on the ground."""

    @property
    def whole(self) -> Area:
        """Decks and filled parts as one."""
        joined = shapely.union(self.open, self.filled)
        closed = shapely.buffer(joined, 0.05, join_style="mitre", mitre_limit=2.0)
        return areas_only(shapely.buffer(closed, -0.05, join_style="mitre", mitre_limit=2.0), 0.5)


def raised_parts(
    levels: Levels, road: EdgeField | None, junctions: Sequence[tuple[JunctionArea, State]], below: Area
) -> RaisedParts | None:
    """Areas of what stands above the ground; None where nothing does.

    Args:
        levels: What leaves the ground.
        road: Heights of the edges of raised roads.
        junctions: Raised junctions with their state.
        below: Everything paved on the ground.
    """
    if road is None:
        return None
    parts = {state: [levels.area(state)] for state in (State.OPEN, State.FILLED)}
    for junction, state in junctions:
        parts[state] += [junction.roadway, junction.sidewalk]
    opened, filled = (
        areas_only(shapely.union_all(parts[state], grid_size=1e-3)) for state in (State.OPEN, State.FILLED)
    )
    graph = levels.graph
    up = (levels.state == State.OPEN) | (levels.state == State.FILLED)
    lines = [line[a:b] for line in (graph.left_m, graph.right_m) for a, b in runs_in_strips(graph.strip, up)]
    return RaisedParts(
        open=opened,
        filled=areas_only(shapely.difference(filled, opened)),
        road=road,
        top=EdgeField(lines),
        below=below,
    )


class Floor:
    """The floor for walls and piers: the ground, or the bed of a water."""

    def __init__(self, levels: Levels, ground: Terrain) -> None:
        self._waters = levels.waters
        self._ground = ground
        for water in self._waters:
            shapely.prepare(water.area)

    def near_water(self, xy: Array) -> Mask:
        """Whether points (M, 2) lie over or near a water."""
        found = np.zeros(len(xy), dtype=bool)
        for water in self._waters:
            found |= shapely.dwithin(water.area, shapely.points(xy), SHORE_M)
        return found

    def height(self, xy: Array) -> Array:
        """Height [m] at points (M, 2)."""
        z = self._ground.height(xy)
        for water in self._waters:
            inside = shapely.contains_xy(water.area, xy[:, 0], xy[:, 1])
            z = np.where(inside, np.minimum(z, water.level_m - 0.4), z)
        return z


def runs_in_strips(strip: NDArray[np.int64], mask: Mask) -> list[tuple[int, int]]:
    """Half-open ranges of rows that hold a mask, cut where the strip changes."""
    found = []
    for number in np.unique(strip[mask]):
        rows = np.flatnonzero(strip == number)
        found += [(int(rows[0]) + a, int(rows[0]) + b) for a, b in runs(mask[rows]) if b - a > 1]
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Groundwork:
    """Roads, levels, areas and heights of a town."""

    roads: Sequence[Road]
    """Roads of the map."""
    surface: RoadSurface
    """Their analytic surface."""
    strips: Sequence[Strip]
    """Their lane sections as lines of points."""
    bounds: Area
    """The town's near ground: a box round all roads."""
    zones: Zones
    """Kinds of scenery with their areas."""
    levels: Levels
    """Roads that leave the ground."""
    areas: TownAreas
    """Everything paved."""
    carried: dict[str, State]
    """Junctions that stand above the ground, with their state."""
    kerb: EdgeField
    """Heights of the edges of roads on the ground."""
    deck: EdgeField | None
    """Heights of the edges of raised roads."""
    raised: RaisedParts | None
    """Areas of what stands above the ground."""
    shore: Sequence[Shore]
    """Edges of the waters."""
    ground: Terrain
    """Heights of the ground."""
    seas: list[tuple[Area, float]]
    """Waters as wide as `town.toml` draws them, with their levels [m]."""

    @property
    def overhead(self) -> Area:
        """Everything that stands above the ground."""
        return shapely.Polygon() if self.raised is None else self.raised.whole

    def floor_height(self, xy_m: Array) -> Array:
        """Height [m] of what one would stand on, at points (M, 2): sidewalks, or the ground."""
        on = shapely.intersects_xy(self.areas.raised, xy_m[:, 0], xy_m[:, 1])
        return np.where(on, self.kerb.nearest(xy_m)[0] + KERB_M, self.ground.height(xy_m))


def lay_groundwork(network: LaneNetwork, config: TownConfig, land_m: Array = NO_LAND) -> Groundwork:
    """Groundwork of a map, with known points of its land (K, 3) [m]."""
    roads = network.xodr.roads
    strips = lower_walks(road_strips(roads, network.surface))
    bounds = _bounds(strips)
    zones = zone_areas(config, bounds)
    corners = np.array(shapely.bounds(bounds)).reshape(2, 2)
    box = (corners[0], corners[1])
    levels = find_levels(strips, *box, zones, land_m)
    carried = _carried_junctions(levels, strips)
    areas = town_areas(strips, roads, levels.overhead(), frozenset(carried))
    kerb, deck = level_fields(strips, levels, [_road_edges(strip) for strip in strips])
    high = [(junction, carried[junction.id]) for junction in areas.junctions if junction.id in carried]
    shore = shores(levels.waters, zones, areas.low_paved)
    return Groundwork(
        roads=roads,
        surface=network.surface,
        strips=strips,
        bounds=bounds,
        zones=zones,
        levels=levels,
        areas=areas,
        carried=carried,
        kerb=kerb,
        deck=deck,
        raised=raised_parts(levels, deck, high, areas.low_paved),
        shore=shore,
        ground=_ground(areas, kerb, levels, bank_tops(shore), box, land_m),
        seas=_seas(config, levels),
    )


def _bounds(strips: Sequence[Strip]) -> Area:
    lines = np.concatenate([line[:, :2] for strip in strips for line in _road_edges(strip)])
    low, high = lines.min(axis=0) - MARGIN_M, lines.max(axis=0) + MARGIN_M
    return shapely.box(*low, *high)


def _carried_junctions(levels: Levels, strips: Sequence[Strip]) -> dict[str, State]:
    """Junctions that stand above the ground, with their state."""
    found: dict[str, State] = {}
    for number, strip in enumerate(strips):
        state = levels.state[levels.graph.rows(number)]
        if strip.junction_id is None or not len(state) or (state != state[0]).any():
            continue
        if state[0] in (State.OPEN, State.FILLED):
            found[strip.junction_id] = State(int(state[0]))
    return found


def _road_edges(strip: Strip) -> list[Array]:
    """Edges of a strip's lanes at road level, from which kerbs take their height."""
    return [
        line
        for lane in range(len(strip.lanes))
        if strip.kind(lane) == "roadway"
        for line in strip.lane_edges(lane)
    ]


def _ground(
    areas: TownAreas,
    kerb_field: EdgeField,
    levels: Levels,
    shore: Sequence[Array],
    box: tuple[Array, Array],
    land_m: Array,
) -> Terrain:
    """Heights of the ground: along everything paved that lies on it, along cuts and shores, and between."""
    count = len(levels.graph.prints)
    lines = [line for strip in range(count) for line in levels.ground_lines(strip)]
    banks = [line for strip in range(count) for line in levels.bank_lines(strip)]
    for stretch in levels.stretches:
        lines += [stretch.left_top_m, stretch.right_top_m]
    for junction in areas.junctions:
        if junction.id not in areas.carried:
            lines += corner_edges(junction, kerb_field)
    outer = EdgeField([*lines, *shore], 0.5)
    bank = EdgeField(banks, 0.5) if banks else None
    known = np.concatenate([outer.points_m, land_beside(land_m, outer.points_m)])
    return Terrain(edge=outer, grid=GroundGrid(known, *box), bank=bank, sloping=len(land_m) > 0)


def _seas(config: TownConfig, levels: Levels) -> list[tuple[Area, float]]:
    """Waters beyond the town's near ground, too, with their levels [m]."""
    found = []
    for zone in config.zones:
        whole = shapely.make_valid(shapely.Polygon(zone.polygon))
        near = [water.level_m for water in levels.waters if shapely.intersects(water.area, whole)]
        if zone.kind == "water" and near:
            found.append((whole, min(near)))
    return found
