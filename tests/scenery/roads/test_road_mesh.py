"""Road meshes against the analytic surface, by rays from above."""

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.lanes import Lane
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_separation import find_levels
from carlaloc_env.scenery.ground.lane_strips import road_strips
from carlaloc_env.scenery.ground.terrain import Zones
from carlaloc_env.scenery.roads.sidewalks import KERB_STONE_M, RAMP_M
from carlaloc_env.town.town import Town

o3d = pytest.importorskip("open3d", reason="Open3D casts the rays of these tests")


def _scene(vertices: Array, triangles: NDArray[np.integer]) -> o3d.t.geometry.RaycastingScene:
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.asarray(vertices, np.float32)), o3d.core.Tensor(np.asarray(triangles, np.uint32))
    )
    return scene


def _only(mesh: Mesh, *tags: Tag) -> o3d.t.geometry.RaycastingScene:
    keep = np.isin(mesh.tag[mesh.triangles[:, 0]], tags)
    return _scene(mesh.vertices_m, mesh.triangles[keep])


def _drop(scene: o3d.t.geometry.RaycastingScene, points: Array, above_m: float = 1.0) -> Array:
    """Height of the first surface below points `above_m` over the given ones, (M,); NaN without a hit."""
    rays = np.zeros((len(points), 6), np.float32)
    rays[:, :3] = points
    rays[:, 2] += above_m
    rays[:, 5] = -1.0
    distance = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    height: Array = np.where(np.isfinite(distance), rays[:, 2] - distance, np.nan)
    return height


def _lane_points(town: Town, kinds: tuple[str, ...], count: int, *, junctions: bool) -> Array:
    """Analytic points (M, 3) scattered over lanes, away from their edges."""
    rng = np.random.default_rng(3)
    lanes: list[Lane] = [
        lane
        for lane in town.network.lanes
        if lane.type in kinds and lane.length_m > 2.0 and (lane.junction_id is not None) == junctions
    ]
    weights = np.array([lane.length_m for lane in lanes])
    pick = rng.choice(len(lanes), count, p=weights / weights.sum())
    index = np.array([lanes[k].index for k in pick])
    station = rng.uniform(0.5, weights[pick] - 0.5)
    width = town.network.width_m(index, station)
    index, station = index[width > 1.0], station[width > 1.0]
    surface, edges = town.network.surface, town.network.surface.edges
    s = town.network.s_m(index, station)
    t = edges.centre(index, s).t_m + rng.uniform(-0.4, 0.4, len(s)) * edges.width(index, s)
    return surface.position(edges.road[index], s, t)


def test_road_is_within_one_centimetre_of_the_analytic_surface(town03: Town, town03_mesh: Mesh) -> None:
    points = _lane_points(town03, ("driving",), 20000, junctions=False)
    error = np.abs(_drop(_only(town03_mesh, Tag.ROAD), points) - points[:, 2])
    assert np.isfinite(error).all()
    assert error.max() < 0.01


def test_junctions_are_within_one_centimetre_of_their_connecting_roads(
    town03: Town, town03_mesh: Mesh
) -> None:
    points = _lane_points(town03, ("driving",), 20000, junctions=True)
    error = np.abs(_drop(_only(town03_mesh, Tag.ROAD), points) - points[:, 2])
    assert np.isfinite(error).all()
    assert np.quantile(error, 0.999) < 0.01
    assert error.max() < 0.03


def test_wheels_meet_the_same_surface(town03: Town) -> None:
    scene = _scene(town03.outline.collision_vertices_m, town03.outline.collision_triangles)
    for junctions in (False, True):
        points = _lane_points(town03, ("driving",), 10000, junctions=junctions)
        error = np.abs(_drop(scene, points) - points[:, 2])
        assert np.isfinite(error).all()
        assert np.quantile(error, 0.999) < 0.01


def test_markings_lie_on_the_road(town03_mesh: Mesh) -> None:
    paint = town03_mesh.triangles[town03_mesh.tag[town03_mesh.triangles[:, 0]] == Tag.ROAD_LINE]
    corners = town03_mesh.vertices_m[paint].astype(np.float64)
    inside = np.array([0.5, 0.3, 0.2]) @ corners
    height = inside[:, 2] - _drop(_only(town03_mesh, Tag.ROAD, Tag.SIDEWALK), inside, above_m=0.5)
    assert np.isfinite(height).mean() > 0.999
    height = height[np.isfinite(height)]
    assert np.quantile(height, 0.001) > 0.002
    assert np.quantile(height, 0.999) < 0.008


def test_sidewalks_stand_one_kerb_above_the_road(town03: Town, town03_mesh: Mesh) -> None:
    """The map says 0.15 m; before crosswalks kerbs are dropped."""
    points = _lane_points(town03, ("sidewalk",), 5000, junctions=False)
    walks = shapely.union_all([shapely.Polygon(walk.polygon_m[:, :2]) for walk in town03.network.crosswalks])
    points = points[shapely.distance(walks, shapely.points(points[:, :2])) > RAMP_M + KERB_STONE_M]
    assert len(points) > 4000
    top = _drop(_only(town03_mesh, Tag.SIDEWALK), points)
    assert np.isfinite(top).all()
    np.testing.assert_allclose(top - points[:, 2], 0.15, atol=0.01)


def test_no_kerb_stands_in_a_lane(town03: Town, town03_mesh: Mesh) -> None:
    for junctions in (False, True):
        points = _lane_points(town03, ("driving",), 10000, junctions=junctions)
        top = _drop(_only(town03_mesh, Tag.SIDEWALK, Tag.TERRAIN, Tag.GROUND), points, above_m=0.6)
        over = np.nan_to_num(top - points[:, 2], nan=-1.0)
        assert (over > 0.02).mean() < 1e-3


def test_vehicles_have_room_above_every_lane(town03: Town, town03_mesh: Mesh) -> None:
    solid = _only(
        town03_mesh, Tag.BRIDGE, Tag.WALL, Tag.BUILDING, Tag.TERRAIN, Tag.GROUND, Tag.ROAD, Tag.SIDEWALK
    )
    for junctions in (False, True):
        points = _lane_points(town03, ("driving",), 10000, junctions=junctions)
        rays = np.concatenate(
            [points + np.array([0.0, 0.0, 0.2]), np.tile([0.0, 0.0, 1.0], (len(points), 1))], axis=1
        )
        free = solid.cast_rays(o3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy() + 0.2
        assert free.min() > 4.5


def test_the_boulevard_dives_under_a_roof(town03: Town) -> None:
    strips = road_strips(town03.network.xodr.roads, town03.network.surface)
    levels = find_levels(strips, np.full(2, -300.0), np.full(2, 300.0), Zones())
    assert len(levels.stretches) == 1
    stretch = levels.stretches[0]
    assert 55.0 < stretch.detached.sum() < 65.0
    assert (stretch.left_top_m - stretch.left_m)[:, 2].max() > 5.5


def test_the_surface_looks_up(town03_mesh: Mesh) -> None:
    triangles = town03_mesh.triangles[
        np.isin(town03_mesh.tag[town03_mesh.triangles[:, 0]], (Tag.ROAD, Tag.ROAD_LINE))
    ]
    a, b, c = (town03_mesh.vertices_m[triangles[:, k]].astype(np.float64) for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > -1e-6).all()
