"""Footbridges over a made-up motorway on level ground."""

import numpy as np
import pytest
import shapely

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import Feature
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.structures.footbridges import (
    DEPTH_M,
    FOOTBRIDGE_CLEAR_M,
    PIER_CLEAR_M,
    RAILING_M,
    footbridge,
    pier_places,
)

o3d = pytest.importorskip("open3d", reason="Open3D casts the rays of these tests")
CARRIAGEWAYS = shapely.union_all([shapely.box(-200, -19, 200, -3), shapely.box(-200, 3, 200, 19)])


def level(xy_m: Array) -> Array:
    """Ground at 1 m."""
    return np.ones(len(xy_m))


@pytest.fixture(scope="module")
def bridge() -> Mesh:
    """A bridge along y over both carriageways."""
    return footbridge(
        Feature(kind="footbridge", position=(5.0, 0.0), heading_deg=90.0, size=(50.0,)), CARRIAGEWAYS, level
    )


def cast(mesh: Mesh, origin: Array, direction: tuple[float, float, float]) -> Array:
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(mesh.vertices_m), o3d.core.Tensor(mesh.triangles.astype(np.uint32)))
    rays = np.concatenate([origin, np.tile(direction, (len(origin), 1))], axis=1).astype(np.float32)
    return np.asarray(scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy(), dtype=np.float64)


def test_it_leaves_the_clear_height_over_every_lane(bridge: Mesh) -> None:
    over = np.stack(np.meshgrid(np.arange(3.0, 7.0, 0.2), np.arange(-19.0, 19.0, 0.2)), -1).reshape(-1, 2)
    over = over[shapely.contains_xy(CARRIAGEWAYS, over[:, 0], over[:, 1])]
    free = cast(bridge, np.column_stack([over, np.ones(len(over))]), (0.0, 0.0, 1.0))
    assert np.isfinite(free).mean() > 0.6
    np.testing.assert_allclose(free[np.isfinite(free)].min(), FOOTBRIDGE_CLEAR_M, atol=0.01)


def test_one_can_walk_from_the_ground_over_it_and_down_again(bridge: Mesh) -> None:
    """Seen from above its middle rises and falls in steps of a stair, without a gap."""
    length = bridge.vertices_m[:, 1]
    y = np.arange(length.min() + 0.05, length.max() - 0.05, 0.05)
    eyes = np.column_stack([np.full(len(y), 5.2), y, np.full(len(y), 30.0)])
    top = 30.0 - cast(bridge, eyes, (0.0, 0.0, -1.0))
    assert np.isfinite(top).all()
    assert np.abs(np.diff(top)).max() < 0.17
    assert top[[0, -1]].max() < 1.25
    np.testing.assert_allclose(top.max(), 1.0 + FOOTBRIDGE_CLEAR_M + DEPTH_M, atol=0.01)


def test_railings_keep_walkers_on_it(bridge: Mesh) -> None:
    eyes = np.column_stack(
        [np.full(40, 5.0), np.linspace(-24, 24, 40), np.full(40, 1.0 + FOOTBRIDGE_CLEAR_M + DEPTH_M)]
    )
    for height in (0.38, 0.72, RAILING_M):
        for side in (1.0, -1.0):
            gap = cast(bridge, eyes + np.array([0.0, 0.0, height]), (side, 0.0, 0.0))
            assert (gap < 1.5).all()


def test_piers_stand_beside_the_roads_and_on_the_median() -> None:
    y = np.arange(-25.0, 26.0)
    distance = shapely.distance(CARRIAGEWAYS, shapely.points(np.column_stack([0 * y, y])))
    places = pier_places(y, distance)
    assert len(places) == 3
    assert places[1] == 0.0
    assert shapely.distance(CARRIAGEWAYS, shapely.points([(0.0, p) for p in places])).min() > PIER_CLEAR_M
    assert pier_places(y, np.zeros(51)) == []
