"""The event camera: its cost beyond two pictures of a camera in town, at the speed of a main road."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np
from bench import Bench, Row
from scenario import SEED, TOWN
from timing import time_calls

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import F32
from carlaloc_env.core.clock import STEP_NS, TICK_S
from carlaloc_env.core.errors import CarlaLocError
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.camera import CameraSensor
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.event_camera.event_camera import EventCamera
from carlaloc_env.sensors.event_camera.log_intensity import log_intensity
from carlaloc_env.sensors.imaging.frame import Optics
from carlaloc_env.sensors.imaging.frame_motion import FrameGeometry
from carlaloc_env.timeline.actors import empty_catalog, empty_frame
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town

SPEED_MPS = 12.0
SHARES = (0.1, 0.3, 0.5, 0.7)
"""How much of the town's route lies behind the ego, at each place."""
TARGET = 1.5


def events(bench: Bench) -> Row:
    """Events of 50 ms at 12 m/s over a picture, at four places: motion of all pixels, logarithms, firing."""
    config = next(c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig))
    pinhole = config.pinhole
    size, places = f"{pinhole.width_px}×{pinhole.height_px}", len(SHARES)
    row = partial(
        Row,
        name="events",
        what=f"events of a camera {size}, 50 ms at {SPEED_MPS:.0f} m/s in {TOWN}, over a picture",
        unit="× a picture",
        target=TARGET,
        at_least=False,
    )
    try:
        sensor = cast(CameraSensor, replace(config, outputs=("events",)).build(bench.stage))
        calls = [_calls(bench, sensor, config, share) for share in SHARES]
    except CarlaLocError as error:
        return row(value=None, note=str(error))
    times = time_calls(
        {
            "events": lambda: [fire() for fire, _ in calls],
            "pictures": lambda: [draw() for _, draw in calls],
        },
        bench.repeat,
    )
    events, pictures = times["events"].per(places), times["pictures"].per(places)
    mev_s = [1e-6 * fire() / (STEP_NS * 1e-9) for fire, _ in calls]
    return row(
        value=events.cpu_s / pictures.cpu_s,
        ours=events,
        note=f"by CPU time; {', '.join(f'{rate:.0f}' for rate in mev_s)} million events a second",
        detail={"picture_cpu_ms": 1e3 * pictures.cpu_s, "mev_s": float(np.mean(mev_s))},
    )


def _calls(
    bench: Bench, sensor: CameraSensor, config: CameraConfig, share: float
) -> tuple[Callable[[], int], Callable[[], object]]:
    """Calls at a place of the route: one counts the events of a step, one draws a picture."""
    timeline = _along(bench.town, share)
    pictures = [_picture(bench, sensor, timeline, k * STEP_NS) for k in range(3)]
    camera = EventCamera(config.events, config.name, Optics(config.pinhole, config.lens), SEED)
    dark = config.events.dark_cd_m2
    levels = [log_intensity(light, dark, blurred=True) for _, light in pictures]
    geometries = [geometry for geometry, _ in pictures]
    motion = camera.motion(*geometries[:2])
    _, state = camera.generate(levels[0], levels[1], motion, camera.initial_state(levels[0], 0), (0, STEP_NS))

    def fire() -> int:
        after = log_intensity(pictures[2][1], dark, blurred=True)
        found, _ = camera.generate(
            levels[1], after, camera.motion(*geometries[1:]), state, (STEP_NS, 2 * STEP_NS)
        )
        return len(found)

    stamps = itertools.cycle((0, STEP_NS))
    return fire, lambda: _picture(bench, sensor, timeline, next(stamps))


def _picture(
    bench: Bench, sensor: CameraSensor, timeline: Timeline, stamp_ns: int
) -> tuple[FrameGeometry, F32]:
    """Picture of the camera at a stamp [ns], and its light [cd/m²]."""
    geometry, shot = sensor.glance(timeline, stamp_ns)
    return geometry, shot.radiance_cd_m2(bench.stage.weather.at(stamp_ns))


def _along(town: Town, share: float) -> Timeline:
    """A short drive along the town's route, alone and at an even speed."""
    route = town.route
    assert route is not None
    ticks = np.arange(round(4 * STEP_NS * 1e-9 / TICK_S) + 1)
    way = route.at(share * route.length_m + SPEED_MPS * TICK_S * ticks)
    turned = transforms.rpy_to_quat(np.zeros(len(ticks)), -way.pitch_rad, way.heading_rad)
    timeline = Timeline(empty_catalog(), ego=EgoTrack.from_arrays(way.position_m, turned))
    for _ in range(5):
        timeline.append_step(empty_frame(), np.ones(64, np.uint8))
    return timeline
