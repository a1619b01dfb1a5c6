"""Fast roads against streets: what they are made of, and how little lies on them and is mended in them."""

import pathlib

import numpy as np
import pytest
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.materials import Material
from carlaloc_env.scenery.ground.lane_strips import Strip, road_strips
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.fast_roads import is_fast
from carlaloc_env.scenery.roads.lane_surfaces import add_roads
from carlaloc_env.scenery.roads.road_wear import add_road_details

MAPS = pathlib.Path(__file__).parents[3] / "maps"


def strips_by_speed(network: LaneNetwork) -> dict[bool, list[Strip]]:
    """Strips outside junctions, by whether their road is fast."""
    roads = network.xodr.roads
    strips = [s for s in road_strips(roads, network.surface) if s.junction_id is None]
    return {fast: [s for s in strips if is_fast(roads[s.road]) == fast] for fast in (False, True)}


def driving_m2(strips: list[Strip]) -> float:
    """Area of all driving lanes."""
    return sum(
        float(np.trapezoid(strip.t_m[lane] - strip.t_m[lane + 1], strip.s_m))
        for strip in strips
        for lane in range(len(strip.lanes))
        if strip.lanes[lane].type == "driving"
    )


@pytest.mark.parametrize("name", ["Town04", "Town06"])
def test_fast_lanes_have_their_own_asphalt_and_shoulders_keep_that_of_streets(name: str) -> None:
    network = town_network(name)
    made = {}
    for fast, strips in strips_by_speed(network).items():
        out = MeshBuilder()
        add_roads(out, strips, network.xodr.roads, 1)
        made[fast] = set(np.unique(out.build().material).tolist())
    assert Material.ASPHALT_MOTORWAY in made[True] - made[False]
    assert {Material.ASPHALT, Material.ASPHALT_OLD} & made[True]


def test_fast_roads_are_mended_less_and_have_no_covers() -> None:
    network = town_network("Town06")
    per_m2, rounds = {}, {}
    for fast, strips in strips_by_speed(network).items():
        out = MeshBuilder()
        add_road_details(out, strips, network.xodr.roads, 1)
        mesh = out.build()
        a, b, c = mesh.vertices_m[mesh.triangles].astype(np.float64).transpose(1, 0, 2)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        per_m2[fast] = area.sum() / driving_m2(strips)
        # The boss in the middle of a cover is the only thing on a road that is 28 bright.
        rounds[fast] = int((mesh.colour[mesh.triangles[:, 0], 0] == 28).sum())
    assert per_m2[False] > 0.01
    assert per_m2[True] < 0.35 * per_m2[False]
    assert rounds[False] > 100
    assert rounds[True] == 0
