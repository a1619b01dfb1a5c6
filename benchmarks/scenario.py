"""The drive that the benchmarks look at: Town03, much traffic around a moving ego."""

from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.clock import STEP_NS, STEP_TICKS
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.traffic_config import TrafficConfig
from recorder.devices.registry import open_device

TOWN = "Town03"
SEED = 7
CROWD = 600
"""Vehicles in town, so many that 50 of them are near the ego."""
RANGE_M = 120.0
MOVING_MPS = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Some seconds of driving among many others."""

    timeline: Timeline
    """Ego and the actors nearest to it."""
    stamps_ns: tuple[int, ...]
    """Beginnings of whole sweeps at the end of the drive [ns]."""
    farthest_m: float
    """Distance of the farthest of the actors from the ego [m]."""


def drive_among(town: Town, actors: int, *, steps: int, sweeps: int) -> Drive:
    """Drive for some 50 ms steps and keep the moving actors that are nearest in the end."""
    world = DrivingWorld(town, TrafficConfig(vehicles=CROWD, walkers=20, seed=SEED))
    world.reset()
    advance(world, steps)
    last_ns = world.now_ns // STEP_NS * STEP_NS - STEP_NS
    frame = world.timeline.actors_at(last_ns)
    ego_m = world.timeline.ego_motion([last_ns]).position_m[0]
    distance = np.linalg.norm(frame.position_m - ego_m, axis=-1)
    distance[frame.speed_mps < MOVING_MPS] = np.inf
    nearest = np.sort(np.argsort(distance, kind="stable")[:actors])
    timeline = world.timeline.select_actors(nearest)
    world.close()
    return Drive(
        timeline=timeline,
        stamps_ns=tuple(last_ns - k * STEP_NS for k in range(sweeps)),
        farthest_m=float(distance[nearest].max()),
    )


def advance(world: DrivingWorld, steps: int) -> None:
    """Let the scripted driver drive for some 50 ms steps."""
    driver = open_device("scripted", SEED)
    for _ in range(steps * STEP_TICKS):
        world.tick(driver.read(world.driver_view()))
    driver.close()
