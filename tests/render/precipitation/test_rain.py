"""Rain: how many drops, how they fall, and that all cameras see the same ones."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import CAMERA, ground, need_opengl, quad, scene, wall
from shared_fixtures.worlds.render_scenes import FORWARD as AHEAD

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.lighting.light_sources import (
    LAMP_LEAST_M,
    NO_LIGHTS,
    Lights,
    batwing_gain,
    range_window,
    street_lamps,
)
from carlaloc_env.render.lighting.low_beam import low_beam_cd
from carlaloc_env.render.lighting.sky_model import sky_light
from carlaloc_env.render.rain_drops import NEAR_M, SIZES_MM, Streaks, lit, streaks_before, terminal_mps
from carlaloc_env.render.rain_layer import RainLayer
from carlaloc_env.render.views import CameraView
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.imaging.lens_drops import with_lens_drops
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.presets import PRESETS

need_opengl()

FORWARD = transforms.from_rotation(transforms.R_FLU_OPTICAL, (3.0, -7.0, 1.6))
RAIN = WeatherParameters(precipitation=60.0, wind_intensity=40.0)


def fall(
    stamp_ns: int, T: NDArray[np.float64] = FORWARD, weather: WeatherParameters = RAIN, seed: int = 3
) -> Streaks:
    return streaks_before(
        CameraView.of(CAMERA, T),
        weather,
        stamp_ns=stamp_ns,
        seed=seed,
        velocity_mps=np.array([12.0, 0.0, 0.0]),
        exposure_time_s=0.01,
    )


def in_world(streaks: Streaks, T: NDArray[np.float64] = FORWARD) -> set[tuple[int, int, int]]:
    return {tuple(row) for row in np.rint((streaks.end_m + T[:3, 3]) * 1e5).astype(int)}


@pytest.mark.parametrize("rain_mmph", [10.0, 30.0, 50.0])
def test_as_many_drops_as_marshall_and_palmer_counted(rain_mmph: float) -> None:
    """Drops per size within the view's truncated pyramid, over several moments."""
    weather = WeatherParameters(precipitation=2.0 * rain_mmph)
    streaks = [fall(stamp, weather=weather) for stamp in range(0, 5_000_000_000, 500_000_000)]
    ahead = FORWARD[:3, 2]
    for diameter_mm, width_mm, reach_m in SIZES_MM:
        found = 0
        for one in streaks:
            z = one.end_m @ ahead
            sideways = np.abs(one.end_m @ FORWARD[:3, :2]) * 160.0 <= z[:, None] * np.array([160.0, 90.0])
            mine = np.isclose(one.diameter_m, diameter_mm * 1e-3)
            found += np.count_nonzero(mine & sideways.all(axis=1) & (z > NEAR_M) & (z < reach_m))
        volume = 4 * (90.0 / 160.0) / 3 * (reach_m**3 - NEAR_M**3)
        density = 8000.0 * math.exp(-4.1 * rain_mmph**-0.21 * diameter_mm) * width_mm
        expected = 10 * volume * density
        assert found == pytest.approx(expected, rel=0.02, abs=4.0 * math.sqrt(expected))


def test_drops_of_a_moment_are_the_same_for_both_eyes() -> None:
    right = FORWARD.copy()
    right[:3, 3] += 0.4 * FORWARD[:3, 0]
    left_drops, right_drops = in_world(fall(10**9)), in_world(fall(10**9, right), right)
    shared = left_drops & right_drops
    assert len(shared) > 0.6 * len(left_drops)
    assert in_world(fall(10**9)) == left_drops
    assert not left_drops & in_world(fall(10**9, seed=4))


def test_drops_fall_on_in_the_next_picture() -> None:
    """After 20 ms each drop is where wind and terminal velocity have carried it."""
    first, second = fall(10**9), fall(10**9 + 20_000_000)
    later = in_world(second)
    wind = RAIN.wind_mps
    for diameter_mm, _, _ in SIZES_MM:
        mine = np.isclose(first.diameter_m, diameter_mm * 1e-3)
        velocity = np.array([wind[0], wind[1], -terminal_mps(diameter_mm)])
        moved = first.end_m[mine] + velocity * 0.02 + FORWARD[:3, 3]
        found = [any((*c,) in later for c in _near(row)) for row in moved]
        assert np.mean(found) > 0.7


def _near(row: NDArray[np.float64]) -> NDArray[np.int_]:
    """Places of a hundredth of a millimetre round a place."""
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)
    return np.asarray(np.rint(row * 1e5).astype(int) + steps)


def test_streaks_are_as_long_as_the_relative_way() -> None:
    streaks = fall(10**9)
    biggest = streaks.diameter_m > 3e-3
    relative = np.array([RAIN.wind_mps[0] - 12.0, RAIN.wind_mps[1], -terminal_mps(3.5)])
    way = streaks.end_m[biggest] - streaks.begin_m[biggest]
    np.testing.assert_allclose(way, np.broadcast_to(0.01 * relative, way.shape), atol=1e-9)
    length = 0.01 * math.sqrt(float(relative @ relative))
    np.testing.assert_allclose(streaks.opacity[biggest], 3.5e-3 / length)


def test_drops_shine_near_lamps_most_when_they_lie_before_them() -> None:
    """Forward scattering: a drop between lamp and eye outshines one beside the lamp."""
    drops = Streaks(
        end_m=np.array([[6.0, 0.0, 0.5], [6.0, 3.0, 0.5]]),
        begin_m=np.array([[6.0, 0.0, 0.6], [6.0, 3.0, 0.6]]),
        diameter_m=np.full(2, 2e-3),
    )
    lamps = street_lamps(np.array([[9.0, 0.0, 6.0]]))
    dark = lit(drops, np.zeros(3), np.full(3, 0.2), NO_LIGHTS)
    np.testing.assert_allclose(dark, 0.188)
    bright = lit(drops, np.zeros(3), np.full(3, 0.2), lamps) - dark
    assert bright[0, 1] > bright[1, 1] > 0.0


def test_drops_get_the_light_that_each_lamp_gives_and_scatters() -> None:
    """Among lamps and headlamps: I(direction) · window · phase / r², summed over the lamps by NumPy."""
    drops, eye = fall(10**9), FORWARD[:3, 3]
    lamps = street_lamps(np.array([[14.0, -7.0, 6.0], [9.0, -2.0, 5.0]]))
    headlamps = replace(
        street_lamps(np.array([[12.0, -6.5, 0.7], [2.0, -7.5, 0.65]])),
        axis=np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        left=np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]),
        beam=np.ones(2, bool),
    )
    lights = Lights.joined([lamps, headlamps])
    expected = np.zeros((len(drops), 3))
    for k in range(len(lights)):
        way = drops.end_m - (lights.position_m[k] - eye)
        r2 = np.maximum(np.sum(way**2, axis=1), LAMP_LEAST_M**2)
        way /= np.sqrt(r2)[:, None]
        ahead, left = way @ lights.axis[k], way @ lights.left[k]
        up = way @ np.cross(lights.axis[k], lights.left[k])
        batwing = batwing_gain(ahead, *lights.edge[k], lights.cap[k])
        gain = low_beam_cd(ahead, left, up) if lights.beam[k] else batwing
        turn = -np.sum(way * drops.end_m, axis=1) / np.linalg.norm(drops.end_m, axis=1)
        lobe = (1.0 - 0.85**2) / (1.0 + 0.85**2 - 1.7 * turn) ** 1.5
        phase = (0.75 * lobe + 0.25) / (4.0 * math.pi)
        given = gain * range_window(r2 / lights.range_m[k] ** 2) * phase / r2
        expected += given[:, None] * lights.colour_cd[k]
    shine = lit(drops, eye, np.zeros(3), lights)
    assert np.count_nonzero(expected[:, 1]) == len(drops)
    np.testing.assert_allclose(shine, expected, rtol=1e-9)


def test_a_streak_hides_what_its_drop_hides_on_its_way() -> None:
    """Sum of the layer over the picture: the streak's area times the share of time it is covered."""
    camera = Pinhole(width_px=640, height_px=360, fx_px=640.0, fy_px=640.0, cx_px=320.0, cy_px=180.0)
    view = CameraView.of(camera, transforms.from_rotation(transforms.R_FLU_OPTICAL, (0.0, 0.0, 0.0)))
    no_depth = np.zeros((360, 640), np.float32)
    layers = RainLayer()
    hidden = []
    for k in range(40):
        # Drops of 3.5 mm at 2 m that fall 0.2 m: 1.1 px wide and 64 px long, here and there.
        end = np.array([[2.0, 0.0137 * k - 0.2, 0.011 * k - 0.3]])
        begin = end + np.array([[0.0, 0.003 * k, 0.2]])
        streak = Streaks(end_m=end, begin_m=begin, diameter_m=np.array([3.5e-3]))
        layer = layers.layer(view, no_depth, streak, np.array([[5.0, 6.0, 7.0]]))
        length_px = 320.0 * math.sqrt(0.2**2 + (0.003 * k) ** 2)
        hidden.append(layer[..., 3].sum() / (length_px * 640.0 * 3.5e-3 / 2.0 * streak.opacity[0]))
        np.testing.assert_allclose(layer[..., :3], layer[..., 3:] * [5.0, 6.0, 7.0], rtol=1e-5)
    assert np.mean(hidden) == pytest.approx(1.0, rel=0.03)
    wall = np.full((360, 640), 1.5, np.float32)
    assert not layers.layer(view, wall, streak, np.ones((1, 3))).any()


def test_pictures_and_light_show_the_same_rain() -> None:
    """The developed picture against the light of the same call, developed by the published sRGB curve."""
    weather = PRESETS["HardRainNoon"]
    with scene(ground()) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
        picture = renderer.shade(gbuffer, weather, stamp_ns=10**9, seed=3).astype(float)
        dry, wet = (
            renderer.radiance_cd_m2(gbuffer, weather, stamp_ns=stamp, seed=3) * sky_light(weather).exposure
            for stamp in (None, 10**9)
        )
    assert np.mean(np.abs(wet - dry) > 0.01 * dry) > 0.02
    assert wet.max() < 0.6
    code = 255.0 * np.where(wet < 0.0031308, 12.92 * wet, 1.055 * wet ** (1 / 2.4) - 0.055)
    falling = np.abs(wet - dry) > 0.03 * dry
    assert np.abs(picture - code)[falling].max() < 2.0
    assert abs(np.mean((picture - code)[falling])) < 0.1


def test_no_rain_falls_under_a_roof() -> None:
    r = 60
    # Its face looks down.
    roof = quad([[-r, -r, 6], [-r, r, 6], [r, r, 6], [r, -r, 6]], Material.PLASTER, Tag.BRIDGE)
    differs = {}
    for name, chunks in (("open", [ground()]), ("covered", [ground(), roof])):
        with scene(*chunks) as renderer:
            gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
            weather = PRESETS["HardRainNoon"]
            # The upper half shows no puddles, only roof or sky.
            a, b = (
                renderer.radiance_cd_m2(gbuffer, weather, stamp_ns=t)[:80].astype(float)
                for t in (0, 70_000_000)
            )
        differs[name] = np.mean(np.abs(a - b) > 1e-3 * a)
    assert differs["open"] > 0.02
    assert differs["covered"] == 0.0


def test_a_wet_road_mirrors_what_stands_behind_it() -> None:
    """A bright wall shows in the puddles before it, upside down: not where the road is dry."""
    yellow = wall(18.0, (-1.5, 0.0), (1.5, 5.0), material=Material.ROAD_PAINT_YELLOW)
    blueness = {}
    for deposits in (0.0, 100.0):
        weather = WeatherParameters(cloudiness=100.0, precipitation_deposits=deposits)
        with scene(ground(), yellow, quality="medium") as renderer:
            seen = renderer.radiance_cd_m2(renderer.draw(CAMERA, AHEAD, Instances()), weather)
        # Road at 8 to 15 m, below the wall and beside it.
        rows = slice(108, 122)
        blueness[deposits] = [
            float((seen[rows, a:b, 2] / seen[rows, a:b, 0]).mean()) for a, b in ((152, 168), (210, 250))
        ]
    assert blueness[0.0][0] == pytest.approx(blueness[0.0][1], rel=0.03)
    assert blueness[100.0][0] < 0.9 * blueness[100.0][1]


def test_wind_sways_leaves_in_all_pictures_alike_and_nothing_else() -> None:
    """Colour, depth and labels of a leaf move by the way that the two waves say; a wall stands still."""
    leaf = wall(10.0, (-0.5, 1.2), (0.5, 2.2), material=Material.LEAF, tag=Tag.VEGETATION)
    still_wall = wall(12.0, (2.0, 0.0), (4.0, 3.0))
    camera = Pinhole(width_px=640, height_px=360, fx_px=640.0, fy_px=640.0, cx_px=320.0, cy_px=180.0)
    wind = (0.0, 15.0, 0.0)
    with scene(leaf, still_wall, quality="medium") as renderer:
        still = renderer.draw(camera, AHEAD, Instances()).labels()[0]
        edges = []
        for stamp in (0, 1_500_000_000):
            gbuffer = renderer.draw(camera, AHEAD, Instances(), wind_mps=wind, stamp_ns=stamp)
            tag = gbuffer.labels()[0]
            np.testing.assert_array_equal(tag == Tag.WALL, still == Tag.WALL)
            np.testing.assert_array_equal(gbuffer.depth_m() > 0, tag != Tag.SKY)
            edges.append(float(np.nonzero(tag[180] == Tag.VEGETATION)[0].min()))
            t, corner = stamp * 1e-9, np.array([10.0, 0.5, 1.6])
            wave = 0.6 * math.sin(1.9 * t + corner @ [0.35, 0.27, 0.20]) + 0.4 * math.sin(
                4.7 * t + corner @ [1.1, 0.9, 0.7]
            )
            expected = 320.0 - 64.0 * (0.5 + 0.012 * 15.0 * wave)
            # The edge is straight between its ends, whose waves differ a little.
            assert edges[-1] == pytest.approx(expected, abs=3.0)
    assert abs(edges[0] - edges[1]) > 3.0


def test_drops_on_the_lens_follow_from_seed_camera_and_time() -> None:
    picture = np.random.default_rng(1).integers(0, 255, (180, 320, 3)).astype(np.uint8)
    rain = PRESETS["HardRainNoon"]

    def seen(stamp_ns: int = 10**9, seed: int = 1, camera: str = "left") -> NDArray[np.uint8]:
        return with_lens_drops(picture, rain, stamp_ns=stamp_ns, seed=seed, camera=camera)

    np.testing.assert_array_equal(seen(), seen())
    covered = (seen() != picture).any(axis=2).mean()
    assert 0.01 < covered < 0.4
    for other in (seen(camera="right"), seen(seed=2), seen(stamp_ns=5 * 10**9)):
        assert not np.array_equal(seen(), other)
    dry = with_lens_drops(picture, PRESETS["ClearNoon"], stamp_ns=0, seed=1, camera="left")
    np.testing.assert_array_equal(dry, picture)


def test_a_flake_on_the_lens_melts_where_it_fell() -> None:
    """It shows four fifths of the sky's mean at first, ever less of it within three seconds."""
    picture = np.full((360, 640, 3), 40, np.uint8)
    picture[:180] = 200
    one = replace(PRESETS["SnowyNoon"], snowfall=1.0 / 12.0)
    melted = 0
    for seed in range(12):
        places = []
        for second in (0.0, 1.0, 2.0):
            seen = with_lens_drops(picture, one, stamp_ns=round(second * 1e9), seed=seed, camera="left")
            ground = seen[200:, :, 0].astype(float)
            brightest = np.unravel_index(ground.argmax(), ground.shape)
            if ground.max() > 60 and 30 < brightest[0] < 130:
                assert ground.max() == pytest.approx(40 + 0.8 * 160 * (1 - second / 3), rel=0.06)
                places.append(brightest)
        assert len(places) in (0, 3)
        melted += bool(places)
        assert np.abs(np.ptp(np.array(places or [[0, 0]]), axis=0)).max() <= 1
    assert melted >= 3
