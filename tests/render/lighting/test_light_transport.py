"""Light of surfaces and of the air before them, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.plain_albedo import plain_albedo
from shared_fixtures.worlds.render_scenes import (
    CAMERA,
    FORWARD,
    SUNLESS,
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
from carlaloc_env.render.lighting.light_sources import LAMP_CD, LAMP_COLOUR
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.presets import PRESETS

need_opengl()


def test_fog_follows_koschmieder() -> None:
    """Linear radiance of a wall: (L − L_air) falls as e^(−β d) along the ray."""
    fog = WeatherParameters(cloudiness=100.0, fog_density=80.0, fog_distance=0.0, fog_falloff=0.0)
    wide = {"low_m": (-500.0, -500.0), "high_m": (500.0, 500.0)}
    beta = fog.extinction_per_m
    radiance = {}
    for distance_m in (10.0, 30.0, 60.0, 2000.0):
        with scene(wall(min(distance_m, 1400.0), material=Material.METAL_PAINTED, **wide)) as renderer:  # type: ignore[arg-type]
            gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
            radiance[distance_m] = renderer.radiance_cd_m2(gbuffer, fog)
    air = radiance[2000.0][90, 160, 1]
    for pixel in ((90, 160), (20, 40)):
        slant = float(np.linalg.norm(rays_z1(CAMERA)[pixel]))
        contrast = [radiance[d][(*pixel, 1)] - air for d in (10.0, 30.0, 60.0)]
        assert contrast[1] / contrast[0] == pytest.approx(np.exp(-beta * 20.0 * slant), rel=0.03)
        assert contrast[2] / contrast[1] == pytest.approx(np.exp(-beta * 30.0 * slant), rel=0.03)


def test_fog_thins_with_height() -> None:
    """Optical depth of a level ray is β0 e^(−z/H) d at the camera's height."""
    fog = WeatherParameters(cloudiness=100.0, fog_density=80.0, fog_distance=0.0, fog_falloff=1.0)
    height_m = 12.0
    T = transforms.from_rotation(transforms.R_FLU_OPTICAL, (0.0, 0.0, height_m))
    seen = {}
    for distance_m in (40.0, 80.0, 1200.0):
        plain = wall(distance_m, (-900.0, -900.0), (900.0, 900.0), material=Material.METAL_PAINTED)
        with scene(plain) as renderer:
            radiance = renderer.radiance_cd_m2(renderer.draw(CAMERA, T, Instances()), fog)
            seen[distance_m] = radiance[90, 160, 1]
    level = fog.fog_extinction_per_m * np.exp(-height_m / fog.fog_scale_height_m)
    beta = level + fog.uniform_extinction_per_m
    share = (seen[80.0] - seen[1200.0]) / (seen[40.0] - seen[1200.0])
    assert share == pytest.approx(np.exp(-40.0 * beta), rel=0.03)


def test_level_ground_shows_albedo_times_illuminance() -> None:
    """Without sun and fog a matt surface has L = ρ E / π, E integrated over the sky map."""
    from carlaloc_env.render.lighting.sky_model import hemisphere, sky_light

    light = sky_light(SUNLESS)
    directions, solid_angle_sr = hemisphere()
    sky_lx = np.sum(light.sky_cd_m2 * (directions[..., 2] * solid_angle_sr)[..., None], axis=(0, 1))
    albedo = plain_albedo()
    albedo[:] = (0.4, 0.4, 0.4, 1.0)
    with scene(ground(), albedo=albedo) as renderer:
        down = transforms.from_rotation(np.diag([1.0, -1.0, -1.0]), (3.0, 4.0, 2.0))
        radiance = renderer.radiance_cd_m2(renderer.draw(CAMERA, down, Instances()), SUNLESS)
    mean = radiance.mean(axis=(0, 1))
    np.testing.assert_allclose(mean, 0.4 * sky_lx / np.pi, rtol=0.12)


def test_sun_throws_a_shadow_where_the_ray_to_it_is_blocked() -> None:
    """A plate above the ground darkens exactly the points whose ray to the sun meets it."""
    # Clouds light shadows: the sky has none here.
    sunny = replace(PRESETS["ClearNoon"], cloudiness=0.0)
    plate = quad([[8, -2, 3], [8, 2, 3], [6, 2, 3], [6, -2, 3]], Material.LEAF, Tag.STATIC)
    high = transforms.from_rotation(np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]), (2.0, 0.0, 30.0))
    camera = Pinhole(width_px=240, height_px=160, fx_px=400.0, fy_px=400.0, cx_px=120.0, cy_px=80.0)
    # Even ground: asphalt has stones and stains of its own.
    with scene(ground(material=Material.PLAIN), plate) as renderer:
        gbuffer = renderer.draw(camera, high, Instances())
        tag, _ = gbuffer.labels()
        lit = renderer.radiance_cd_m2(gbuffer, sunny)[..., 1]
    points = np.array(high[:3, 3]) + 30.0 * rays_z1(camera) @ high[:3, :3].T
    sun = sunny.sun_direction
    at_plate = points + 3.0 / sun[2] * sun
    inside = (np.abs(at_plate[..., 0] - 7) < 0.8) & (np.abs(at_plate[..., 1]) < 1.8)
    outside = (np.abs(at_plate[..., 0] - 7) > 1.2) | (np.abs(at_plate[..., 1]) > 2.2)
    road = tag == Tag.ROAD
    assert (inside & road).sum() > 500
    assert lit[inside & road].max() < 0.5 * lit[outside & road].min()


@pytest.mark.parametrize(("weather", "beside_m"), [(PRESETS["ClearNoon"], 11.0), (SUNLESS, 12.0)])
def test_the_road_under_a_car_is_darker(weather: WeatherParameters, beside_m: float) -> None:
    """A floating slab darkens the road below it, in sunlight and under an even sky."""
    corners = [[-2, -1, 0], [2, -1, 0], [2, 1, 0], [-2, 1, 0]]
    slab = quad(corners, Material.CAR_PAINT, Tag.CAR)
    one = standing(transforms.transform([12.0, 0.0, 1.3], [0.0, 0.0, 0.0, 1.0]))
    with scene(ground(), library=ModelLibrary({"slab": slab})) as renderer:
        bare, under = (
            renderer.radiance_cd_m2(renderer.draw(CAMERA, FORWARD, i), weather)[..., 1]
            for i in (Instances(), one)
        )
    spot = transforms.apply(transforms.invert(FORWARD), [beside_m, 0.0, 0.0])
    u, v = CAMERA.project(spot[None])[0].round().astype(int)
    assert under[v, u] < 0.6 * bare[v, u]
    assert under[170, 160] == pytest.approx(bare[170, 160], rel=1e-3)


def test_street_lamp_lights_the_ground_by_the_inverse_square() -> None:
    """Straight below L = ρ I / (π h²); outside the cut-off beam nothing."""
    night = WeatherParameters(sun_altitude_angle=-90.0, fog_density=0.0, mie_scattering_scale=0.0)
    albedo = plain_albedo()
    albedo[:] = (0.4, 0.4, 0.4, 1.0)
    down = transforms.from_rotation(np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]), (2.0, 0.0, 25.0))
    pictures = []
    for lamps_m in (np.zeros((0, 3)), np.array([[2.0, 0.0, 4.0]]), np.array([[2.0, 0.0, 8.0]])):
        # Nothing stains glass.
        with scene(ground(material=Material.GLASS), albedo=albedo, lamps_m=lamps_m) as renderer:
            pictures.append(renderer.radiance_cd_m2(renderer.draw(CAMERA, down, Instances()), night))
    dark, low, high = (picture[..., 1] for picture in pictures)
    for lit, height_m in ((low, 4.0), (high, 8.0)):
        expected = 0.4 * LAMP_CD * LAMP_COLOUR[1] / (np.pi * height_m**2)
        assert lit[90, 160] - dark[90, 160] == pytest.approx(expected, rel=0.1)
    # 24 m aside of a lamp at 4 m is 80.5° from its axis.
    assert low[90, 320 - 2] - dark[90, 320 - 2] == pytest.approx(0.0, abs=1e-3)


def test_car_paint_takes_the_tint_of_its_instance() -> None:
    def plate(material: Material) -> Mesh:
        corners = [[0, 2, -2], [0, -2, -2], [0, -2, 2], [0, 2, 2]]
        return quad(corners, material, Tag.CAR)

    library = ModelLibrary({"paint": plate(Material.CAR_PAINT), "plastic": plate(Material.PLASTIC)})
    T = transforms.transform([8.0, 0.0, 1.6], [0, 0, 0, 1])
    hues = {}
    with scene(library=library) as renderer:
        for model in range(2):
            one = standing(T, model=model, tint=[220, 10, 10])
            pixel = renderer.shade(renderer.draw(CAMERA, FORWARD, one), PRESETS["CloudyNoon"])[90, 160]
            hues[model] = float(pixel[0]) - float(pixel[2])
    assert hues[0] > 60
    assert abs(hues[1]) < 20


def test_mip_maps_keep_the_light_of_a_texture() -> None:
    """Dark and bright texels from afar look as bright as their mean in linear light."""
    corners = [[40.0, 30.0, 0.0], [40.0, -30.0, 0.0], [40.0, -30.0, 30.0], [40.0, 30.0, 30.0]]
    uv = [[30.0, 0.0], [-30.0, 0.0], [-30.0, 30.0], [30.0, 30.0]]
    mesh = make_mesh(corners, [[0, 1, 2], [0, 2, 3]], material=Material.GLASS, tag=Tag.WALL, uv_m=uv)

    def light(texels: NDArray[np.float16]) -> float:
        albedo = np.zeros((len(Material), 64, 64, 4), np.float16)
        albedo[..., :3] = texels[..., None]
        albedo[..., 3] = 1.0
        with scene(mesh, quality="medium", albedo=albedo) as renderer:
            gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
            assert np.all(gbuffer.depth_m()[60:80, 140:180] > 0.0)
            return float(renderer.radiance_cd_m2(gbuffer, PRESETS["CloudyNoon"])[60:80, 140:180].mean())

    checks = np.where(np.indices((64, 64)).sum(axis=0) % 2 == 0, 0.02, 0.62).astype(np.float16)
    plain = light(np.full((64, 64), 0.32, np.float16))
    assert light(checks) == pytest.approx(plain, rel=0.02)
