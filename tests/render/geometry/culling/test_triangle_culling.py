"""Triangles that are left out one by one show in no pixel."""

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import CAMERA, FORWARD, need_opengl, rays_z1, scene, standing

from carlaloc_env.core import transforms
from carlaloc_env.render.geometry.gbuffer import GBuffer
from carlaloc_env.render.geometry.mesh_buffers import MeshBuffers
from carlaloc_env.render.geometry.occlusion_culling import Depths
from carlaloc_env.render.geometry.triangle_culling import STILL, Body, TriangleCuller
from carlaloc_env.render.views import NEAR_M, CameraView
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Mesh, ModelLibrary, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.presets import PRESETS

TURN = transforms.quat_to_matrix(transforms.rpy_to_quat(0.1, -0.2, 1.0))
POSE = transforms.from_rotation(TURN @ transforms.R_FLU_OPTICAL, (5.0, -3.0, 1.6))


def shown(
    corners_m: NDArray[np.float64], view: CameraView, depth_m: NDArray[np.float32], solid: bool
) -> NDArray[np.bool_]:
    """Whether triangles (N, 3, 3) are before a relief at any pixel's centre, ray by ray."""
    rays = rays_z1(CAMERA)
    p = (corners_m - view.position_m) @ view.R_camera_world.T
    out = np.zeros(len(p), bool)
    # A triangle all of which lies beyond one side of the picture, or behind it, has no point in it.
    left_top, right_bottom = (rays[k, k, :2] * p[..., 2:] for k in (0, -1))
    beyond = (p[..., :2] < left_top).all(axis=1) | (p[..., :2] > right_bottom).all(axis=1)
    for k in np.flatnonzero(~beyond.any(axis=1) & (p[..., 2] > NEAR_M).any(axis=1)):
        a, b, c = p[k]
        normal = np.cross(b - a, c - a)
        if solid and normal @ a > 0.0:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (normal @ a) / (rays @ normal)
        point = rays * z[..., None]
        sides = [np.cross(q - o, point - o) @ normal >= 0.0 for o, q in ((a, b), (b, c), (c, a))]
        before = (depth_m == 0.0) | (z < depth_m - 0.1 - 0.01 * depth_m)
        out[k] = np.any(sides[0] & sides[1] & sides[2] & (z > NEAR_M) & before)
    return out


@pytest.mark.parametrize("solid", [False, True])
def test_what_is_left_out_shows_at_no_centre_of_a_pixel(solid: bool) -> None:
    random = np.random.default_rng(5)
    view = CameraView.of(CAMERA, POSE)
    depth = np.kron(random.uniform(4.0, 60.0, (9, 16)), np.ones((20, 20))).astype(np.float32)
    depth[:20, :60] = 0.0
    middle = view.position_m + random.uniform(-40.0, 40.0, (1500, 1, 3))
    size = np.exp(random.uniform(-4.0, 1.0, (1500, 1, 1)))
    corners = (middle + size * random.normal(0.0, 1.0, (1500, 3, 3))).astype(np.float32)
    body = Body(
        vertices_m=corners.reshape(-1, 3),
        triangles=np.arange(4500, dtype=np.uint32).reshape(-1, 3),
        solid=np.full(1500, solid),
    )
    first, count = np.array([0, 900], np.uint32), np.array([900, 3600], np.uint32)
    picked, kept = TriangleCuller(view, Depths(view, depth)).keep(body, first, count)
    chosen = np.zeros(1500, bool)
    chosen[picked[::3] // 3] = True
    np.testing.assert_array_equal(picked.reshape(-1, 3), body.triangles[chosen])
    assert kept.tolist() == [3 * chosen[:300].sum(), 3 * chosen[300:].sum()]
    seen = shown(corners.astype(np.float64), view, depth, solid)
    assert seen.sum() > 20
    assert np.all(chosen[seen])
    assert chosen.sum() < 3 * seen.sum(), "most of the others are left out"


def test_a_moved_body_is_picked_from_as_one_that_stands_there() -> None:
    random = np.random.default_rng(6)
    view = CameraView.of(CAMERA, POSE)
    T = transforms.from_rotation(TURN, (20.0, 9.0, 1.0))
    corners = random.normal(0.0, 2.0, (600, 3))
    triangles = np.arange(600, dtype=np.uint32).reshape(-1, 3)
    there = corners @ T[:3, :3].T + T[:3, 3]
    whole = np.array([0], np.uint32), np.array([600], np.uint32)
    picked = [
        TriangleCuller(view).keep(
            Body(vertices_m=m.astype(np.float32), triangles=triangles, solid=np.ones(200, bool)), *whole, pose
        )[0]
        for m, pose in ((corners, T[None, :3].astype(np.float32)), (there, STILL))
    ]
    assert 100 < len(picked[0]) < 600
    np.testing.assert_array_equal(picked[0], picked[1])


def crumbs(
    count: int, seed: int, at_m: tuple[float, float, float], spread_m: float, material: Material
) -> Mesh:
    """Closed tetrahedra of random sizes."""
    random = np.random.default_rng(seed)
    size = np.exp(random.uniform(-4.0, 0.3, (count, 1, 1)))
    middle = np.array(at_m) + random.uniform(-spread_m, spread_m, (count, 1, 3))
    corners = middle + size * (random.normal(0.0, 0.3, (count, 4, 3)) + np.vstack([np.zeros(3), np.eye(3)]))
    a, b, c, d = np.moveaxis(corners, 1, 0)
    inside_out = np.sum(np.cross(b - a, c - a) * (d - a), axis=1) > 0.0
    corners[inside_out, :2] = corners[inside_out, 1::-1]
    sides = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]])
    triangles = (4 * np.arange(count)[:, None, None] + sides).reshape(-1, 3)
    return make_mesh(corners.reshape(-1, 3), triangles, material=material, tag=Tag.STATIC, instance=seed)


@pytest.mark.parametrize("quality", ["low", "medium", "high"])
def test_the_picture_is_the_same_without_them(quality: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Heaps of closed bodies behind each other and moved ones, with all triangles and with the picked."""
    need_opengl()
    chunks = [crumbs(700, k + 1, (6.0 + 7.0 * k, 0.0, 2.0), 4.0, Material.BRICK_RED) for k in range(6)]
    library = ModelLibrary({"heap": crumbs(700, 9, (0.0, 0.0, 0.0), 2.0, Material.CAR_PAINT)})
    poses = [transforms.from_rotation(TURN, (x, 1.0, 1.5)) for x in (9.0, 30.0)]
    instances = standing(*poses, instance=EGO_INSTANCE + 1, tint=255)

    def picture() -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.uint8]]:
        with scene(*chunks, library=library, quality=quality) as renderer:
            gbuffer: GBuffer = renderer.draw(CAMERA, FORWARD, instances)
            rgb = renderer.shade(gbuffer, PRESETS["ClearNoon"])
            return gbuffer.depth_m(), gbuffer.labels()[1], rgb

    counts = np.zeros(2, int)
    plain = MeshBuffers.draw

    def keep(
        self: TriangleCuller, body: Body, first: object, count: NDArray[np.uint32], *pose: object
    ) -> object:
        picked, kept = sifted(self, body, first, count, *pose)  # type: ignore[arg-type]
        counts[:] += (int(count.sum()), len(picked))
        return picked, kept

    sifted = TriangleCuller.keep
    monkeypatch.setattr(TriangleCuller, "keep", keep)
    few = picture()
    assert 0 < counts[1] < 0.5 * counts[0]

    def whole(self: MeshBuffers, *rest: object, culler: object = None, **more: object) -> None:
        plain(self, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(MeshBuffers, "draw", whole)
    all_of_them = picture()
    np.testing.assert_array_equal(few[0], all_of_them[0])
    np.testing.assert_array_equal(few[1], all_of_them[1])
    # At an outline front and back lie equally deep, and without the back the front is sure to show.
    off = np.abs(few[2].astype(int) - all_of_them[2]).max(axis=2)
    assert np.mean(off > 0) < 5e-4
