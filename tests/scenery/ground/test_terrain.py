"""Ground of junctions and of what lies beside paved areas."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.sources import known_towns
from carlaloc_env.scenery.ground.grade_separation import find_levels
from carlaloc_env.scenery.ground.height_fields import EdgeField, GroundGrid, JunctionField
from carlaloc_env.scenery.ground.lane_strips import Strip, road_strips
from carlaloc_env.scenery.ground.paved_areas import town_areas
from carlaloc_env.scenery.ground.terrain import LAP_M, Terrain, Zones, add_terrain, zone_areas
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder


@pytest.mark.parametrize("name", ["Town03", "Town07"])
def test_surfaces_of_junctions_lie_on_their_lanes(name: str) -> None:
    """Along the lanes' middles: everywhere where connecting roads agree, 97 % of them on slopes."""
    network = town_network(name)
    groups: dict[str, list[Strip]] = {}
    for strip in road_strips(network.xodr.roads, network.surface):
        if strip.junction_id is not None:
            groups.setdefault(strip.junction_id, []).append(strip)
    off = []
    for junction, strips in groups.items():
        field = JunctionField(strips, network.surface)
        for lane in network.lanes:
            if lane.junction_id == junction and lane.type == "driving":
                station = np.arange(0.0, lane.length_m, 1.0)
                points = network.pose([lane.index] * len(station), station).position_m
                off.append(field.height(points) - points[:, 2])
    away = np.abs(np.concatenate(off))
    assert (away < 0.02).mean() > (0.97 if name == "Town07" else 0.9999)
    assert away.max() < 0.1


def test_no_grass_grows_along_kerbs() -> None:
    """Kerb lines of Town01 lie deep inside what is paved: no hairline parts roadway and sidewalk."""
    network = town_network("Town01")
    strips = road_strips(network.xodr.roads, network.surface)
    zones = zone_areas(
        TownConfig.from_toml(known_towns()["Town01"].with_name("town.toml")),
        shapely.box(-400, -400, 400, 400),
    )
    levels = find_levels(strips, np.full(2, -400.0), np.full(2, 400.0), zones)
    assert levels.overhead()
    areas = town_areas(strips, network.xodr.roads, levels.overhead())
    paved = shapely.buffer(areas.low_paved, -LAP_M, join_style="mitre")
    overhead = shapely.union_all(list(levels.overhead().values()))
    shapely.prepare(paved)
    count = 0
    for strip in strips:
        kinds = [strip.kind(lane) for lane in range(len(strip.lanes))]
        for edge, pair in enumerate(pairwise(kinds), 1):
            if strip.junction_id is None and set(pair) == {"roadway", "sidewalk"}:
                inner = strip.edges_m[edge, 1:-1, :2]
                inner = inner[shapely.distance(overhead, shapely.points(inner)) > 1.0]
                assert shapely.contains_xy(paved, inner[:, 0], inner[:, 1]).all(), strip.road_id
                count += len(inner)
    assert count > 500


def test_no_ground_shows_in_hairlines_of_what_is_paved() -> None:
    paved = shapely.MultiPolygon(
        [shapely.box(0.0, 0.0, 50.0, 20.0), shapely.box(50.0 + 1e-9, 0.0, 90.0, 20.0)]
    )
    line = EdgeField([np.array([[0.0, 0.0, 0.0], [90.0, 0.0, 0.0]])])
    grid = GroundGrid(line.points_m, np.full(2, -100.0), np.full(2, 200.0))
    bounds, out = shapely.box(-50.0, -50.0, 140.0, 70.0), MeshBuilder()
    add_terrain(out, bounds, paved, Zones([("rural", bounds)]), Terrain(edge=line, grid=grid))
    corners = out.build().vertices_m
    inside = shapely.contains_xy(shapely.box(1.0, 1.0, 89.0, 19.0), corners[:, 0], corners[:, 1])
    assert len(corners) > 100
    assert not inside.any()
