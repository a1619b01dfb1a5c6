"""Depth, labels and places of what is drawn, against the pinhole, the plane equation and Embree."""

from collections.abc import Iterator

import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import (
    CAMERA,
    EYE_M,
    FORWARD,
    ground,
    need_opengl,
    quad,
    rays_z1,
    scene,
    standing,
    wall,
)

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.render.views import CameraView
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, ModelLibrary, make_mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

need_opengl()


@pytest.fixture(scope="module")
def street() -> Iterator[SceneRenderer]:
    with scene(ground(), wall(20.0, (-3.0, 0.0), (5.0, 4.0), instance=77)) as renderer:
        yield renderer


@pytest.mark.parametrize("quality", ["low", "medium", "high"])
def test_quad_covers_the_pixels_that_the_pinhole_says(quality: str) -> None:
    """Every pixel whose centre lies inside the projected outline, and no other."""
    low, high = (-1.23, 0.71), (2.37, 2.93)
    camera = Pinhole(width_px=200, height_px=120, fx_px=150.0, fy_px=140.0, cx_px=96.3, cy_px=65.8)
    T = transforms.from_rotation(transforms.R_FLU_OPTICAL, (0.3, 0.1, 1.7))
    corners = np.array([[9.0, high[0], high[1]], [9.0, low[0], low[1]]])
    (u0, v0), (u1, v1) = camera.project(transforms.apply(transforms.invert(T), corners))
    with scene(wall(9.0, low, high), quality=quality) as renderer:
        tag, _ = renderer.draw(camera, T, Instances()).labels()
    v, u = np.mgrid[:120, :200]
    np.testing.assert_array_equal(tag == Tag.WALL, (u > u0) & (u < u1) & (v > v0) & (v < v1))


@pytest.mark.parametrize("quality", ["low", "high"])
def test_depth_of_a_plane_is_exact(quality: str) -> None:
    """Planar depth of the ground under a tilted camera, against the plane equation."""
    turn = transforms.quat_to_matrix(transforms.rpy_to_quat(0.1, 0.2, 0.7))
    T = transforms.from_rotation(turn @ transforms.R_FLU_OPTICAL, (12.0, -7.0, 1.6))
    with scene(ground(), quality=quality) as renderer:
        depth = renderer.draw(CAMERA, T, Instances()).depth_m()
    down = -(rays_z1(CAMERA) @ T[:3, :3].T)[..., 2]
    expected = 1.6 / np.where(down > 1e-9, down, np.nan)
    near = expected < 200.0
    assert near.mean() > 0.3
    assert np.all(np.abs(depth - expected)[near] < 0.01 + 0.001 * expected[near])


def test_sky_has_its_label_and_no_depth(street: SceneRenderer) -> None:
    gbuffer = street.draw(CAMERA, FORWARD, Instances())
    tag, instance = gbuffer.labels()
    assert np.all(tag[0] == Tag.SKY)
    assert np.all(gbuffer.depth_m()[0] == 0.0)
    assert np.all(instance[0] == 0)


def test_first_row_is_the_top(street: SceneRenderer) -> None:
    tag, _ = street.draw(CAMERA, FORWARD, Instances()).labels()
    assert np.all(tag[-1] == Tag.ROAD)


def test_labels_and_occlusion() -> None:
    """A near wall hides a far one; ids of 24 bits come through."""
    near = wall(8.0, (-1.0, 0.0), (1.0, 3.0), tag=Tag.POLE, instance=(1 << 23) - 1)
    far = wall(15.0, (-6.0, 0.0), (6.0, 6.0), tag=Tag.BUILDING, instance=5)
    for order in ((near, far), (far, near)):
        with scene(*order) as renderer:
            tag, instance = renderer.draw(CAMERA, FORWARD, Instances()).labels()
        assert (tag[90, 160], instance[90, 160]) == (Tag.POLE, (1 << 23) - 1)
        assert (tag[90, 190], instance[90, 190]) == (Tag.BUILDING, 5)


def test_instances_stand_where_their_pose_says() -> None:
    """A unit plate moved, turned and scaled by nothing lands on Pinhole.project of its corners."""
    plate = quad([[0, -1, -0.5], [0, 1, -0.5], [0, 1, 0.5], [0, -1, 0.5]], Material.CAR_PAINT, Tag.CAR)
    T = transforms.transform([10.0, 1.5, 2.0], transforms.rpy_to_quat(0.0, 0.0, 0.6))
    away = transforms.transform([-20.0, 0.0, 2.0], [0, 0, 0, 1])
    instances = standing(T, away, instance=(1 << 23) + 300)
    with scene(library=ModelLibrary({"plate": plate})) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, instances)
        tag, instance = gbuffer.labels()
        depth = gbuffer.depth_m()
    corners = transforms.apply(transforms.invert(FORWARD) @ T, plate.vertices_m)
    uv = CAMERA.project(corners)
    rows, columns = np.nonzero(tag == Tag.CAR)
    assert np.all(instance[rows, columns] == (1 << 23) + 300)
    assert columns.min() == np.ceil(uv[:, 0].min())
    assert columns.max() == np.floor(uv[:, 0].max())
    normal = transforms.invert(FORWARD)[:3, :3] @ T[:3, 0]
    centre = transforms.apply(transforms.invert(FORWARD), T[:3, 3])
    expected = (normal @ centre) / (rays_z1(CAMERA)[rows, columns] @ normal)
    np.testing.assert_allclose(depth[rows, columns], expected, atol=0.002)


def test_depth_agrees_with_embree() -> None:
    """Random boxes: 99.9 % of the pixels away from edges within 1 cm + 0.1 %."""
    o3d = pytest.importorskip("open3d")
    random = np.random.default_rng(3)
    centres = random.uniform((4, -25, 0), (80, 25, 6), (200, 3))
    offsets = random.normal(0, 1.5, (200, 3, 3))
    corners = (centres[:, None] + offsets).reshape(-1, 3)
    shards = make_mesh(corners, np.arange(600).reshape(-1, 3), material=Material.LEAF, tag=Tag.STATIC)
    whole = merge([ground(), shards])
    with scene(ground(), shards, quality="medium") as renderer:
        depth = renderer.draw(CAMERA, FORWARD, Instances()).depth_m()
    embree = o3d.t.geometry.RaycastingScene()
    embree.add_triangles(o3d.core.Tensor(whole.vertices_m), o3d.core.Tensor(whole.triangles))
    directions = rays_z1(CAMERA) @ FORWARD[:3, :3].T
    origins = np.broadcast_to(EYE_M, directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    expected = embree.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    expected[~np.isfinite(expected)] = 0.0
    steady = (expected > 0) & (expected < 200)
    for shift in (-1, 1):
        for axis in (0, 1):
            other = np.roll(expected, shift, axis)
            steady &= np.abs(other - expected) < 0.05 * expected + 0.5
    assert steady.mean() > 0.4
    good = np.abs(depth - expected) < 0.01 + 0.001 * expected
    assert good[steady].mean() > 0.999


def test_stereo_disparity_is_focal_length_times_baseline_over_depth() -> None:
    """The left edge of a pole, found in both pictures to a pixel at several depths."""
    baseline_m = 0.4
    camera = Pinhole(width_px=640, height_px=40, fx_px=640.0, fy_px=640.0, cx_px=320.0, cy_px=20.0)
    right = FORWARD.copy()
    right[:3, 3] += FORWARD[:3, 0] * baseline_m
    for depth_m in (5.0, 10.0, 25.0):
        with scene(wall(depth_m, (-0.3, 0.0), (0.3, 3.0))) as renderer:
            tags = [renderer.draw(camera, T, Instances()).labels()[0] for T in (FORWARD, right)]
        edges = [float(np.nonzero(tag[20] == Tag.WALL)[0].min()) for tag in tags]
        assert edges[0] - edges[1] == pytest.approx(camera.fx_px * baseline_m / depth_m, abs=1.0)


def test_no_visible_box_is_culled() -> None:
    """A box is kept whenever one of its random points projects into the picture."""
    random = np.random.default_rng(11)
    turn = transforms.quat_to_matrix(transforms.rpy_to_quat(0.05, -0.1, 2.0))
    view = CameraView.of(CAMERA, transforms.from_rotation(turn @ transforms.R_FLU_OPTICAL, (5.0, 3.0, 1.6)))
    low = random.uniform(-150, 150, (400, 3))
    high = low + random.uniform(1, 30, (400, 3))
    points = low[:, None] + random.random((400, 60, 3)) * (high - low)[:, None]
    local = (points - view.position_m) @ view.R_camera_world.T
    uv = CAMERA.project(local.reshape(-1, 3)).reshape(400, 60, 2)
    shown = ((uv > -0.4) & (uv < np.array([319.4, 179.4]))).all(axis=2) & (local[..., 2] > 0.5)
    kept, distance_m = view.visible(low, high)
    assert set(np.flatnonzero(shown.any(axis=1))) <= set(kept)
    assert len(kept) < 200
    assert np.all(np.diff(distance_m) >= 0)


def test_chunks_behind_a_wall_cost_nothing_and_change_nothing() -> None:
    """Far boxes peep over and past a wall: each pixel shows what one undivided mesh shows."""
    random = np.random.default_rng(8)
    blocks = [ground(), wall(30.0, (-25.0, 0.0), (12.0, 9.0), tag=Tag.WALL)]
    for number, (x, y) in enumerate(random.uniform((170, -150), (500, 150), (60, 2))):
        height = random.uniform(5, 90)
        blocks.append(
            wall(x, (y - 8, 0.0), (y + 8, height), material=Material.PLAIN, tag=Tag.BUILDING, instance=number)
        )
    with scene(*blocks) as divided, scene(merge(blocks)) as whole:
        a, b = (renderer.draw(CAMERA, FORWARD, Instances()) for renderer in (divided, whole))
        np.testing.assert_array_equal(a.labels()[1], b.labels()[1])
        np.testing.assert_array_equal(a.depth_m(), b.depth_m())
        assert len(np.unique(a.labels()[1])) > 5
