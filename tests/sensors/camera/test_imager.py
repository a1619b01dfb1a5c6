"""Exposure, noise, tone curve, motion blur and rolling shutter against their formulas."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation
from carlaloc_env.scene.materials import Material
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig, ImagerConfig, ShutterConfig
from carlaloc_env.sensors.imaging.frame_motion import FrameMotion, passing_surfaces
from carlaloc_env.sensors.imaging.imager import Imager
from carlaloc_env.sensors.imaging.motion_field import ScenePoses, motion_field
from carlaloc_env.sensors.imaging.shutter import exposed, picked
from carlaloc_env.weather.presets import PRESETS

STEP_NS = 50_000_000
SHAPE = (200, 300)
PLAIN = ImagerConfig(
    response=0.0, dark_signal_e=0.0, vignetting=0.0, gamma=1.0, adc_bits=16, read_noise_e=5.0
)


def even(level_cd_m2: float) -> NDArray[np.float32]:
    return np.full((*SHAPE, 3), level_cd_m2, np.float32)


@pytest.mark.parametrize(("product_s", "gain"), [(1e-3, 1.0), (0.02, 1.0), (0.16, 8.0)])
def test_variance_follows_emva_1288(product_s: float, gain: float) -> None:
    """σ² = K²·(σ_read² + N) + 1/12 with N electrons and K numbers per electron."""
    imager = Imager(PLAIN, "left", SHAPE, seed=4)
    exposure_s = min(product_s, 0.02)
    electrons = 4000.0 / gain
    picture = imager.picture(even(electrons / (2000.0 * exposure_s)), product_s, 0).astype(float)
    K = 255.0 * gain / PLAIN.full_well_e
    assert picture.mean() == pytest.approx(K * electrons, abs=0.05)
    assert picture.var() == pytest.approx(K * K * (25.0 + electrons) + 1 / 12, rel=0.03)


def test_noise_is_keyed_by_the_stamp_and_can_be_switched_off() -> None:
    imager = Imager(ImagerConfig(), "left", SHAPE, seed=4)
    a, b = (imager.picture(even(900.0), 1e-3, stamp) for stamp in (0, STEP_NS))
    assert not np.array_equal(a, b)
    np.testing.assert_array_equal(a, imager.picture(even(900.0), 1e-3, 0))
    still = Imager(ImagerConfig(noise=False), "left", SHAPE, seed=4)
    np.testing.assert_array_equal(still.picture(even(9.0), 1e-2, 0), still.picture(even(9.0), 1e-2, 7))


def test_the_lens_blurs_as_much_as_stated() -> None:
    """Variance of the picture of a point, and its light, which stays."""
    config = replace(PLAIN, noise=False, vignetting=0.0, lens_blur_px=0.6, full_well_e=1000.0)
    point = even(0.0)
    point[100, 150] = 500.0
    picture = Imager(config, "left", SHAPE, seed=1).picture(point, 1e-3, 0)[..., 1].astype(float)
    assert picture.sum() == pytest.approx(255.0, abs=3.0)
    x = np.arange(SHAPE[1])
    share = picture.sum(axis=0) / picture.sum()
    assert np.sum(share * (x - 150.0) ** 2) == pytest.approx(0.36, abs=0.05)


def test_colours_are_filled_in_between_the_pixels_that_see_them() -> None:
    """Even colours stay what they are; of a step across columns, red is known at every second one only."""
    config = replace(PLAIN, noise=False, vignetting=0.0, bayer=True)
    imager = Imager(config, "left", SHAPE, seed=4)
    colour = np.array([1200.0, 2400.0, 600.0], np.float32)
    picture = imager.picture(np.broadcast_to(colour, (*SHAPE, 3)).astype(np.float32), 1e-3, 0)
    assert np.all(picture == np.rint(255.0 * 2000.0 * 1e-3 * colour / PLAIN.full_well_e).astype(int))
    step = even(0.0)
    step[:, 151:] = 4000.0
    red = imager.picture(step, 1e-3, 0)[100, 148:155, 0].astype(float)
    # Column 151 lies between 150, which is dark, and 152.
    assert red == pytest.approx(255.0 * 0.8 * np.array([0, 0, 0, 0.5, 1, 1, 1]), abs=1.0)


def test_vignetting_and_tone_curve() -> None:
    """The corner gets 1 − v of the light; a share q of the full well comes out as 255·q^(1/γ)."""
    config = ImagerConfig(noise=False, vignetting=0.4, gamma=2.2)
    picture = Imager(config, "left", SHAPE, seed=1).picture(even(2500.0), 1e-3, 0).astype(float)
    assert picture[100, 150, 0] == pytest.approx(255 * 0.5 ** (1 / 2.2), abs=1.0)
    assert picture[0, 0, 0] == pytest.approx(255 * (0.5 * 0.6) ** (1 / 2.2), abs=1.0)


def test_control_measures_light_behind_the_lens() -> None:
    """Of even light 1 − v/3 is left: (r/R)² has the mean 1/3 over a picture. So its mean is the target."""
    for bayer in (False, True):
        config = replace(PLAIN, noise=False, vignetting=0.45, bayer=bayer)
        imager = Imager(config, "left", SHAPE, seed=1)
        level = imager.level_cd_m2(even(800.0))
        assert level == pytest.approx(800.0 * (1 - 0.45 / 3), rel=0.01)
        picture = imager.picture(even(800.0), config.settled(level), 0)
        assert picture.mean() == pytest.approx(255.0 * config.target, rel=0.02)


def test_control_reacts_as_a_first_order_lag_between_its_limits() -> None:
    config = ImagerConfig()
    product = config.settled(3000.0)
    assert config.split(product) == (product, 1.0)
    assert product * 2000.0 * 3000.0 == pytest.approx(0.18 * 10000.0)
    goal = config.settled(300.0)
    for n in range(1, 30):
        product = config.controlled(product, 300.0, 0.05)
        assert math.log(goal / product) == pytest.approx(math.log(10) * math.exp(-n * 0.05 / 0.3))
    assert config.settled(1e9) == 0.05e-3
    exposure_s, gain = config.split(config.settled(0.01))
    assert exposure_s == 0.02
    assert 20 * math.log10(gain) == pytest.approx(24.0)


PINHOLE = Pinhole(width_px=160, height_px=81, fx_px=100.0, fy_px=100.0, cx_px=80.0, cy_px=40.0)


def sideways(shift_px: float) -> FrameMotion:
    """A wall 5 m ahead of a camera that moves to its left, so that all moves right."""
    T = from_rotation(R_FLU_OPTICAL)
    then = T.copy()
    then[1, 3] += shift_px * 5.0 / PINHOLE.fx_px
    nobody = {"actor_id": np.zeros(0, np.uint32), "T_world_actor": np.zeros((0, 4, 4))}
    instants = [ScenePoses(stamp_ns=k, T_world_camera=pose, **nobody) for k, pose in enumerate((T, then))]
    shape = (PINHOLE.height_px, PINHOLE.width_px)
    depth, ids = np.full(shape, 5.0, np.float32), np.zeros(shape, np.uint32)
    forward = motion_field(PINHOLE, depth, ids, *instants)
    backward = motion_field(PINHOLE, depth, ids, *instants[::-1])
    return FrameMotion(forward=forward, backward=backward, passing=passing_surfaces(forward))


def edge(at_px: float) -> NDArray[np.float32]:
    """Dark on the left of a column, bright on the right."""
    row = np.clip(np.arange(PINHOLE.width_px) - at_px + 0.5, 0, 1).astype(np.float32)
    return np.repeat(np.tile(row, (PINHOLE.height_px, 1))[..., None], 3, axis=2)


@pytest.mark.parametrize(("begin", "end"), [(0.0, 1.0), (0.25, 0.75), (0.5, 0.5)])
def test_motion_blur_is_as_long_as_the_way(begin: float, end: float) -> None:
    """A step that moves by 20 px comes out as a ramp from where it was to where it went."""
    shares = np.tile([begin, end], (PINHOLE.height_px, 1))
    light = exposed(edge(60.5), edge(80.5), sideways(20.0), shares)
    u = np.arange(PINHOLE.width_px)
    low, high = 60.5 + 20 * begin, 60.5 + 20 * end
    expected = np.clip((u - low) / max(high - low, 1e-9), 0, 1) if end > begin else (u > low)
    np.testing.assert_allclose(light[40, 25:-25, 0], expected[25:-25], atol=0.06)


def test_rolling_shutter_slants_what_stands_upright() -> None:
    """Row y shows the edge where it is at the row's own time."""
    rows = np.linspace(0.0, 1.0, PINHOLE.height_px)
    shares = np.stack([rows, rows], axis=1)
    light = exposed(edge(60.5), edge(84.5), sideways(24.0), shares)
    # Whole columns: up to one more than the edge's place.
    column = (light[..., 0] < 0.5).sum(axis=1)
    np.testing.assert_allclose(column, 61.0 + 24.0 * rows, atol=0.6)
    tags = [(edge(at)[..., 0] > 0.5).astype(np.uint8) + np.uint8(7) for at in (60.5, 84.5)]
    labels = picked(*tags, sideways(24.0), shares)
    assert set(np.unique(labels)) == {7, 8}
    np.testing.assert_allclose((labels == 7).sum(axis=1), 61.0 + 24.0 * rows, atol=1.0)


@pytest.fixture
def wall(scenery: Any) -> Iterator[Any]:
    """A wall 40 m ahead that fills the view."""
    need_opengl()
    models = {
        **{f"signal_{c}": scenery.box([0, 0, 0], [0.1, 0.1, 0.1]) for c in ("red", "yellow", "green")},
        "ego": scenery.box([-0.9, -0.2, 0.2], [0.3, 0.2, 0.3]),
    }
    town = [scenery.box([40, -300, -300], [45, 300, 300], material=Material.PLASTER)]
    world = scenery.world(town, models, 5)
    yield world
    world.renderer().close()


def config(**changes: Any) -> CameraConfig:
    settings: dict[str, Any] = {
        "name": "left",
        "mount": Mount(position_m=(0, 0, 1.6), axes="optical"),
        "pinhole": PINHOLE,
        **changes,
    }
    return CameraConfig(**settings)


def test_depth_of_a_rolling_shutter_is_that_of_each_rows_time(wall: Any, scenery: Any) -> None:
    drive = scenery.drive(scenery.straight(20.0), 0.5)
    camera = config(
        imager=ImagerConfig(), shutter=ShutterConfig(readout_ms=20.0), outputs=("depth", "semantic")
    ).build(wall)
    assert camera.latency_ns == 20_000_000
    depth = camera.measure(drive, [200_000_000])[0].depth_m  # type: ignore[attr-defined]
    rows_s = 0.2 + 0.02 * (np.arange(81) / 80 - 0.5)
    np.testing.assert_allclose(depth, np.tile(40 - 20 * rows_s[:, None], (1, 160)), atol=0.005)


def test_pictures_of_an_imager_do_not_depend_on_the_order(wall: Any, scenery: Any) -> None:
    drive = scenery.drive(scenery.weaving, 0.8)
    settings = {"imager": ImagerConfig(restart_s=0.3), "shutter": ShutterConfig(), "outputs": ("rgb",)}
    stamps = list(range(0, 12 * STEP_NS, STEP_NS))
    forwards = [s.rgb for s in config(**settings).build(wall).measure(drive, stamps)]  # type: ignore[attr-defined]
    sensor = config(**settings).build(wall)
    for stamp, expected in list(zip(stamps, forwards, strict=True))[::-1]:
        np.testing.assert_array_equal(sensor.measure(drive, [stamp])[0].rgb, expected)  # type: ignore[attr-defined]


def test_night_is_grainier_than_noon(wall: Any, scenery: Any) -> None:
    """Exposure control keeps the mean; the noise tells the light."""
    drive = scenery.drive(scenery.straight(0.0), 0.2)
    camera = config(imager=ImagerConfig(vignetting=0.0), outputs=("rgb",)).build(wall)
    pictures = [
        samples[0].rgb.astype(float)  # type: ignore[attr-defined]
        for samples in camera.measure_conditions(drive, 0, [PRESETS["ClearNoon"], PRESETS["ClearNight"]])
    ]
    grain = [np.diff(picture[20:60, 40:120, 1], axis=1).std() for picture in pictures]
    assert grain[1] > 3 * grain[0]


@pytest.mark.parametrize("shutter", [None, ShutterConfig()])
def test_an_imager_sees_drops_fall(wall: Any, scenery: Any, shutter: ShutterConfig | None) -> None:
    """Nothing but rain moves: pictures of two stamps differ in rain only."""
    drive = scenery.drive(scenery.straight(0.0), 0.4)
    still = ImagerConfig(noise=False)
    camera = config(imager=still, shutter=shutter, outputs=("rgb",)).build(wall)
    changed = {}
    for name in ("HardRainNoon", "ClearNoon"):
        a, b = (
            camera.measure_conditions(drive, stamp, [PRESETS[name]])[0][0].rgb.astype(int)  # type: ignore[attr-defined]
            for stamp in (100_000_000, 150_000_000)
        )
        changed[name] = float((np.abs(a - b).max(axis=2) > 2).mean())
    assert changed["ClearNoon"] == 0.0
    assert changed["HardRainNoon"] > 0.002


def test_drops_cling_to_the_lens_where_asked_for(wall: Any, scenery: Any) -> None:
    drive = scenery.drive(scenery.straight(0.0), 0.2)
    weathers = [PRESETS["HardRainNoon"], PRESETS["ClearNoon"]]

    def pictures(lens_drops: bool) -> list[Any]:
        camera = config(outputs=("rgb",), lens_drops=lens_drops).build(wall)
        samples: Any = camera.measure_conditions(drive, 0, weathers)
        return [one[0].rgb for one in samples]

    wiped, wet = pictures(False), pictures(True)
    assert not np.array_equal(wiped[0], wet[0])
    np.testing.assert_array_equal(wiped[1], wet[1])


def test_leaves_sway_in_the_wind_of_the_camera(wall: Any, scenery: Any) -> None:
    """A hedge moves in its depth picture from stamp to stamp; without wind it stands."""
    models = {f"signal_{c}": scenery.box([0, 0, 0], [0.1, 0.1, 0.1]) for c in ("red", "yellow", "green")}
    models["ego"] = scenery.box([-0.9, -0.2, 0.2], [0.3, 0.2, 0.3])
    world = scenery.world([scenery.box([9, -3, 0], [10, 3, 4], material=Material.LEAF)], models, 5)
    drive = scenery.drive(scenery.straight(0.0), 1.0)
    moved = []
    for wind in (0.0, 12.0):
        camera = config(outputs=("depth",), leaf_wind_mps=wind).build(world)
        first, later = (s.depth_m for s in camera.measure(drive, [0, 900_000_000]))  # type: ignore[attr-defined]
        both = (first > 0) & (later > 0)
        moved.append(float(np.abs(first - later)[both].max()))
    world.renderer().close()
    assert moved[0] == 0.0
    assert 0.01 < moved[1] <= 2 * 0.012 * 12.0
