"""Formulas that Python and the shaders both have, on rendered pixels; and the numbers that they share."""

import re
from importlib import resources

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shared_fixtures.worlds.plain_albedo import plain_albedo
from shared_fixtures.worlds.render_scenes import (
    CAMERA,
    FORWARD,
    ego_plate,
    ground,
    need_opengl,
    rays_z1,
    scene,
    standing,
    wall,
)

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.lighting.light_sources import batwing_gain, range_window, street_lamps
from carlaloc_env.render.lighting.low_beam import low_beam_cd
from carlaloc_env.render.lighting.model_lamps import BEAM_RANGE_M, EGO_HEADLAMPS_M, HEADLAMP_LIGHT
from carlaloc_env.render.lighting.shader_constants import shader_constants
from carlaloc_env.render.lighting.sky_model import hemisphere, sky_light
from carlaloc_env.render.shader_programs import glsl
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Instances
from carlaloc_env.weather.parameters import WeatherParameters

need_opengl()

NIGHT = WeatherParameters(sun_altitude_angle=-90.0, fog_density=0.0, mie_scattering_scale=0.0)


def matt(reflectance: float) -> NDArray[np.float16]:
    """All materials without gloss."""
    albedo = plain_albedo()
    albedo[:] = (reflectance, reflectance, reflectance, 1.0)
    return albedo


def test_transmittance_of_fog_is_the_integral_of_its_density() -> None:
    """Two walls along one slanted ray, fog that thins with height: numerical integral between them."""
    fog = WeatherParameters(cloudiness=100.0, fog_density=60.0, fog_distance=0.0, fog_falloff=1.0)
    air = sky_light(fog).fog_cd_m2[1]
    seen = {}
    for distance_m in (20.0, 60.0):
        tall = wall(distance_m, (-900.0, -900.0), (900.0, 900.0), material=Material.METAL_PAINTED)
        with scene(tall) as renderer:
            radiance = renderer.radiance_cd_m2(renderer.draw(CAMERA, FORWARD, Instances()), fog)
            seen[distance_m] = radiance[..., 1] - air
    for row, column in ((10, 40), (50, 200), (90, 160), (130, 300), (170, 20)):
        ray = rays_z1(CAMERA)[row, column] @ FORWARD[:3, :3].T
        z = FORWARD[2, 3] + np.linspace(20.0, 60.0, 4001) * ray[2]
        density = fog.fog_extinction_per_m * np.exp(-np.maximum(z, -50.0) / fog.fog_scale_height_m)
        depth = np.mean(density + fog.uniform_extinction_per_m) * 40.0 * np.linalg.norm(ray)
        assert seen[60.0][row, column] / seen[20.0][row, column] == pytest.approx(np.exp(-depth), rel=0.02)


def test_sky_has_the_colour_of_the_sky_model() -> None:
    """Pixels without haze, against the nearest direction of the model's half-sphere."""
    clear = WeatherParameters(
        cloudiness=0.0,
        fog_density=0.0,
        mie_scattering_scale=0.0,
        sun_altitude_angle=60.0,
        sun_azimuth_angle=120.0,
    )
    with scene(ground()) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
        seen = renderer.radiance_cd_m2(gbuffer, clear)
    light = sky_light(clear)
    directions, _ = hemisphere()
    rays = rays_z1(CAMERA)[:70:5, ::5].reshape(-1, 3) @ FORWARD[:3, :3].T
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    _, nearest = cKDTree(directions.reshape(-1, 3)).query(rays)
    expected = light.sky_cd_m2.reshape(-1, 3)[nearest]
    assert np.ptp(expected[:, 2]) > 0.2 * expected[:, 2].mean()
    np.testing.assert_allclose(seen[:70:5, ::5].reshape(-1, 3), expected, rtol=0.02)


def test_low_beam_has_the_intensity_of_the_python_formula() -> None:
    """A matt wall 25 m before the ego's lamps, at all pixels that they light: L = ρ I cos θ / (π r²)."""
    lamp = np.array(EGO_HEADLAMPS_M)
    ego = standing(np.eye(4), instance=EGO_INSTANCE)
    camera = Pinhole(width_px=400, height_px=200, fx_px=900.0, fy_px=900.0, cx_px=200.0, cy_px=70.0)
    eye = transforms.from_rotation(transforms.R_FLU_OPTICAL, lamp + np.array([0.02, 0.0, 0.0]))
    # Nothing stains glass.
    target = wall(lamp[0] + 25.0, (-60.0, -60.0), (60.0, 60.0), material=Material.GLASS)
    with scene(target, library=ego_plate(), albedo=matt(0.5)) as renderer:
        lit, dark = (
            renderer.radiance_cd_m2(renderer.draw(camera, eye, who), NIGHT) for who in (ego, Instances())
        )
    way = 24.98 * rays_z1(camera) @ eye[:3, :3].T + eye[:3, 3] - lamp
    r2 = np.sum(way**2, axis=-1)
    ahead, left, up = np.moveaxis(way / np.sqrt(r2)[..., None], -1, 0)
    lux = low_beam_cd(ahead, left, up) / r2 * range_window(r2 / BEAM_RANGE_M**2) * ahead
    expected = 0.5 / np.pi * lux[..., None] * HEADLAMP_LIGHT
    bright = expected[..., 1] > 0.02 * expected[..., 1].max()
    assert bright.mean() > 0.2
    # A trace of gloss, and of light thrown back to its lamp, comes on top.
    ratio = ((lit - dark) / expected)[bright]
    assert ratio.min() > 0.98
    assert ratio.max() < 1.06


def test_street_lamp_has_the_irradiance_of_the_python_formula() -> None:
    """Matt ground from above, from below the lamp to its cut-off: L = ρ I(θ) cos θ / (π r²)."""
    place = np.array([2.0, 0.0, 6.0])
    down = transforms.from_rotation(np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]), (2.0, 0.0, 25.0))
    images = []
    for lamps_m in (place[None], np.zeros((0, 3))):
        # Nothing stains glass.
        with scene(ground(material=Material.GLASS), albedo=matt(0.4), lamps_m=lamps_m) as renderer:
            images.append(renderer.radiance_cd_m2(renderer.draw(CAMERA, down, Instances()), NIGHT))
    points = 25.0 * rays_z1(CAMERA) @ down[:3, :3].T + down[:3, 3]
    way = points - place
    r2 = np.sum(way**2, axis=-1)
    unit = way / np.sqrt(r2)[..., None]
    lights = street_lamps(place[None])
    gain = batwing_gain(unit @ lights.axis[0], *lights.edge[0], lights.cap[0])
    lux = gain * range_window(r2 / lights.range_m[0] ** 2) * -unit[..., 2] / r2
    expected = 0.4 / np.pi * lux[..., None] * lights.colour_cd[0]
    bright = expected[..., 1] > 0.02 * expected[..., 1].max()
    assert bright.mean() > 0.2
    ratio = ((images[0] - images[1]) / expected)[bright]
    assert ratio.min() > 0.97
    assert ratio.max() < 1.06


def test_shaders_use_every_constant_and_have_no_number_of_their_own_for_it() -> None:
    names = {constant.split()[0] for constant in shader_constants()}
    folder = resources.files("carlaloc_env.render").joinpath("shaders")
    text = "\n".join(
        file.read_text(encoding="utf-8") for file in folder.iterdir() if not file.name.endswith((".py", "__"))
    )
    words = set(re.findall(r"\b[A-Z][A-Z0-9_]+\b", text))
    assert names <= words
    assert not names & set(re.findall(r"(?:const \w+|#define) (\w+)", text))


def test_constants_reach_the_shaders_to_the_bit() -> None:
    random = np.random.default_rng(2)
    values = (random.normal(size=200) * 10.0 ** random.integers(-6, 6, 200)).astype(np.float32)
    assert all(np.float32(glsl(value).strip("()")) == value for value in values)
    assert glsl((1.0, 0.5, 2)) == "vec3(1.0, 0.5, 2.0)"
