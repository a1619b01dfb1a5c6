"""State of all actors in the arrays of a frame: one compiled pass in place of many small ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.vehicle_state import Fleet
from carlaloc_env.traffic.tables.walker_state import VehicleBoxes, WalkerState
from carlaloc_env.traffic.vehicles.ego_agent import EgoBox
from carlaloc_env.traffic.vehicles.poses import VehiclePoses, angle_of


class FrameArrays(NamedTuple):
    """Arrays of an `ActorFrame`, named as there: N vehicles, then W walkers."""

    position_m: NDArray[np.float32]
    """(N + W, 3)."""
    heading_rad: NDArray[np.float32]
    pitch_rad: NDArray[np.float32]
    roll_rad: NDArray[np.float32]
    speed_mps: NDArray[np.float32]
    travelled_m: NDArray[np.float32]
    steer_rad: NDArray[np.float32]


def new_arrays(count: int) -> FrameArrays:
    """Zeros for so many actors."""
    return FrameArrays(np.zeros((count, 3), np.float32), *(np.zeros(count, np.float32) for _ in range(6)))


@compiled
def put_actors(fleet: Fleet, poses: VehiclePoses, walkers: WalkerState, out: FrameArrays) -> None:
    """Write the state of N vehicles and W walkers; pitch, roll and steering of walkers stay as they are."""
    vehicles = len(poses.heading_rad)
    for v in range(vehicles):
        for k in range(3):
            out.position_m[v, k] = poses.position_m[v, k]
        out.heading_rad[v] = poses.heading_rad[v]
        out.pitch_rad[v] = poses.pitch_rad[v]
        out.roll_rad[v] = poses.roll_rad[v]
        out.speed_mps[v] = fleet.speed_mps[v]
        out.travelled_m[v] = fleet.travelled_m[v]
        out.steer_rad[v] = poses.steer_rad[v]
    for w in range(len(walkers.path)):
        row = vehicles + w
        for k in range(3):
            out.position_m[row, k] = walkers.position_m[w, k]
        out.heading_rad[row] = angle_of(walkers.direction[w, 1], walkers.direction[w, 0])
        east, north = walkers.velocity_mps[w, 0], walkers.velocity_mps[w, 1]
        out.speed_mps[row] = np.sqrt(east * east + north * north)
        out.travelled_m[row] = walkers.travelled_m[w]


@compiled
def put_boxes(fleet: Fleet, poses: VehiclePoses, ego: EgoBox, out: VehicleBoxes) -> None:
    """Write where N vehicles and the ego, the last row, are for walkers."""
    vehicles = len(poses.heading_rad)
    for v in range(vehicles):
        out.position_m[v, 0], out.position_m[v, 1] = poses.position_m[v, 0], poses.position_m[v, 1]
        out.height_m[v] = poses.position_m[v, 2]
        sine, cosine = sin_cos(poses.heading_rad[v])
        out.direction[v, 0], out.direction[v, 1] = cosine, sine
        out.speed_mps[v] = fleet.speed_mps[v]
    out.position_m[vehicles, 0], out.position_m[vehicles, 1] = ego.x_m, ego.y_m
    out.height_m[vehicles] = ego.z_m
    out.direction[vehicles, 0], out.direction[vehicles, 1] = ego.cos, ego.sin
    out.speed_mps[vehicles] = ego.speed_mps
    out.half_m[vehicles, 0], out.half_m[vehicles, 1] = ego.half_length_m, ego.half_width_m
