"""The car as PyBullet knows it, one body: the forces of a tick on it, and what its pose and speeds mean."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from carlaloc_env.core.elementary_kernels import arctan2
from carlaloc_env.core.jit import compiled
from carlaloc_env.physics.contacts import Vector3
from carlaloc_env.physics.ground_heights import GroundTable
from carlaloc_env.physics.powertrain import Pedals, advance_drive
from carlaloc_env.physics.wheel import BodyMotion, advance_wheels
from carlaloc_env.physics.wheel_table import Car, CarTables
from carlaloc_env.road.road_profile import RoughTable

Pose = tuple[Vector3, tuple[float, float, float, float]]
"""Centre of mass [m] and attitude (x, y, z, w), maps body to world; as PyBullet gives them."""
Twist = tuple[Vector3, Vector3]
"""Velocity of the centre of mass [m/s] and rate [rad/s], both in world axes; as PyBullet gives them."""


class BaseMotion(NamedTuple):
    """Motion of `base_link`, named as in `EgoState`."""

    position_m: Vector3
    velocity_world_mps: Vector3
    omega_body_radps: Vector3
    speed_mps: float
    heading_rad: float


@compiled
def push_car(
    tables: CarTables,
    ground: GroundTable,
    rough: RoughTable,
    pose: Pose,
    twist: Twist,
    pedals: Pedals,
    friction: float,
) -> tuple[Vector3, Vector3]:
    """Advance drive and wheels by a tick; force [N] and torque [N m] on the body in world axes.

    Args:
        tables: The car, written to.
        ground: The town's mesh.
        rough: What lies on the roads beyond it.
        pose: Pose of the body now.
        twist: Its speeds now.
        pedals: What the driver does.
        friction: Factor on the tyre friction, 1 = dry asphalt.
    """
    car, drive, push = tables.car[0], tables.drive[0], tables.push
    motion = _motion(pose, twist)
    vx, vy, vz = motion[12:15]
    advance_drive(drive, car, pedals, friction, vx)
    drag = 0.5 * car.air_kgpm3 * car.drag_area_m2 * sqrt(vx * vx + vy * vy + vz * vz)
    push[:] = 0.0
    push[0], push[1] = -drag * vx, -drag * vy
    advance_wheels(tables, motion, ground, rough)
    fx, fy, fz, tx, ty, tz = push[0], push[1], push[2], push[3], push[4], push[5]
    # PyBullet's body has the whole mass; the springs carry the sprung part of it.
    fz *= car.mass_kg / car.sprung_kg
    return _to_world(motion, fx, fy, fz), _to_world(motion, tx, ty, tz)


@compiled
def base_motion(car: Car, pose: Pose, twist: Twist) -> BaseMotion:
    """Motion of `base_link` from that of the centre of mass."""
    motion = _motion(pose, twist)
    px, py, pz, r11, r12, r13, r21, r22, r23, r31, r32, r33, vx, vy, vz, wx, wy, wz = motion
    ox, oy, oz = -car[0].cog_x_m, 0.0, -car[0].cog_z_m
    bx, by, bz = vx + wy * oz - wz * oy, vy + wz * ox - wx * oz, vz + wx * oy - wy * ox
    position = (
        px + r11 * ox + r12 * oy + r13 * oz,
        py + r21 * ox + r22 * oy + r23 * oz,
        pz + r31 * ox + r32 * oy + r33 * oz,
    )
    velocity = _to_world(motion, bx, by, bz)
    return BaseMotion(position, velocity, (wx, wy, wz), bx, arctan2(r21, r11))


@compiled
def _to_world(motion: BodyMotion, x: float, y: float, z: float) -> Vector3:
    """A vector of body axes in world axes."""
    _, _, _, r11, r12, r13, r21, r22, r23, r31, r32, r33, _, _, _, _, _, _ = motion
    return r11 * x + r12 * y + r13 * z, r21 * x + r22 * y + r23 * z, r31 * x + r32 * y + r33 * z


@compiled
def _motion(pose: Pose, twist: Twist) -> BodyMotion:
    """What wheels see of the body's motion."""
    (px, py, pz), (x, y, z, w) = pose
    (vx, vy, vz), (wx, wy, wz) = twist
    r11, r12, r13 = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    r21, r22, r23 = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    r31, r32, r33 = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    return (
        px, py, pz, r11, r12, r13, r21, r22, r23, r31, r32, r33,
        r11 * vx + r21 * vy + r31 * vz, r12 * vx + r22 * vy + r32 * vz, r13 * vx + r23 * vy + r33 * vz,
        r11 * wx + r21 * wy + r31 * wz, r12 * wx + r22 * wy + r32 * wz, r13 * wx + r23 * wy + r33 * wz,
    )  # fmt: skip
