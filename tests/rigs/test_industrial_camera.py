"""The cameras of the rig `real` give the figures of their data sheet, found as EMVA 1288 finds them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from shared_fixtures.worlds.maps import VILLAGE
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.rigs.industrial_camera import (
    ADC_BITS,
    DYNAMIC_RANGE_DB,
    SNR_MAX_DB,
    industrial_imager,
    saturation_capacity_e,
    temporal_dark_noise_e,
    wide_angle_lens,
)
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.imaging.imager import Imager
from carlaloc_env.timeline.actors import empty_catalog, empty_frame
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.weather.schedule import weather_of

SHAPE = (300, 400)


def _mean_and_deviation(light_e: float) -> tuple[float, float]:
    """Of a flat picture before the tone curve, in electrons: spatial patterns cancel between two pictures.

    EMVA 1288 measures pixels, so that no colours are interpolated.
    """
    config = replace(industrial_imager(), gamma=1.0, adc_bits=16, vignetting=0.0, bayer=False)
    imager = Imager(config, "left", SHAPE, seed=3)
    exposure_s = 1e-3
    radiance = np.full((*SHAPE, 3), light_e / (config.electrons_per_cd_m2_s * exposure_s), np.float32)
    a, b = (imager.picture(radiance, exposure_s, stamp).astype(float) for stamp in (0, 50_000_000))
    electrons_per_number = config.full_well_e / 255.0
    # Rounding to the picture's 8 bits is not the camera's.
    variance = np.var(a - b) / 2.0 - 1.0 / 12.0
    return a.mean() * electrons_per_number, math.sqrt(variance) * electrons_per_number


def test_largest_ratio_of_signal_to_noise() -> None:
    """Near saturation; the data sheet has 40.2 dB."""
    mean_e, deviation_e = _mean_and_deviation(0.9 * saturation_capacity_e())
    at_saturation = mean_e / deviation_e / math.sqrt(0.9)
    assert 20.0 * math.log10(at_saturation) == pytest.approx(SNR_MAX_DB, abs=0.1)


def test_dynamic_range() -> None:
    """The light at which signal and noise are equal, from the noise model; the data sheet has 71.4 dB."""
    config = industrial_imager()
    step_e = config.full_well_e / (2**ADC_BITS - 1)
    light_e = np.linspace(0.5, 10.0, 20_000)
    noise_e = np.sqrt(config.read_noise_e**2 + step_e**2 / 12.0 + light_e)
    threshold_e = light_e[np.argmin(np.abs(light_e / noise_e - 1.0))]
    assert 20.0 * math.log10(config.full_well_e / threshold_e) == pytest.approx(DYNAMIC_RANGE_DB, abs=0.1)
    assert 1.5 < temporal_dark_noise_e() < 3.0


def test_every_camera_of_the_rig_has_it() -> None:
    cameras = [config for config in rig_by_name("real").sensors if isinstance(config, CameraConfig)]
    assert [camera.name for camera in cameras] == ["left", "right"]
    for camera in cameras:
        assert camera.imager == industrial_imager()
        assert camera.shutter is not None
        assert camera.shutter.motion_blur
        assert camera.lens == wide_angle_lens()


def test_pictures_of_a_car_at_rest_differ_from_instant_to_instant() -> None:
    """The ideal camera gives most numbers twice; pixels of a real one hardly a third."""
    left = next(c for c in rig_by_name("real").sensors if isinstance(c, CameraConfig))
    left = replace(left, pinhole=Pinhole.from_fov(320, 180, 90.0))
    need_opengl()
    town = load_town(VILLAGE)
    timeline = _at_rest(town)
    stage = SensorStage(town, seed=1, weather=weather_of("ClearNoon"), quality="low")
    assert left.imager is not None
    pixels = replace(left, imager=replace(left.imager, bayer=False))
    same = {}
    for name, config in (
        ("real", left),
        ("pixels", pixels),
        ("ideal", replace(left, imager=None, shutter=None)),
    ):
        sensor = replace(config, outputs=("rgb",)).build(stage)
        a, b = (sensor.measure(timeline, [stamp])[0].rgb for stamp in (100_000_000, 150_000_000))
        same[name] = float(np.mean(a == b))
    stage.close()
    assert same["ideal"] > 0.6
    assert same["pixels"] < 0.3
    assert same["real"] == pytest.approx(0.31, abs=0.01)  # colours in between are interpolated


def _at_rest(town: Town) -> Timeline:
    """A car that stands on the route, alone."""
    assert town.route is not None
    place = town.route.at(np.full(41, 0.3 * town.route.length_m))
    turned = transforms.rpy_to_quat(np.zeros(41), -place.pitch_rad, place.heading_rad)
    timeline = Timeline(empty_catalog(), ego=EgoTrack.from_arrays(place.position_m, turned))
    for _ in range(5):
        timeline.append_step(empty_frame(), np.ones(64, np.uint8))
    return timeline
