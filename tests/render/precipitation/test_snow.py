"""Snow in pictures: flakes as counted, and cover in the open, on level ground, off the wheel tracks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import CAMERA, FORWARD, ground, need_opengl, quad, scene, standing

from carlaloc_env.core import transforms
from carlaloc_env.render.lighting.light_sources import NO_LIGHTS, street_lamps
from carlaloc_env.render.rain_drops import FLAKES_MM, NEAR_M, Streaks, lit, streaks_before
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.render.views import CameraView
from carlaloc_env.road.wheel_tracks import TRACK_M, WheelTracks
from carlaloc_env.weather.parameters import WeatherParameters

need_opengl()

DOWN = transforms.transform([[0.0, 0.0, 30.0]], transforms.rpy_to_quat([math.pi], [0.0], [0.0]))[0]
"""A camera that looks straight down from 30 m, its right to the east."""
SETTLED = WeatherParameters(snow_cover=1.0, cloudiness=100.0)


def from_above(renderer: SceneRenderer, weather: WeatherParameters) -> NDArray[np.float64]:
    """Luminance over that of the air [1] of ground below the camera, row = south, shape (H, W)."""
    gbuffer = renderer.draw(CAMERA, DOWN, standing())
    light = renderer.radiance_cd_m2(gbuffer, weather)
    return np.asarray(light[..., 1], dtype=np.float64)


@pytest.mark.parametrize("snowfall", [1.0, 2.5])
def test_as_many_flakes_as_the_law_has(snowfall: float) -> None:
    """Flakes per size within the view's truncated pyramid, over several moments."""
    weather = WeatherParameters(snowfall=snowfall)
    ahead = FORWARD[:3, 2]
    found = np.zeros(len(FLAKES_MM))
    for stamp in range(0, 3_000_000_000, 500_000_000):
        one = streaks_before(
            CameraView.of(CAMERA, FORWARD), weather, stamp_ns=stamp, seed=3,
            velocity_mps=np.array([12.0, 0.0, 0.0]), exposure_time_s=0.01,
        )  # fmt: skip
        z = one.end_m @ ahead
        sideways = np.abs(one.end_m @ FORWARD[:3, :2]) * 160.0 <= z[:, None] * np.array([160.0, 90.0])
        for k, (diameter_mm, _, reach_m) in enumerate(FLAKES_MM):
            mine = np.isclose(one.diameter_m, diameter_mm * 1e-3)
            found[k] += np.count_nonzero(mine & sideways.all(axis=1) & (z > NEAR_M) & (z < reach_m))
    swollen = 10.0 ** (1 / 3)
    for k, (diameter_mm, width_mm, reach_m) in enumerate(FLAKES_MM):
        volume = 4 * (90.0 / 160.0) / 3 * (reach_m**3 - NEAR_M**3)
        shape = math.exp(-2.55 * snowfall**-0.48 / swollen * diameter_mm)
        expected = 6 * volume * 3.8e3 * snowfall**-0.87 / swollen * shape * width_mm
        assert found[k] == pytest.approx(expected, rel=0.02, abs=4.0 * math.sqrt(expected))


def test_a_flake_is_a_white_ball() -> None:
    """Straight back it throws 8/3 of what a ball that scatters evenly throws, to the side 8/(3π)."""
    flake = Streaks(
        end_m=np.array([[6.0, 0.0, -5.0]]), begin_m=np.array([[6.0, 0.0, -5.0]]),
        diameter_m=np.array([4e-3]), flakes=True,
    )  # fmt: skip
    dark = lit(flake, np.zeros(3), np.full(3, 0.2), NO_LIGHTS)
    np.testing.assert_allclose(dark, 0.18)
    lamp = street_lamps(np.array([[6.0, 0.0, 1.0]]))
    # The same lamp, seen from where the light turns by 180° and by 90°.
    shone = []
    for eye in ([6.0, 0.0, 4.0], [2.0, 0.0, -5.0]):
        moved = replace(flake, end_m=flake.end_m - eye, begin_m=flake.begin_m - eye)
        shone.append(lit(moved, np.array(eye), np.zeros(3), lamp)[0, 1])
    assert shone[0] / shone[1] == pytest.approx(math.pi, rel=1e-6)


@pytest.mark.parametrize("snow_cover", [0.25, 0.5, 0.75])
def test_cover_is_the_share_of_level_ground(snow_cover: float) -> None:
    """Asphalt and snow are a tenth and nine tenths: the mean luminance tells the share."""
    with scene(ground()) as renderer:
        bare, part, whole = (
            np.mean([from_above(renderer, replace(SETTLED, snow_cover=c)).mean()])
            for c in (1e-6, snow_cover, 1.0)
        )
    assert (part - bare) / (whole - bare) == pytest.approx(snow_cover, abs=0.12)


def test_no_snow_lies_under_a_roof_nor_in_wheel_tracks() -> None:
    """A lane from north to south, and a roof in the air beyond it, under which the camera looks."""
    y = np.arange(-60.0, 60.0, 0.5)
    lanes = WheelTracks.of(np.stack([np.zeros_like(y), y, np.zeros_like(y)], axis=1))
    with scene(ground(), tracks=lambda: lanes) as renderer:
        seen = from_above(renderer, SETTLED)
    across = seen.mean(axis=0)
    metre = 160.0 / 30.0
    track = [across[int(160 + side * TRACK_M * metre)] for side in (-1, 1)]
    verge = across[int(160 + 8 * metre)]
    assert max(track) < 0.35 * verge
    assert across[160] > 0.5 * verge


def test_no_snow_lies_under_a_roof() -> None:
    roof = quad([[-20.0, -20.0, 4.0], [20.0, -20.0, 4.0], [20.0, 20.0, 4.0], [-20.0, 20.0, 4.0]])
    below = transforms.from_rotation(transforms.R_FLU_OPTICAL, (-10.0, 0.0, 1.5))
    with scene(ground(), roof) as covered, scene(ground()) as in_the_open:
        code = [
            renderer.shade(renderer.draw(CAMERA, below, standing()), SETTLED)[-20:].mean()
            for renderer in (covered, in_the_open)
        ]
    assert code[0] < 0.6 * code[1]
