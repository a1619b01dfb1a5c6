"""What the renderer leaves out changes nothing: clusters, hidden boxes, lamps that light nothing."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import (
    CAMERA,
    FORWARD,
    need_opengl,
    quad,
    rays_z1,
    scene,
    standing,
    wall,
)
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.core import transforms
from carlaloc_env.render.geometry.level_of_detail import FAR_LOW, gathered
from carlaloc_env.render.geometry.mesh_buffers import MeshBuffers
from carlaloc_env.render.geometry.occlusion_culling import Depths, box_corners
from carlaloc_env.render.lighting.light_grid import LIGHT_CUTOFF, light_grid
from carlaloc_env.render.lighting.light_sources import nearest, street_lamps
from carlaloc_env.render.lighting.light_tiles import TILE_PX, DepthRange
from carlaloc_env.render.views import CameraView
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Instances, Mesh, ModelLibrary, make_mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.presets import PRESETS


def soup(count: int, seed: int, low_m: tuple[float, ...], high_m: tuple[float, ...], size_m: float) -> Mesh:
    """Triangles of random places, sizes and sides."""
    random = np.random.default_rng(seed)
    middle = random.uniform(low_m, high_m, (count, 1, 3))
    corners = middle + random.normal(0.0, size_m, (count, 3, 3)) * random.uniform(0.1, 1.0, (count, 1, 1))
    return make_mesh(
        corners.reshape(-1, 3),
        np.arange(3 * count).reshape(-1, 3),
        material=Material.BARK,
        tag=Tag.VEGETATION,
        instance=seed,
    )


def test_a_box_that_shows_in_any_pixel_is_not_hidden() -> None:
    """Random boxes before a random relief, against points inside them that lie before it."""
    random = np.random.default_rng(8)
    turn = transforms.quat_to_matrix(transforms.rpy_to_quat(0.1, -0.2, 1.0))
    view = CameraView.of(CAMERA, transforms.from_rotation(turn @ transforms.R_FLU_OPTICAL, (5.0, -3.0, 1.6)))
    depth = np.kron(random.uniform(4.0, 60.0, (9, 16)), np.ones((20, 20))).astype(np.float32)
    depth[:20, :60] = 0.0
    low = view.position_m + random.uniform(-40.0, 40.0, (4000, 3))
    high = low + random.uniform(0.1, 4.0, (4000, 3))
    shown = Depths(view, depth).shown(box_corners(low, high))
    points = low[:, None] + (high - low)[:, None] * random.random((4000, 200, 3))
    p = (points - view.position_m) @ view.R_camera_world.T
    z = np.maximum(p[..., 2], 1e-3)
    u = np.rint(p[..., 0] / z * CAMERA.fx_px + CAMERA.cx_px)
    v = np.rint(p[..., 1] / z * CAMERA.fy_px + CAMERA.cy_px)
    inside = (p[..., 2] > 0.2) & (u >= 0) & (u < 320) & (v >= 0) & (v < 180)
    there = depth[np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int)]
    seen = (inside & ((there == 0.0) | (p[..., 2] < there))).any(axis=1)
    assert seen.sum() > 200
    assert np.all(shown[seen])
    assert (~shown).sum() > 1000


@pytest.mark.parametrize("quality", ["low", "medium", "high"])
def test_culling_leaves_the_picture_as_it_is(quality: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A street of random triangles behind walls, drawn with and without the test for what hides."""
    need_opengl()
    chunks = [soup(1500, k + 1, (8.0 * k, -15.0, 0.0), (8.0 * k + 8.0, 15.0, 6.0), 1.2) for k in range(12)]
    chunks[3] = merge([chunks[3], wall(30.0, (-3.0, 0.0), (12.0, 9.0))])

    def picture() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
        with scene(*chunks, quality=quality) as renderer:
            gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
            return gbuffer.depth_m(), gbuffer.labels()[1]

    asked = []
    plain = Depths.shown

    def counting(self: Depths, corners_m: NDArray[np.float64], *, least_px: float = 0.0) -> NDArray[np.bool_]:
        asked.append(plain(self, corners_m, least_px=least_px))
        return asked[-1]

    def everything(
        self: Depths, corners_m: NDArray[np.float64], *, least_px: float = 0.0
    ) -> NDArray[np.bool_]:
        return np.ones(len(corners_m), bool)

    monkeypatch.setattr(Depths, "shown", counting)
    depth, instance = picture()
    hidden = sum(np.count_nonzero(~shown) for shown in asked)
    monkeypatch.setattr(Depths, "shown", everything)
    whole_depth, whole_instance = picture()
    np.testing.assert_array_equal(depth, whole_depth)
    np.testing.assert_array_equal(instance, whole_instance)
    assert hidden > 2


def test_the_last_picture_hides_what_the_next_would_hide() -> None:
    """A drive through a street: left out by the last picture, nearly every pixel is as without it.

    A lorry that stands in the way drives off; what it hid must come out at once.
    """
    need_opengl()
    houses = [Scenery.box((x, y, 0.0), (x + 9.0, y + 8.0, 12.0)) for x in range(0, 120, 14) for y in (-14, 7)]
    crumbs = [soup(900, k + 1, (8.0 * k, -40.0, 0.0), (8.0 * k + 8.0, 40.0, 5.0), 0.3) for k in range(15)]
    library = ModelLibrary({"lorry": Scenery.box((0.0, -3.5, 0.0), (6.0, 3.5, 5.0))})
    drawn, seen_again = [], []
    plain = MeshBuffers.draw

    def counting(self: MeshBuffers, program: object, which: NDArray[np.intp], **more: object) -> None:
        drawn.append(int(self.count[which].sum()))
        plain(self, program, which, **more)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MeshBuffers, "draw", counting)
        with scene(*houses, *crumbs, library=library) as renderer:
            earlier, carried, by_rounds, different = None, [], [], []
            for k in range(12):
                turn = transforms.quat_to_matrix(transforms.rpy_to_quat(0.0, 0.0, 0.03 * k))
                pose = transforms.from_rotation(turn @ transforms.R_FLU_OPTICAL, (0.8 * k, 0.2 * k, 1.6))
                lorry = transforms.from_rotation(np.eye(3), (12.0 + 0.8 * k, 0.0 if k < 6 else 9.0, 0.0))
                instances = standing(lorry, instance=EGO_INSTANCE + 1, tint=255)
                drawn.clear()
                with_last = renderer.draw(CAMERA, pose, instances, earlier=earlier)
                carried.append(sum(drawn))
                drawn.clear()
                alone = renderer.draw(CAMERA, pose, instances)
                by_rounds.append(sum(drawn))
                a, b = with_last.depth_m(), alone.depth_m()
                different.append(float(np.mean(np.abs(a - b) > 0.01 * np.maximum(a, b))))
                seen_again.append(bool(np.any(b[80:90, 150:170] > 30.0)))
                earlier = with_last
    assert seen_again[6], "the lorry has left the view along the street"
    assert max(different) < 2e-3
    assert sum(carried[1:6]) < 1.05 * sum(by_rounds[1:6]), "it knows as much as half a picture read back"


def test_gathered_corners_keep_the_ground_whole() -> None:
    """A street in strips of a metre between kerbs: far fewer triangles, the same area, the same borders."""
    x, y = np.meshgrid(np.arange(0.0, 61.0), np.array([-4.0, -1.3, 1.3, 4.0]), indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(60), np.arange(3), indexing="ij"))
    corner = 4 * i + j
    quads = np.stack([corner, corner + 4, corner + 5, corner + 1], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    street = make_mesh(vertices, triangles, material=Material.ASPHALT, tag=Tag.ROAD)
    beside = vertices.copy()
    beside[:, 1] = 5.0 + 0.25 * (vertices[:, 1] + 4.0)
    beside[np.isclose(vertices[:, 1], -4.0), 1] = 4.0
    walk = make_mesh(beside, triangles, material=Material.PAVEMENT, tag=Tag.SIDEWALK)
    whole = merge([street, walk])
    far, _ = gathered(whole, FAR_LOW[3])
    assert len(far.triangles) < 0.5 * len(whole.triangles)
    of_street = far.material[far.triangles[:, 2]] == Material.ASPHALT
    corners = far.vertices_m[far.triangles[of_street]]
    assert corners[..., 1].max() == pytest.approx(4.0), "the border to the pavement stays"
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert 0.5 * across.sum() == pytest.approx(60.0 * 8.0, rel=0.12)
    known = {tuple(place) for place in whole.vertices_m.tolist()}
    assert {tuple(place) for place in far.vertices_m.tolist()} <= known, "corners move to corners only"


def test_lamps_left_out_of_a_tile_light_nothing_in_it() -> None:
    """Over a relief of blocks, against the light of every lamp at every pixel."""
    random = np.random.default_rng(4)
    view = CameraView.of(CAMERA, FORWARD)
    depth = np.kron(random.uniform(5.0, 40.0, (12, 20)), np.ones((15, 16))).astype(np.float32)
    lamps = street_lamps(random.uniform([-5, -40, 2], [60, 40, 9], (60, 3)))
    lights = nearest(lamps, view.position_m)
    exposure = 0.02
    grid = light_grid(view, lights, DepthRange.of(depth), depth_m=depth, exposure=exposure)
    whole = light_grid(view, lights, DepthRange.of(depth))
    points = view.position_m + (rays_z1(CAMERA) * depth[..., None]) @ view.R_camera_world
    way = points[..., None, :] - lights.position_m
    far2 = np.maximum(np.sum(way**2, axis=-1), 0.25)
    cosine = -way[..., 2] / np.sqrt(far2)
    t = np.clip((cosine - 0.17) / 0.3, 0.0, 1.0)
    beam = np.minimum(1.0 / (np.maximum(cosine, 0.0) ** 3 + 1e-3), 3.5) * t * t * (3 - 2 * t)
    fade = np.maximum(1.0 - (far2 / lights.range_m**2) ** 2, 0.0) ** 2
    light = lights.colour_cd.max() * exposure / math.pi * beam * fade / far2
    for tile in grid.groups.tiles:
        column, row = tile["cell"]
        box = np.s_[row * TILE_PX : (row + 1) * TILE_PX, column * TILE_PX : (column + 1) * TILE_PX]
        listed = set(grid.entries[tile["lamps"][0] : tile["lamps"][1]])
        lit = np.flatnonzero((light[box] > 1.5 * LIGHT_CUTOFF).mean(axis=(0, 1)) > 0.02)
        assert set(lit) <= listed
    assert len(grid.entries) < 0.75 * len(whole.entries)


def test_a_model_wears_as_the_town_does() -> None:
    """Asphalt from 12 m above, and its model 1 : 20 from 0.6 m: the same albedo."""
    town, model = road_from_above(), road_from_above(shrink=20.0, unit_m=20.0)
    wrong = road_from_above(shrink=20.0)
    assert town.std() > 0.01 * town.mean()
    assert np.mean(np.abs(model - town)) < 0.2 * np.mean(np.abs(wrong - town))


def road_from_above(*, shrink: float = 1.0, unit_m: float = 1.0) -> NDArray[np.float32]:
    """Light [cd/m²] of a plane 12 m below the camera; all of it 1 : `shrink`."""
    need_opengl()
    corners = np.array([[-30.0, -30.0, 0.0], [30.0, -30.0, 0.0], [30.0, 30.0, 0.0], [-30.0, 30.0, 0.0]])
    road = quad(corners / shrink, Material.ASPHALT, Tag.ROAD)
    down = np.array([[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, -1.0, 12.0 / shrink], [0, 0, 0, 1.0]])
    with scene(road, quality="medium", unit_m=unit_m) as drawn:
        gbuffer = drawn.draw(CAMERA, down, Instances())
        return drawn.radiance_cd_m2(gbuffer, PRESETS["CloudyNoon"])
