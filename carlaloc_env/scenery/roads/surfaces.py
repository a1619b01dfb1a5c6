"""Surfaces to drive and walk on: roads, sidewalks, junctions, terrain, bridges, paint."""

import shapely

from carlaloc_env.core.areas import Area, areas_only
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.road.road_events import no_events
from carlaloc_env.scenery.ground.grade_graph import grown
from carlaloc_env.scenery.ground.grade_levels import WALL_M, State
from carlaloc_env.scenery.ground.ground_plan import Groundwork
from carlaloc_env.scenery.ground.height_fields import JunctionField
from carlaloc_env.scenery.ground.terrain import add_terrain
from carlaloc_env.scenery.ground.water import add_water
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.fast_roads import is_fast_junction
from carlaloc_env.scenery.roads.junction_surfaces import add_corners, add_islands, add_junction_surface
from carlaloc_env.scenery.roads.junction_wear import add_junction_details
from carlaloc_env.scenery.roads.lane_surfaces import add_plain_lanes, add_roads
from carlaloc_env.scenery.roads.painted_areas import RoadPainter
from carlaloc_env.scenery.roads.road_events import add_bridge_joints
from carlaloc_env.scenery.roads.road_markings import add_markings
from carlaloc_env.scenery.roads.road_wear import add_road_details
from carlaloc_env.scenery.roads.sidewalk_wear import add_sidewalk_wear
from carlaloc_env.scenery.roads.sidewalks import add_sidewalks
from carlaloc_env.scenery.structures.bridges import add_bridges
from carlaloc_env.scenery.structures.underpasses import add_underpasses

PROMENADE_M = 3.7
"""Quays this near to something paved have a railing of their own [m]."""


class Surfaces:
    """Builders that the surfaces of a town go to, by what becomes of them."""

    def __init__(self) -> None:
        self.lanes = MeshBuilder()
        """Seen, but rolled over by way of `solid`'s plainer lanes."""
        self.raised = MeshBuilder()
        """Seen and solid."""
        self.solid = MeshBuilder()
        """Solid, but not seen."""
        self.paint = MeshBuilder()
        """Seen only."""
        self.events: list[Array] = [no_events()]
        """Events that wheels feel beside the meshes, (N, 7) each."""


def add_surfaces(out: Surfaces, network: LaneNetwork, work: Groundwork, seed: int) -> Array:
    """Adds all surfaces; gives the places of lamps below roofs [m], shape (K, 3)."""
    add_roads(out.lanes, work.strips, work.roads, seed)
    add_plain_lanes(out.solid, work.strips)
    out.events.append(add_road_details(out.lanes, work.strips, work.roads, seed))
    out.events.append(add_bridge_joints(out.lanes, work.strips, work.levels, seed))
    add_sidewalks(out.raised, work.strips, work.roads, seed)
    add_sidewalk_wear(out.lanes, work.strips, work.roads, seed)
    _add_junctions(out, work, seed)
    add_islands(out.raised, work.areas, work.kerb)
    add_terrain(out.raised, work.bounds, _ground_paving(work), work.zones, work.ground, work.seas)
    lamps = add_underpasses(out.raised, work.levels)
    if work.raised is not None:
        add_bridges(out.raised, work.levels, work.raised, work.kerb, work.ground)
    _add_waters(out, work)
    add_markings(out.paint, work.strips, work.roads)
    RoadPainter(network, work.strips, work.areas).add_all(out.paint)
    return lamps


def _add_junctions(out: Surfaces, work: Groundwork, seed: int) -> None:
    for junction in work.areas.junctions:
        deck = work.deck if junction.id in work.carried else None
        surface = JunctionField(junction.strips, work.surface)
        fast = is_fast_junction(junction, work.roads)
        add_junction_surface(out.raised, junction, surface, seed, fast=fast)
        out.events.append(add_junction_details(out.lanes, junction, surface, seed, fast=fast))
        add_corners(out.raised, junction, work.areas, work.kerb if deck is None else deck)


def _add_waters(out: Surfaces, work: Groundwork) -> None:
    beside = shapely.buffer(work.areas.paved, PROMENADE_M)
    lined = shapely.difference(shapely.buffer(work.zones.area("waterfront"), 1.5), beside)
    above = shapely.buffer(work.overhead, 0.8)
    add_water(out.raised, work.levels.waters, work.shore, work.ground, above, lined)


def _ground_paving(work: Groundwork) -> Area:
    """Ground that the terrain leaves free: paving, open cuts, filled stretches and waters."""
    levels = work.levels
    result = shapely.union(
        work.areas.low_paved, shapely.union(levels.area(State.FILLED, State.BANK), levels.landings())
    )
    for stretch in levels.stretches:
        result = shapely.difference(result, stretch.area(stretch.detached))
        result = shapely.union(result, stretch.area(grown(~stretch.detached), WALL_M))
    return areas_only(shapely.union_all([result, levels.upper, *(water.area for water in levels.waters)]))
