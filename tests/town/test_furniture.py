"""Everything that streets are known by stands somewhere along the pavements of our towns."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest
import shapely

from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.furniture import Furnisher
from carlaloc_env.town.meshing import MeshBuilder
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.town.road_details import add_road_details
from carlaloc_env.town.sections import Strip, road_strips
from carlaloc_env.town.terrain import zone_areas

MAPS = pathlib.Path(__file__).parents[2] / "maps"
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
    network = LaneNetwork.from_opendrive(MAPS / name / "town.xodr")
    strips = road_strips(network.xodr.roads, network.surface)
    corners = network.tables.position_m[:, :2]
    zones = zone_areas(config, shapely.box(*corners.min(axis=0) - 60.0, *corners.max(axis=0) + 60.0))
    furnisher = Furnisher(zones, np.zeros((0, 2)), None, [], shapely.Polygon(), 1)
    for strip in strips:
        if strip.junction_id is None:
            furnisher.pavement(strip)
    return furnisher, strips, network


@pytest.mark.parametrize("name", WANTED)
def test_pavements_carry_what_they_should(name: str) -> None:
    furnisher, _, _ = furnished(name)
    names = {key[0] for key in furnisher.placed.feet}
    assert names >= WANTED[name]
    assert len({kind for kind in names if kind.startswith("tree ")}) >= 2
    for key, feet in furnisher.placed.feet.items():
        assert len(feet) == len(furnisher.placed.yaws[key])


def test_roads_have_their_history() -> None:
    """Patches, sealed cracks, joints, tyre marks and covers: several for every 100 m of lane."""
    _, strips, network = furnished("Town03")
    out = MeshBuilder()
    add_road_details(out, strips, network.xodr.roads, 1)
    lane_m = sum(lane.length_m for lane in network.lanes if lane.type == "driving")
    details = out.build()
    assert len(details.triangles) > 0.5 * lane_m
    assert len(np.unique(details.material)) >= 3
