"""The view from the driver's seat: what `render` shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation, quat_to_matrix, rpy_to_quat
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.timeline import Snapshot
from carlaloc_env.weather.schedule import Weather

_T_BASE_SEAT = from_rotation(quat_to_matrix(rpy_to_quat(0.0, 0.03, 0.0)) @ R_FLU_OPTICAL, (1.8, 0.0, 1.65))


def view_from_seat(stage: SensorStage, world: DrivingWorld, weather: Weather) -> NDArray[np.uint8]:
    """A picture from the driver's seat now, sRGB, shape (360, 640, 3).

    Raises:
        RenderError: OpenGL is missing on this machine.
    """
    renderer, now = stage.renderer(), world.now_ns
    snapshot = Snapshot.of(world.timeline, now)
    instances = instances_at(stage.library, stage.lenses, snapshot)
    picture = renderer.draw(Pinhole.from_fov(640, 360, 90.0), snapshot.T_world_base @ _T_BASE_SEAT, instances)
    return renderer.shade(picture, weather.at(now), stamp_ns=now, seed=stage.seed)
