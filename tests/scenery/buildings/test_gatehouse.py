"""A building over a street: room below it, walls beside it, light in it; and Town05's drive leads through."""

import pathlib

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from carlaloc_env.map.config import Feature, TownConfig
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.buildings.gatehouse import WING_CLEARANCE_M
from carlaloc_env.scenery.street.features import feature_lamps, feature_mesh, roofed_sites, sites

o3d = pytest.importorskip("open3d", reason="Open3D casts the rays of these tests")

TOWN05 = pathlib.Path(__file__).parents[3] / "maps/Town05"
FEATURE = Feature(kind="gatehouse", position=(100.0, 50.0), heading_deg=30.0, size=(44.0, 20.0, 5.0))
HALF_M, CLEARANCE_M = 9.0, 4.5
"""Half the width of what is paved, and the room that a lane needs above it [m]."""


def street() -> shapely.Polygon:
    """A straight street 18 m wide through the feature's place."""
    ahead = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    return shapely.LineString([FEATURE.position - 80 * ahead, FEATURE.position + 80 * ahead]).buffer(
        HALF_M, cap_style="flat"
    )


def level(xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.full(len(xy_m), 3.0)


def world(along_m: float, across_m: float) -> NDArray[np.float64]:
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    aside = np.array([c * along_m - s * across_m, s * along_m + c * across_m])
    return np.asarray(FEATURE.position + aside, dtype=np.float64)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return feature_mesh(sites([FEATURE])[0], street(), level, 1, 7)


def hits(mesh: Mesh, start: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance [m] to the mesh from points (N, 3) along ways, inf where there is nothing."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(mesh.vertices_m), o3d.core.Tensor(mesh.triangles.astype(np.uint32)))
    rays = np.concatenate([start, np.broadcast_to(way, start.shape)], axis=1).astype(np.float32)
    found: NDArray[np.float64] = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    return found


def test_there_is_a_roof_over_the_whole_street_with_room_below(mesh: Mesh) -> None:
    points = np.array(
        [(*world(a, b), 3.0) for a in np.linspace(-9.5, 9.5, 25) for b in np.linspace(-8.9, 8.9, 25)]
    )
    up = hits(mesh, points, np.array([0.0, 0.0, 1.0]))
    assert up.min() > CLEARANCE_M
    assert up.max() < 7.0
    outside = np.array([(*world(a, b), 3.0) for a in (-13.0, 13.0) for b in (-5.0, 0.0, 5.0)])
    assert np.isinf(hits(mesh, outside, np.array([0.0, 0.0, 1.0]))).all()


def test_walls_stand_beside_what_is_paved(mesh: Mesh) -> None:
    """Level rays across the street meet both wings just outside the sidewalk."""
    middle = np.array([(*world(a, 0.0), 4.5) for a in np.linspace(-9.0, 9.0, 40)])
    for sign in (-1.0, 1.0):
        across = sign * np.array([-np.sin(np.pi / 6), np.cos(np.pi / 6), 0.0])
        away = hits(mesh, middle, across)
        assert away.min() > HALF_M
        assert away.max() < HALF_M + WING_CLEARANCE_M + 0.8
    low = mesh.vertices_m[mesh.vertices_m[:, 2] < 3.0 + CLEARANCE_M].astype(np.float64)
    assert shapely.distance(street(), shapely.points(low[:, :2])).min() > 0.0


def test_it_is_one_thing_as_large_as_asked(mesh: Mesh) -> None:
    assert set(mesh.instance.tolist()) == {7}
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    away = mesh.vertices_m[:, :2].astype(np.float64) - FEATURE.position
    walls = away[mesh.vertices_m[:, 2] < 8.0] @ np.array([[c, -s], [s, c]])
    # Awnings reach 1.2 m over the sidewalks before both fronts.
    np.testing.assert_allclose(np.ptp(walls, axis=0), [20.0 + 2 * 1.15, 44.0], atol=0.2)
    # Five storeys: the passage, four of 3.6 m; a parapet and what stands on the roof.
    assert 6.2 + 4 * 3.6 < mesh.vertices_m[:, 2].max() - 3.0 < 6.2 + 4 * 3.6 + 5.0


def test_lamps_hang_below_its_roof(mesh: Mesh) -> None:
    lamps = feature_lamps(sites([FEATURE]), street(), level)
    assert len(lamps) >= 9
    assert shapely.contains_xy(
        shapely.intersection(street(), roofed_sites(sites([FEATURE]))), *lamps[:, :2].T
    ).all()
    up = hits(mesh, lamps, np.array([0.0, 0.0, 1.0]))
    assert (up < 0.6).all()
    assert (lamps[:, 2] - 3.0 > CLEARANCE_M).all()


def test_town05_is_driven_below_one() -> None:
    config = TownConfig.from_toml(TOWN05 / "town.toml")
    network = build_network(TOWN05 / "town.xodr")
    route = plan_route(network, config.route.points, length_m=config.route.length_m)
    roof = roofed_sites(sites(config.features))
    below = shapely.contains_xy(roof, *route.position_m[:, :2].T)
    step = np.hypot(*np.diff(route.position_m[:, :2], axis=0).T)
    assert float(step[below[1:]].sum()) == pytest.approx(24.0, abs=1.0)
