"""Short cuts of shading against the formulas they stand for."""

import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import FORWARD, ground, need_opengl, quad, scene, standing

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.gl_context import create_context
from carlaloc_env.render.lighting.skies import Skies
from carlaloc_env.render.lighting.sky_model import sky_light
from carlaloc_env.render.rain_layer import developed
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.presets import PRESETS

need_opengl()

CAMERA = Pinhole(width_px=650, height_px=330, fx_px=330.0, fy_px=330.0, cx_px=325.0, cy_px=120.0)
"""Its last column and row of tiles have their middles outside."""


def street() -> list[Mesh]:
    """Asphalt, and a house on the right that does not reach over the sky."""
    return [
        ground(),
        quad([[60, -6, 0], [10, -6, 0], [10, -6, 5], [60, -6, 5]], Material.PLASTER, Tag.BUILDING),
    ]


def boards() -> tuple[ModelLibrary, Instances]:
    """Boards that float over the road."""
    board = quad([[-1, -1, 0.4], [1, -1, 0.4], [1, 1, 0.4], [-1, 1, 0.4]], Material.PLASTIC, Tag.CAR)
    places = [[8.0, 2.0, 0.0], [15.0, -3.0, 0.0], [30.0, 6.0, 0.5]]
    poses = [transforms.transform(place, [0, 0, 0, 1]) for place in places]
    return ModelLibrary({"board": board}), standing(*poses)


@pytest.mark.parametrize("weather", ["ClearNoon", "ClearSunset", "FoggyNoon"])
def test_pictures_are_light_by_the_tone_curve(weather: str) -> None:
    """Codes of a picture against the curve's formula, within a step of dither."""
    with scene(*street()) as renderer:
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


def test_weathers_shaded_together_are_what_each_is_alone() -> None:
    """Byte by byte, though the lamps of one are found while another is shaded."""
    library, three = boards()
    weathers = [PRESETS[name] for name in ("ClearNoon", "FoggyNoon", "RainyNight", "WetNoon")]
    with scene(*street(), library=library, quality="medium") as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, three)
        together = renderer.shade_all(gbuffer, weathers, stamp_ns=9, seed=2)
        for weather, picture in zip(weathers, together, strict=True):
            np.testing.assert_array_equal(picture, renderer.shade(gbuffer, weather, stamp_ns=9, seed=2))
