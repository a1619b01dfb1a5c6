"""Direction signs before exits: where the rules want them, clear of lanes, turned towards those who come."""

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.assets.direction_signs import CLEAR_M, cantilever, countdown_marker, verge_sign
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.sources import find_town
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.ground.ground_plan import Groundwork, lay_groundwork
from carlaloc_env.scenery.meshing.props import InstanceIds, PropField
from carlaloc_env.scenery.structures.exit_signs import MARKERS_M, OVERHEAD_M, SHIFTS_M, add_exit_signs, exits

NOTHING = shapely.Polygon()


@pytest.fixture(scope="module")
def work() -> Groundwork:
    """Groundwork of Town04."""
    config = TownConfig.from_toml(find_town("Town04").with_name("town.toml"))
    return lay_groundwork(town_network("Town04"), config)


@pytest.fixture(scope="module")
def placed(work: Groundwork) -> tuple[PropField, Array]:
    """Signs of Town04 and their feet."""
    props = PropField()
    bases_m = add_exit_signs(
        props, town_network("Town04"), work.areas.paved, NOTHING, work.overhead, work.ground.height
    )
    return props, bases_m


def volume_m3(mesh: Mesh) -> float:
    """Volume enclosed by outward faces [m³]."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def test_exits_are_those_of_the_plan() -> None:
    network = town_network("Town04")
    names = {
        network.xodr.roads[network.road_index[network.lanes[e.ramp].road_id]].name for e in exits(network)
    }
    assert names == {f"{side} {ring} exit ramp" for side in ("East", "West") for ring in ("inner", "outer")}
    for name in ("Town01", "Town03", "Town05", "Town07", "Town10"):
        assert exits(town_network(name)) == []


def test_each_exit_is_announced_where_the_rules_say(placed: tuple[PropField, Array]) -> None:
    """Every exit has its markers and cantilevers; the distances are those along the road."""
    props, _ = placed
    network = town_network("Town04")
    for kind, distances in (("cantilever", OVERHEAD_M), ("countdown", MARKERS_M)):
        bases_m = props.bases_m(lambda key, kind=kind: isinstance(key, tuple) and key[0] == kind)
        for way in exits(network):
            begin = network.pose([way.ramp], [0.0]).position_m[0]
            direct = np.hypot(*(bases_m - begin)[:, :2].T)
            # Bends make the straight line shorter than the road.
            for distance in distances:
                assert (direct < distance + max(SHIFTS_M) + 15.0).any()
        assert len(bases_m) >= 0.7 * len(exits(network)) * len(distances)
    nearest = np.hypot(*(bases_m[:, None] - _begins()[None])[..., :2].transpose(2, 0, 1)).min(axis=1)
    np.testing.assert_allclose(np.sort(nearest)[:4], 100.0, atol=15.0)


def test_none_stands_on_anything_paved_or_in_the_way(
    placed: tuple[PropField, Array], work: Groundwork
) -> None:
    props, bases_m = placed
    ground = bases_m[np.abs(bases_m[:, 2] - work.ground.height(bases_m[:, :2])) < 0.3]
    assert len(ground) > 15
    assert shapely.distance(work.areas.paved, shapely.points(ground[:, :2])).min() > 0.8
    inner = shapely.buffer(work.areas.paved, -0.2)
    shapely.prepare(inner)
    for mesh in props.meshes(InstanceIds()):
        for sign in np.unique(mesh.instance):
            points = mesh.vertices_m[mesh.instance == sign].astype(np.float64)
            low = points[points[:, 2] < points[:, 2].min() + 3.0]
            assert not shapely.contains_xy(inner, low[:, 0], low[:, 1]).any()


def test_faces_look_at_those_who_come(placed: tuple[PropField, Array]) -> None:
    props, _ = placed
    network = town_network("Town04")
    for places in props._places.values():
        for bases_m, yaw, _, _ in places:
            near = network.nearest(bases_m[:, :2])
            heading = network.pose(near.lane, near.station_m).heading_rad
            assert (np.cos(yaw - heading) < -0.8).all()


@pytest.mark.parametrize("low_m", [0.0, 0.6, -0.8])
def test_what_hangs_over_the_road_leaves_its_clear_height(low_m: float) -> None:
    mesh = cantilever(9.5, 1, 2, 3, low_m=low_m)
    over = mesh.vertices_m[mesh.vertices_m[:, 1] < -1.0]
    assert over[:, 2].min() >= low_m + CLEAR_M - 0.5
    assert over[:, 1].min() > -10.5


def test_signs_are_closed_and_stand_on_their_feet() -> None:
    for mesh in (countdown_marker(3), verge_sign(1, 2), cantilever(9.5, 0, 1, 2)):
        assert volume_m3(mesh) > 0.0
        assert -0.5 < mesh.vertices_m[:, 2].min() < 0.0
    assert len(countdown_marker(3).triangles) == len(countdown_marker(1).triangles) + 4


def _begins() -> Array:
    net = town_network("Town04")
    return np.concatenate([net.pose([way.ramp], [0.0]).position_m for way in exits(net)])
