"""The groundwork of a town: its roads as strips and areas, their levels, the ground and the waters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.map.opendrive.road_surface import RoadSurface
from carlaloc_env.scenery.ground.grade_levels import Levels, State, level_fields
from carlaloc_env.scenery.ground.grade_separation import find_levels
from carlaloc_env.scenery.ground.height_fields import NO_LAND, EdgeField, GroundGrid, land_beside
from carlaloc_env.scenery.ground.lane_strips import KERB_M, Strip, road_strips
from carlaloc_env.scenery.ground.lowered_walks import lower_walks
from carlaloc_env.scenery.ground.paved_areas import TownAreas, corner_edges, town_areas
from carlaloc_env.scenery.ground.raised_parts import RaisedParts, raised_parts
from carlaloc_env.scenery.ground.terrain import MARGIN_M, Terrain, Zones, zone_areas
from carlaloc_env.scenery.ground.water import Shore, bank_tops, shores


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
    states: dict[str, State] = {}
    for number, strip in enumerate(strips):
        state = levels.state[levels.graph.rows(number)]
        if strip.junction_id is None or not len(state) or (state != state[0]).any():
            continue
        if state[0] in (State.OPEN, State.FILLED):
            states[strip.junction_id] = State(int(state[0]))
    return states


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
    lines, banks = levels.edges(State.GROUND), levels.edges(State.BANK)
    for stretch in levels.stretches:
        lines += [stretch.left_top_m, stretch.right_top_m]
    for junction in areas.junctions:
        if junction.id not in areas.carried:
            lines += corner_edges(junction, kerb_field)
    outer = EdgeField([*lines, *shore], 0.5)
    bank = EdgeField(banks, 0.5) if banks else None
    points_m = np.concatenate([outer.points_m, land_beside(land_m, outer.points_m)])
    return Terrain(edge=outer, grid=GroundGrid(points_m, *box), bank=bank, sloping=len(land_m) > 0)


def _seas(config: TownConfig, levels: Levels) -> list[tuple[Area, float]]:
    """Waters beyond the town's near ground, too, with their levels [m]."""
    seas = []
    for zone in config.zones:
        whole = shapely.make_valid(shapely.Polygon(zone.polygon))
        near = [water.level_m for water in levels.waters if shapely.intersects(water.area, whole)]
        if zone.kind == "water" and near:
            seas.append((whole, min(near)))
    return seas
