"""What shading saves by looking at tiles first, and its short cuts, against the formulas they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import RenderError
from carlaloc_env.render import shading
from carlaloc_env.render.geometry.material_table import plain_albedo
from carlaloc_env.render.geometry.projection import CameraView
from carlaloc_env.render.gl.context import create_context
from carlaloc_env.render.lighting import tiled_lights
from carlaloc_env.render.lighting.day_tiles import under
from carlaloc_env.render.lighting.screen_tiles import TILE_PX, DepthRange
from carlaloc_env.render.lighting.shadow_maps import light_axes
from carlaloc_env.render.lighting.sky_model import sky_light
from carlaloc_env.render.lighting.sky_textures import Skies
from carlaloc_env.render.lighting.tile_kernels import level_tiles
from carlaloc_env.render.lighting.tiled_lights import LEVEL_UP
from carlaloc_env.render.precipitation.rain_layer import developed
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import PRESETS

try:
    create_context().release()
except RenderError as no_opengl:
    pytest.skip(str(no_opengl), allow_module_level=True)

CAMERA = Pinhole(width_px=650, height_px=330, fx_px=330.0, fy_px=330.0, cx_px=325.0, cy_px=120.0)
"""Its last column and row of tiles have their middles outside."""
FORWARD = transforms.from_rotation(transforms.R_FLU_OPTICAL, (0.0, 0.0, 1.6))


def quad(corners_m: list[list[float]], material: Material, tag: Tag) -> Mesh:
    return make_mesh(corners_m, [[0, 1, 2], [0, 2, 3]], material=material, tag=tag)


def street() -> list[Mesh]:
    """Asphalt, and a house on the right that does not reach over the sky."""
    return [
        quad([[-300, -300, 0], [300, -300, 0], [300, 300, 0], [-300, 300, 0]], Material.ASPHALT, Tag.ROAD),
        quad([[60, -6, 0], [10, -6, 0], [10, -6, 5], [60, -6, 5]], Material.PLASTER, Tag.BUILDING),
    ]


def boards() -> tuple[ModelLibrary, Instances]:
    """Boards that float over the road."""
    board = quad([[-1, -1, 0.4], [1, -1, 0.4], [1, 1, 0.4], [-1, 1, 0.4]], Material.PLASTIC, Tag.CAR)
    places = [[8.0, 2.0, 0.0], [15.0, -3.0, 0.0], [30.0, 6.0, 0.5]]
    return ModelLibrary({"board": board}), Instances(
        model=np.zeros(3, np.int32),
        T_world_model=np.stack([transforms.transform(place, [0, 0, 0, 1]) for place in places]),
        instance=np.arange(1, 4, dtype=np.uint32),
        tint=np.full((3, 3), 99, np.uint8),
    )


@pytest.mark.parametrize("quality", ["medium", "high"])
@pytest.mark.parametrize("weather", ["ClearNoon", "FoggyNoon", "WetNoon"])
def test_a_day_by_tiles_looks_like_one_in_a_piece(
    weather: str, quality: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every pixel is drawn once, and no shadow of a movable model is lost."""
    library, three = boards()
    with SceneRenderer(street(), library, quality=quality, albedo=plain_albedo()) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, three)
        found = renderer.radiance_cd_m2(gbuffer, PRESETS[weather])
        picture = renderer.shade(gbuffer, PRESETS[weather], stamp_ns=7)
        monkeypatch.setattr(shading, "LEAST_PX", 10**9)
        whole = renderer.radiance_cd_m2(gbuffer, PRESETS[weather])
        expected = renderer.shade(gbuffer, PRESETS[weather], stamp_ns=7)
        bare = renderer.draw(CAMERA, FORWARD, three)
        none = np.zeros(0, np.intp)
        empty = Instances(
            model=three.model[none],
            T_world_model=three.T_world_model[none],
            instance=three.instance[none],
            tint=three.tint[none],
        )
        gone = renderer.radiance_cd_m2(renderer.draw(CAMERA, FORWARD, empty), PRESETS[weather])
        tag, _ = bare.labels()
    # Single precision: edges of shadows lie a hair to one side or the other.
    assert np.mean(np.abs(found - whole) > 1e-3 * whole.max()) < 1e-3
    assert np.mean(np.abs(picture.astype(int) - expected).max(axis=2) > 1) < 1e-3
    shadow = (whole[..., 1] < 0.9 * gone[..., 1]) & (tag == Tag.ROAD)
    assert np.count_nonzero(shadow) > 300
    np.testing.assert_allclose(found[shadow], whole[shadow], rtol=0.02, atol=1e-3 * float(whole.max()))


def test_shadows_reach_no_tile_that_is_left_out() -> None:
    """Every point of a relief whose ray to the sun meets a sphere, against the tiles that are chosen."""
    random = np.random.default_rng(2)
    camera = Pinhole(width_px=320, height_px=180, fx_px=160.0, fy_px=160.0, cx_px=160.0, cy_px=90.0)
    turn = transforms.quat_to_matrix(transforms.rpy_to_quat(0.05, 0.2, 1.0))
    view = CameraView.of(camera, transforms.from_rotation(turn @ transforms.R_FLU_OPTICAL, (5.0, 3.0, 1.6)))
    depth = np.kron(random.uniform(3.0, 60.0, (12, 20)), np.ones((15, 16))).astype(np.float32)
    depth[:40, 64:] = 0.0
    v, u = np.mgrid[:180, :320]
    rays = np.stack([(u - 160.0) / 160.0, (v - 90.0) / 160.0, np.ones_like(u)], -1)
    points = (rays * depth[..., None]) @ view.R_camera_world
    middles = random.uniform(-25, 25, (12, 3)) + 20.0 * view.R_camera_world[2]
    radii = random.uniform(0.3, 2.0, 12)
    sun = np.array([0.3, -0.5, 0.81])
    sun /= np.linalg.norm(sun)
    found = under(view, DepthRange.of(depth), light_axes(sun), middles, radii)
    way = middles - points[..., None, :]
    along = np.maximum(way @ sun, 0.0)
    gap = np.linalg.norm(way - along[..., None] * sun, axis=-1)
    shaded = ((gap < radii) & (depth > 0.0)[..., None]).any(axis=2)
    needed = 0
    for row in range(found.shape[0]):
        for column in range(found.shape[1]):
            box = np.s_[row * TILE_PX : (row + 1) * TILE_PX, column * TILE_PX : (column + 1) * TILE_PX]
            assert found[row, column] or not shaded[box].any()
            needed += bool(shaded[box].any())
    assert needed > 10
    assert not found.all()


def test_level_tiles_are_those_near_ground() -> None:
    """Against the decoded normals of a square and the margin round every tile."""
    random = np.random.default_rng(6)
    n = random.normal(0.0, 1.0, (96, 130, 3))
    n[..., 2] = -np.abs(n[..., 2])
    n[40:44, 60:64] = (0.1, -0.1, 1.0)
    n /= np.linalg.norm(n, axis=2, keepdims=True)
    p = n[..., :2] / np.abs(n).sum(axis=2, keepdims=True)
    fold = (1.0 - np.abs(p[..., ::-1])) * np.where(p >= 0.0, 1.0, -1.0)
    codes = np.rint((np.where(n[..., 2:] < 0.0, fold, p) * 0.5 + 0.5) * 65535.0).astype(np.uint16)
    found = np.empty((3, 5), bool)
    level_tiles(found, np.ones((96, 130), np.float32), codes, TILE_PX, 5, LEVEL_UP)
    expected = np.zeros((3, 5), bool)
    expected[1, 1] = expected[1, 2] = True
    np.testing.assert_array_equal(found, expected)
    level_tiles(found, np.zeros((96, 130), np.float32), codes, TILE_PX, 5, LEVEL_UP)
    assert not found.any()


@pytest.mark.parametrize("quality", ["low", "high"])
def test_walls_need_no_puddles(quality: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rainy night with and without the search for level ground."""
    lamps_m = np.array([[20.0, 4.0, 8.0], [45.0, -3.0, 8.0]])
    camera = Pinhole(width_px=650, height_px=330, fx_px=330.0, fy_px=330.0, cx_px=325.0, cy_px=200.0)
    high = [quad([[60, -6, 0], [10, -6, 0], [10, -6, 25], [60, -6, 25]], Material.PLASTER, Tag.BUILDING)]
    with SceneRenderer(
        street() + high, ModelLibrary({}), quality=quality, lamps_m=lamps_m, albedo=plain_albedo()
    ) as renderer:
        gbuffer = renderer.draw(camera, FORWARD, Instances())
        found = renderer.radiance_cd_m2(gbuffer, PRESETS["RainyNight"])
        monkeypatch.setattr(tiled_lights, "LEVEL_MARGIN_PX", 1000)
        everywhere = renderer.radiance_cd_m2(gbuffer, PRESETS["RainyNight"])
    np.testing.assert_allclose(found, everywhere, rtol=1e-3, atol=1e-4 * float(everywhere.max()))


@pytest.mark.parametrize("weather", ["ClearNoon", "ClearSunset", "FoggyNoon"])
def test_pictures_are_light_by_the_tone_curve(weather: str) -> None:
    """Codes of a picture against the curve's formula, within a step of dither."""
    with SceneRenderer(street(), ModelLibrary({}), quality="low", albedo=plain_albedo()) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
        light = renderer.radiance_cd_m2(gbuffer, PRESETS[weather])
        codes = renderer.shade(gbuffer, PRESETS[weather], stamp_ns=3)
    expected = 255.0 * developed(light.astype(np.float64) * sky_light(PRESETS[weather]).exposure)
    assert np.ptp(expected) > 60.0
    off = codes - np.minimum(expected, 255.0)
    assert np.abs(off).max() < 1.02
    assert abs(off[expected < 254.0].mean()) < 0.02


def test_mirrored_skies_are_the_skies() -> None:
    """Levels of the texture against means of the sky that they stand for: within half a step of the root."""
    context = create_context()
    with context:
        skies = Skies(context)
        for name in ("ClearNoon", "ClearNight"):
            sky = skies.of(PRESETS[name])
            light = sky.light.sky_cd_m2 * sky.light.exposure
            for level in range(4):
                size = len(light)
                data = np.frombuffer(sky.mirrored.read(level=level), np.uint8).reshape(size, size, 4)
                root = np.sqrt(light / sky.brightest)
                assert np.abs(data[..., :3] / 255.0 - root).max() < 0.51 / 255.0
                light = light.reshape(size // 2, 2, size // 2, 2, 3).mean(axis=(1, 3))
        skies.release()
    context.release()


def test_days_by_tiles_shaded_together_are_what_each_is_alone() -> None:
    """Byte by byte, though the tiles of one are sorted while those of another are shaded."""
    library, three = boards()
    weathers = [PRESETS[name] for name in ("ClearNoon", "FoggyNoon", "RainyNight", "WetNoon")]
    with SceneRenderer(street(), library, quality="medium", albedo=plain_albedo()) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, three)
        together = renderer.shade_all(gbuffer, weathers, stamp_ns=9, seed=2)
        for weather, picture in zip(weathers, together, strict=True):
            np.testing.assert_array_equal(picture, renderer.shade(gbuffer, weather, stamp_ns=9, seed=2))
