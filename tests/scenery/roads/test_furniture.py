"""Everything that streets are known by stands somewhere along the sidewalks of our towns."""

import pathlib

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.core.areas import strip_polygon
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scenery.ground.lane_strips import Strip, road_strips
from carlaloc_env.scenery.ground.terrain import zone_areas
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.lane_surfaces import casting_ends
from carlaloc_env.scenery.roads.road_wear import add_road_details
from carlaloc_env.scenery.roads.sidewalk_wear import SLAB_M, add_sidewalk_wear
from carlaloc_env.scenery.street.street_furniture import Furnisher

MAPS = pathlib.Path(__file__).parents[3] / "maps"
EVERYWHERE = {"lamp", "bench", "bin", "hydrant", "street_name", "cabinet", "post_box"}
CITIES = {"newspaper_box", "planter", "bus_shelter"}
QUIET = {"hedge"}
WANTED = {
    "Town01": EVERYWHERE | QUIET,
    "Town03": EVERYWHERE | CITIES | QUIET | {"column", "banner"},
    "Town05": EVERYWHERE | CITIES | QUIET | {"column", "banner"},
    "Town10": EVERYWHERE | CITIES | {"banner"},
}


def furnished(name: str) -> tuple[Furnisher, list[Strip], LaneNetwork]:
    config = TownConfig.from_toml(MAPS / name / "town.toml")
    network = town_network(name)
    strips = road_strips(network.xodr.roads, network.surface)
    corners = network.tables.position_m[:, :2]
    zones = zone_areas(config, shapely.box(*corners.min(axis=0) - 60.0, *corners.max(axis=0) + 60.0))
    furnisher = Furnisher(zones, np.zeros((0, 2)), None, [], shapely.Polygon(), 1)
    for strip in strips:
        if strip.junction_id is None:
            furnisher.sidewalk(strip)
    return furnisher, strips, network


@pytest.mark.parametrize("name", WANTED)
def test_sidewalks_carry_what_they_should(name: str) -> None:
    furnisher, _, _ = furnished(name)
    names = {key[0] for key in furnisher.placed.bases_m}
    assert names >= WANTED[name]
    assert len({kind for kind in names if kind.startswith("tree ")}) >= 2
    for key, bases_m in furnisher.placed.bases_m.items():
        assert len(bases_m) == len(furnisher.placed.yaws[key])


def test_roads_have_their_history_and_no_more() -> None:
    """Patches, sealed cracks, seams, tyre marks, covers and drains on less than a fiftieth of the lanes."""
    _, strips, network = furnished("Town03")
    out = MeshBuilder()
    add_road_details(out, strips, network.xodr.roads, 1)
    lane_m = sum(lane.length_m for lane in network.lanes if lane.type == "driving")
    details = out.build()
    a, b, c = details.vertices_m[details.triangles].astype(np.float64).transpose(1, 0, 2)
    area_m2 = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert 0.002 * 3.5 * lane_m < area_m2 < 0.02 * 3.5 * lane_m
    assert len(np.unique(details.material)) >= 3


def test_roads_are_laid_in_castings() -> None:
    """One ends every 45–140 m: nowhere else do the columns of a lane change their tone."""
    _, strips, _ = furnished("Town03")
    for strip in strips:
        ends = casting_ends(strip, 1)
        lengths = np.diff([strip.s_m[0], *ends, strip.s_m[-1]])
        assert (lengths[:-1] >= 45.0).all()
        assert (lengths <= 140.0 + 13.5).all()


def test_sidewalks_have_lids_and_mended_places() -> None:
    """One for every 60 m² or so: flat on the slabs, on no roadway, none over another."""
    _, strips, network = furnished("Town01")
    out = MeshBuilder()
    add_sidewalk_wear(out, strips, network.xodr.roads, 1)
    mesh = out.build()
    walks, roadway = [], []
    for strip in strips:
        for lane in range(len(strip.lanes)):
            area = strip_polygon(strip.edges_m[lane], strip.edges_m[lane + 1])
            if strip.kind(lane) == "roadway":
                roadway.append(area)
            elif strip.kind(lane) == "sidewalk" and strip.junction_id is None:
                walks.append(area)
    corners = mesh.vertices_m[mesh.triangles].astype(np.float64)
    corners = corners[mesh.material[mesh.triangles[:, 0]] != Material.PLAIN]
    places = shapely.polygons(corners[..., :2])
    total = sum(area.area for area in walks)
    assert total / 150.0 < 0.5 * len(places) < total / 40.0
    assert shapely.area(shapely.intersection(shapely.union_all(roadway), places)).sum() < 1e-3
    np.testing.assert_allclose(shapely.union_all(places).area, shapely.area(places).sum(), rtol=1e-3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0.99 * np.linalg.norm(normals, axis=1)).all()
    assert np.isclose(MATERIALS[Material.PAVEMENT].tile_m, (4 * SLAB_M[0], 6 * SLAB_M[1])).all()
