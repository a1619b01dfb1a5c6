"""Rates of events in a town, beside those of public recordings."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from carlaloc_env.core import transforms
from carlaloc_env.core.clock import STEP_NS, TICK_S
from carlaloc_env.rigs.presets import dsec_rig
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera import CameraSensor
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.actors import empty_catalog, empty_frame
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town
from carlaloc_env.weather.presets import weather_by_name

pytestmark = pytest.mark.soak

SPEED_MPS = 12.0
PLACES = 8
GEN1_HZ, DSEC_HZ = 9.1, 34.6
"""Events of a pixel a second: 750 GB of 8 bytes in 39 h of 304×240 pixels (GEN1 of Prophesee); 2 233 378 133
in 105 s of two cameras of 640×480 (six sequences of DSEC)."""


def test_a_pixel_fires_as_often_as_in_public_recordings(town03: Town) -> None:
    config = cast(CameraConfig, dsec_rig().sensors[1])
    stage = SensorStage(town03, seed=1, weather=weather_by_name("ClearNoon"))
    camera = cast(CameraSensor, replace(config, outputs=("events",)).build(stage))
    counts = [
        len(camera.measure(_along(town03, share), [2 * STEP_NS])[-1].events)
        for share in (np.arange(PLACES) + 0.5) / PLACES
    ]
    pixels = config.pinhole.width_px * config.pinhole.height_px
    assert GEN1_HZ < np.mean(counts) / pixels / (STEP_NS * 1e-9) < DSEC_HZ


def _along(town: Town, share: float) -> Timeline:
    """A tenth of a second along the town's route at an even speed, without others."""
    route = town.route
    assert route is not None
    ticks = np.arange(round(4 * STEP_NS * 1e-9 / TICK_S) + 1)
    way = route.at(share * route.length_m + SPEED_MPS * TICK_S * ticks)
    turned = transforms.rpy_to_quat(np.zeros(len(ticks)), -way.pitch_rad, way.heading_rad)
    timeline = Timeline(empty_catalog(), ego=EgoTrack.from_arrays(way.position_m, turned))
    for _ in range(5):
        timeline.append_step(empty_frame(), np.ones(64, np.uint8))
    return timeline
