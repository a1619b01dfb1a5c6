"""The ego at a steady speed on a straight road with a profile, and the motion of points of its body."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_NS, TICK_S
from carlaloc_env.core.ego import DEFAULT_RIDE, Controls
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.params import RIDES, VehicleParams
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.road.road_profile import LevelGrid, Relief, Roughness
from carlaloc_env.road.rough_surface import class_level
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.motion import Motion

SPEED_MPS = 50.0 / 3.6
MESH_STEP_M = 2.5
PARAMS = VehicleParams()


def road(relief: Relief, length_m: float) -> tuple[Array, NDArray[np.int64]]:
    """A straight road whose mesh carries the relief, as towns' meshes do."""
    x, y = np.meshgrid(
        np.arange(-50.0, length_m, MESH_STEP_M), np.arange(-20.0, 21.0, MESH_STEP_M), indexing="ij"
    )
    z = relief.heights(np.stack([x.ravel(), y.ravel()], axis=-1))[:, 0]
    k = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    return np.stack([x.ravel(), y.ravel(), z], axis=-1), triangles


@cache
def motion_on(
    road_class: str, drive_s: float = 200.0, ride: str = DEFAULT_RIDE, speed_mps: float = SPEED_MPS
) -> EgoTrack:
    """The car at a steady speed, 50 km/h as a rule, on a road of a class."""
    chosen = RIDES[ride]
    level = LevelGrid.uniform(class_level(road_class))
    track, total = EgoTrack(), 0.0
    with PhysicsWorld(
        *road(Relief(3, level), speed_mps * (drive_s + 30.0)),
        roughness=Roughness(3, level, waviness=chosen.waviness),
    ) as world:
        car = EgoCar(world, chosen.vehicle)
        car.reset((0.0, 0.0, 0.0), 0.0)
        for tick in range(round((drive_s + 20.0) / TICK_S)):
            state = car.state()
            error = speed_mps - state.speed_mps
            total += error * TICK_S if abs(error) < 2.0 else 0.0
            pedal = float(np.clip(0.5 * error + 0.2 * total + 0.25, 0.0, 1.0))
            steer = float(np.clip(-0.02 * state.position_m[1] - 0.3 * state.heading_rad, -1.0, 1.0))
            car.tick(Controls(throttle=pedal, steer=steer))
            if tick * TICK_S > 20.0:
                track.append(car.state().position_m, car.state().quat_xyzw)
    return track


def motion_at(track: EgoTrack, x_m: float, y_m: float = 0.0, z_m: float = 0.4) -> Motion:
    """Motion of a point of the body."""
    mount = np.eye(4)
    mount[:3, 3] = x_m, y_m, z_m
    return track.motion(np.arange(2, track.last_tick - 1) * TICK_NS).at_mount(mount)
