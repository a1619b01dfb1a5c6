"""The pattern of reflectances: its deviation, its steadiness, and that shaders draw the same."""

from dataclasses import asdict

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.plain_albedo import plain_albedo
from shared_fixtures.worlds.render_scenes import need_opengl, scene

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.scene.materials import Material, material_values
from carlaloc_env.scene.mesh import Instances, make_mesh
from carlaloc_env.scene.mottle import (
    CYCLES_PER_M,
    GAINS,
    MOTTLE,
    SEEN,
    WEAR,
    WEAR_PER_M,
    WEAR_SHIFT,
    mottle_table,
    tone_at,
    value_noise,
)
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import WeatherParameters


def tones_of(
    places_m: NDArray[np.float64],
    footprint_m: float = 0.0,
    *,
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0),
    fine: float = MOTTLE[Material.ASPHALT],
    dirt: float = 0.0,
) -> NDArray[np.float64]:
    return np.array([tone_at(x, y, z, normal, footprint_m, fine, dirt) for x, y, z in places_m.tolist()])


def noise_of(at: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([value_noise(x, y) for x, y in at.tolist()])


def places(count: int = 40_000) -> NDArray[np.float64]:
    return np.random.default_rng(1).uniform(-300.0, 300.0, (count, 3)) * [1.0, 1.0, 0.0]


def test_noise_has_the_deviation_of_its_closed_form() -> None:
    """Variance 1/12 of a corner's number, times (∫ s² + (1 − s)²)² = (26/35)² of the curve between."""
    out = noise_of(places()[:, :2])
    assert out.mean() == pytest.approx(0.5, abs=0.01)
    assert out.std() == pytest.approx(np.sqrt(1 / 12) * 26 / 35, rel=0.02)
    assert np.square(GAINS).sum() * out.var() == pytest.approx(1.0, abs=0.05)


def test_reflectance_deviates_as_much_as_stated_and_less_for_wide_beams() -> None:
    assert tones_of(places()).mean() == pytest.approx(1.0, abs=0.005)
    assert tones_of(places()).std() == pytest.approx(MOTTLE[Material.ASPHALT], rel=0.05)
    assert tones_of(places(), footprint_m=0.05).std() < 0.9 * tones_of(places()).std()
    assert tones_of(places(), footprint_m=3.0).std() == 0.0


def test_a_stretch_of_road_deviates_as_a_real_one_does() -> None:
    """Windows of 1.5 m, a beam every 5 cm 8 m away: 8 to 20 % of the mean."""
    along = np.arange(30) * 0.05
    found = []
    for x, y, _ in places(400):
        line = np.stack([x + along, np.full(30, y), np.zeros(30)], axis=-1)
        tone = tones_of(line, 0.024, dirt=float(mottle_table()[Material.ASPHALT, 1]))
        found.append(tone.std() / tone.mean())
    assert 0.08 < np.median(found) < 0.20


def test_walls_have_the_pattern_along_them_and_up() -> None:
    """A wall that faces any way: as the ground with height in place of the second coordinate."""
    wall = np.random.default_rng(2).uniform(-40.0, 40.0, (500, 2))
    for turn in (0.0, 0.7, 2.0):
        normal = (np.cos(turn), np.sin(turn), 0.0)
        places_m = np.stack([-np.sin(turn) * wall[:, 0], np.cos(turn) * wall[:, 0], wall[:, 1]], axis=-1)
        level = np.column_stack([wall, np.zeros(500)])
        assert tones_of(places_m, normal=normal) == pytest.approx(tones_of(level), abs=1e-6)


def asphalt_seen(cameras: list[Pinhole], pose: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Light of level asphalt without texture under an even sky, of one pose and several cameras."""
    need_opengl()
    square = [[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0]]
    mesh = make_mesh(square, [[0, 1, 2], [0, 2, 3]], material=Material.ASPHALT, tag=Tag.ROAD)
    overcast = WeatherParameters(cloudiness=100.0, fog_density=0.0, mie_scattering_scale=0.0)
    with scene(mesh, quality="medium", albedo=plain_albedo()) as renderer:
        drawn = [renderer.draw(camera, pose, Instances()) for camera in cameras]
        return [renderer.radiance_cd_m2(one, overcast)[..., 1].astype(np.float64) for one in drawn]


def test_pixels_that_look_along_the_road_have_the_mean_of_what_they_cover() -> None:
    """As a picture of 6 × 6 as many pixels, averaged: how much, and where, pixels of a row differ."""
    ahead = transforms.from_rotation(transforms.R_FLU_OPTICAL, [0.0, 0.0, 1.6])
    coarse = Pinhole(width_px=300, height_px=180, fx_px=640.0, fy_px=640.0, cx_px=150.0, cy_px=-20.0)
    cameras = [Pinhole(**{key: n * value for key, value in asdict(coarse).items()}) for n in (1, 6)]
    seen, finer = asphalt_seen(cameras, ahead)
    mean = finer.reshape(180, 6, 300, 6).mean(axis=(1, 3))
    # Rows 16, 10, 7 and 6 m away.
    for row, least, alike in ((44, 0.5, 0.4), (80, 0.7, 0.5), (120, 0.8, 0.6), (160, 0.8, 0.7)):
        found, true = (np.diff(np.log(light[row : row + 4]), axis=1).ravel() for light in (seen, mean))
        assert least < found.std() / true.std() < 1.25
        assert np.corrcoef(found, true)[0, 1] > alike


def test_pictures_have_the_pattern_of_the_lidar() -> None:
    """Asphalt without texture from straight above, divided by the pattern: what is left hardly varies."""
    size, eye_m, px_m = 400, 20.0, 0.01
    focal = eye_m / px_m
    camera = Pinhole(width_px=size, height_px=size, fx_px=focal, fy_px=focal, cx_px=size / 2, cy_px=size / 2)
    down = transforms.from_rotation(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, eye_m])
    (seen,) = asphalt_seen([camera], down)
    v, u = np.mgrid[:size, :size].astype(np.float64)
    x, y = (u - size / 2) * px_m, (size / 2 - v) * px_m
    at = np.stack([x.ravel(), y.ravel(), np.zeros(size * size)], axis=-1)
    expected = 1.0 + WEAR * material_values("porosity")[Material.ASPHALT] * (
        noise_of(WEAR_PER_M * at[:, :2] + WEAR_SHIFT) - 0.5
    )
    for share, gain, cycles_per_m in zip(SEEN, GAINS, CYCLES_PER_M, strict=True):
        expected += share * gain * MOTTLE[Material.ASPHALT] * (noise_of(cycles_per_m * at[:, :2]) - 0.5)
    expected = expected.reshape(size, size)
    rest = (seen / expected).ravel()
    assert np.corrcoef(seen.ravel(), expected.ravel())[0, 1] > 0.95
    assert np.log(rest).std() < 0.4 * np.log(expected).std()
