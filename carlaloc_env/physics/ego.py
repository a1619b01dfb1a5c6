"""The ego car: a PyBullet rigid body on four ray wheels, driven by `Controls` at 200 Hz.

The car as PyBullet knows it, one body: the forces of a tick on it, and what its pose and speeds mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.elementary_kernels import arctan2, sin_cos
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.jit import compiled, same_types
from carlaloc_env.physics.bullet import pybullet
from carlaloc_env.physics.car_tables import (
    Car,
    CarTables,
    car_tables,
    settle,
)
from carlaloc_env.physics.contacts import Vector3
from carlaloc_env.physics.drivetrain import Pedals, advance_drive
from carlaloc_env.physics.ground_heights import GroundTable, highest_below
from carlaloc_env.physics.params import VehicleParams
from carlaloc_env.physics.wheel import BodyMotion, advance_wheels
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.road.road_profile import RoughTable, no_roughness
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.vehicle_track import CarTrack

Pose = tuple[Vector3, tuple[float, float, float, float]]
"""Centre of mass [m] and attitude (x, y, z, w), maps body to world; as PyBullet gives them."""
Twist = tuple[Vector3, Vector3]
"""Velocity of the centre of mass [m/s] and rate [rad/s], both in world axes; as PyBullet gives them."""


class EgoTick(NamedTuple):
    """State of the ego after a tick in plain numbers, named as in `EgoState`: cheap to make and to keep."""

    position_m: Vector3
    quat_xyzw: tuple[float, float, float, float]
    velocity_world_mps: Vector3
    omega_body_radps: Vector3
    road_wheel_rad: float
    speed_mps: float
    wheel_spin_radps: list[float]


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


_SETTLE_TICKS = 400
"""Ticks after which a car rests on its springs."""
_PARKED = Controls(handbrake=True, brake=1.0)
"""Controls of a standing car."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EgoState:
    """State of the ego after a tick; `base_link` is fixed to the body."""

    position_m: Array
    """Position of `base_link` in the world [m], shape (3,)."""
    quat_xyzw: Array
    """Attitude, maps body to world, shape (4,)."""
    velocity_world_mps: Array
    """Velocity of `base_link` in world axes [m/s], shape (3,)."""
    omega_body_radps: Array
    """Body rate [rad/s], shape (3,)."""
    speed_mps: float
    """Forward speed of `base_link` [m/s], negative backwards."""
    acceleration_mps2: float
    """Rate of `speed_mps` over the last tick [m/s²]."""
    heading_rad: float
    """Direction of the body's x axis, anticlockwise from east [rad]."""
    road_wheel_rad: float
    """Mean angle of the front wheels, left positive [rad]."""
    wheel_spin_radps: tuple[float, float, float, float]
    """Spin of the wheels [rad/s]: front left, front right, rear left, rear right."""
    wheel_travel_m: tuple[float, float, float, float]
    """Compression of the suspension from rest [m], same order."""
    wheel_load_n: tuple[float, float, float, float]
    """Normal forces of the tyres [N], same order."""


class EgoCar:
    """A car's body, suspension, tyres and motor in a `PhysicsWorld`, alone there or among others.

    Call `reset` first. The same calls in the same order give the same bytes.
    Cars that share a world are placed, settled, pushed and read together, the world is stepped once between.

    Args:
        world: Where it drives.
        params: Its numbers.
    """

    def __init__(self, world: PhysicsWorld, params: VehicleParams | None = None) -> None:
        self._world = world
        self.params = p = params if params is not None else VehicleParams()
        """Numbers of the car."""
        self._offset = (-p.cog_x_m, 0.0, -p.cog_z_m)
        rough = no_roughness() if world.roughness is None else world.roughness.table
        self._tables = car_tables(p)
        self._wheels, self._drive = self._tables.wheels, self._tables.drive
        self._fixed = (self._tables, world.ground, rough)
        self.body = -1
        """PyBullet's id of its body."""
        self.actor_id: int | None = None
        """Instance id by which other cars name it that touch it, from the next `place` on."""
        self._pose: Pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        self._twist: Twist = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._push, self._base_motion = same_types(push_car), same_types(base_motion)
        self._base = base_motion(self._tables.car, self._pose, self._twist)
        self._speed_before_mps = 0.0
        self._controls: Controls | None = None

    def reset(self, position_m: ArrayLike, heading_rad: float) -> EgoState:
        """Put the car on the road and let it settle on its springs, handbrake on.

        Args:
            position_m: Where `base_link` shall be [m], world, shape (3,); the road is sought from
                2 m above it to 4 m below it.
            heading_rad: Direction to face, anticlockwise from east [rad].

        Raises:
            ConfigError: there is no road under one of the wheels.
        """
        self.place(position_m, heading_rad)
        settle_cars(self._world, [self])
        return self.state()

    def remove(self) -> None:
        """Take the car out of the world; `place` brings it back."""
        # PyBullet gives the number of a removed body to another one.
        self._world.remove_car(self.body)
        self.body = -1

    def place(self, position_m: ArrayLike, heading_rad: float) -> None:
        """Put the car on the road, as `reset` says, without letting it settle."""
        wanted = np.asarray(position_m, dtype=np.float64)
        base, quat = self._place_on_road(wanted, float(heading_rad))
        com = base + transforms.quat_rotate(quat, [-o for o in self._offset])
        self._renew_body(com, quat)
        self._drive[:] = 0.0
        settle(self._wheels)
        self.read()

    def tick(self, controls: Controls) -> None:
        """Advance a car that is alone, and its world, by 5 ms.

        Raises:
            ActionError: a control is not finite or out of range; nothing has moved then.
        """
        self.push(controls)
        self._world.step()
        self.read()

    def push(self, controls: Controls) -> None:
        """Let wheels and motor act on the body in the world's next step.

        Raises:
            ActionError: a control is not finite or out of range; nothing has moved then.
        """
        if controls is not self._controls:
            # A step gives the same controls to ten ticks: they are checked once.
            c = self._controls = controls.checked()
            self._pedals = (
                float(c.steer),
                float(c.throttle),
                float(c.brake),
                bool(c.reverse),
                bool(c.handbrake),
            )
        client, friction = self._world.client, self._world.friction
        force, torque = self._push(*self._fixed, self._pose, self._twist, self._pedals, friction)
        pybullet.applyExternalForce(
            self.body, -1, force, self._pose[0], pybullet.WORLD_FRAME, physicsClientId=client
        )
        pybullet.applyExternalTorque(self.body, -1, torque, pybullet.WORLD_FRAME, physicsClientId=client)

    @property
    def speed_mps(self) -> float:
        """Forward speed of `base_link` [m/s]."""
        return self._base.speed_mps

    def follow(self, ego: EgoTrack, car: CarTrack, controls: Controls) -> EgoTick:
        """Append the state after the last tick, and the controls that led there, to its tracks."""
        base, position_m, quat_xyzw = self._base, self._base.position_m, self._pose[1]
        steer_rad, spins_radps = self._drive["steer_rad"].item(), self._wheels["spin_radps"].tolist()
        ego.append(position_m, quat_xyzw)
        car.append(spins_radps, steer_rad, controls)
        twist = base.velocity_world_mps, base.omega_body_radps
        return EgoTick(position_m, quat_xyzw, *twist, steer_rad, base.speed_mps, spins_radps)

    def state(self) -> EgoState:
        """State after the last tick."""
        base, wheels = self._base, self._wheels
        return EgoState(
            position_m=np.array(base.position_m),
            quat_xyzw=np.array(self._pose[1]),
            velocity_world_mps=np.array(base.velocity_world_mps),
            omega_body_radps=np.array(base.omega_body_radps),
            speed_mps=base.speed_mps,
            acceleration_mps2=(base.speed_mps - self._speed_before_mps) / TICK_S,
            heading_rad=base.heading_rad,
            road_wheel_rad=self._drive["steer_rad"].item(),
            wheel_spin_radps=tuple(wheels["spin_radps"].tolist()),
            wheel_travel_m=tuple(wheels["travel_m"].tolist()),
            wheel_load_n=tuple(wheels["load_n"].tolist()),
        )

    def read(self) -> None:
        """Take over what the world's step has done to the body."""
        client = self._world.client
        self._pose = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=client)
        self._twist = pybullet.getBaseVelocity(self.body, physicsClientId=client)
        self._speed_before_mps = self._base.speed_mps
        self._base = self._base_motion(self._tables.car, self._pose, self._twist)

    def _renew_body(self, com_m: Array, quat_xyzw: Array) -> None:
        p = self.params
        low, high = np.array(p.body_min_m), np.array(p.body_max_m)
        self.remove()
        self.body = self._world.add_car(
            actor_id=self.actor_id,
            mass_kg=p.mass_kg,
            inertia_kgm2=p.inertia_kgm2,
            half_extents_m=(0.5 * (high - low)).tolist(),
            box_centre_m=(0.5 * (high + low) + np.array(self._offset)).tolist(),
            position_m=com_m.tolist(),
            quat_xyzw=quat_xyzw.tolist(),
        )

    def _place_on_road(self, wanted_m: Array, heading_rad: float) -> tuple[Array, Array]:
        """Pose of `base_link` whose four wheels touch the road."""
        p = self.params
        s, c = sin_cos(heading_rad)
        base_points = [(w["x"] + p.cog_x_m, w["y"]) for w in self._wheels]
        ground = [(wanted_m[0] + c * x - s * y, wanted_m[1] + s * x + c * y) for x, y in base_points]
        low_m = float(wanted_m[2]) - 4.0
        # On slopes of 1 in 1 the front wheels stand higher; what hangs over roads leaves 4.5 m free.
        for above_m in (2.0, 4.4):
            high_m = float(wanted_m[2]) + above_m
            hits = [highest_below(self._world.ground, float(x), float(y), high_m, low_m) for x, y in ground]
            if all(number >= 0 for number, _ in hits):
                break
        else:
            raise ConfigError(
                f"no road under the ego at ({wanted_m[0]:.1f}, {wanted_m[1]:.1f}, {wanted_m[2]:.1f}) m; "
                "start it on a driving lane"
            )
        fl, fr, rl, rr = (height for _, height in hits)
        forward = np.array([c * p.wheelbase_m, s * p.wheelbase_m, 0.5 * (fl + fr - rl - rr)])
        left = np.array([-s * p.track_m, c * p.track_m, 0.5 * (fl + rl - fr - rr)])
        x_axis = forward / np.sqrt(np.sum(forward * forward))
        up = transforms.cross(x_axis, left)
        up = up / np.sqrt(np.sum(up * up))
        R = np.stack([x_axis, transforms.cross(up, x_axis), up], axis=-1)
        base = np.array([wanted_m[0], wanted_m[1], 0.5 * (rl + rr)])
        return base, transforms.matrix_to_quat(R)


def settle_cars(world: PhysicsWorld, cars: Sequence[EgoCar]) -> None:
    """Let cars that have just been placed rest on their springs, handbrakes on."""
    for _ in range(_SETTLE_TICKS):
        for car in cars:
            car.push(_PARKED)
        world.step()
        for car in cars:
            car.read()
    for car in cars:
        world.contacts(car.body)
