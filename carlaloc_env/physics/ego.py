"""The ego car: a PyBullet rigid body on four ray wheels, driven by `Controls` at 200 Hz."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.controls import Controls
from carlaloc_env.core.elementary_kernels import arctan2, sin_cos
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.geometry import transforms
from carlaloc_env.physics.ground_heights import highest_below
from carlaloc_env.physics.params import VehicleParams
from carlaloc_env.physics.powertrain import Powertrain
from carlaloc_env.physics.quiet_import import pybullet
from carlaloc_env.physics.wheel import PLACES, BodyMotion, Drive, advance_wheels, wet_at_speed
from carlaloc_env.physics.wheel_table import car_record, settle, wheel_table
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.road.road_profile import no_roughness

_SETTLE_TICKS = 400
"""Ticks after which the car rests on its springs."""
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
    """The ego's body, suspension, tyres and motor in a `PhysicsWorld`; one car per world.

    Call `reset` first. The same calls in the same order give the same bytes.

    Args:
        world: Where it drives.
        params: Its numbers.
    """

    def __init__(self, world: PhysicsWorld, params: VehicleParams | None = None) -> None:
        self._world = world
        self._params = p = params if params is not None else VehicleParams()
        self._offset = (-p.cog_x_m, 0.0, -p.cog_z_m)
        self._powertrain = Powertrain(p)
        self._wheels, self._car = wheel_table(p), car_record(p)
        self._rough = no_roughness() if world.roughness is None else world.roughness.table
        self._hits = np.zeros((4, PLACES, 5))
        self._pushed = np.zeros(6)
        self._body = -1
        self._steer_rad = 0.0
        self._motion: BodyMotion = (0.0,) * 3 + (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0) + (0.0,) * 6
        self._quat: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
        self._speed_before_mps = 0.0

    @property
    def params(self) -> VehicleParams:
        """Numbers of the car."""
        return self._params

    def reset(self, position_m: ArrayLike, heading_rad: float) -> EgoState:
        """Put the car on the road and let it settle on its springs, handbrake on.

        Args:
            position_m: Where `base_link` shall be [m], world, shape (3,); the road is sought from
                2 m above it to 4 m below it.
            heading_rad: Direction to face, anticlockwise from east [rad].

        Raises:
            ConfigError: there is no road under one of the wheels.
        """
        wanted = np.asarray(position_m, dtype=np.float64)
        base, quat = self._place_on_road(wanted, float(heading_rad))
        com = base + transforms.quat_rotate(quat, [-o for o in self._offset])
        self._renew_body(com, quat)
        self._powertrain.release()
        self._steer_rad = 0.0
        settle(self._wheels)
        self._read()
        for _ in range(_SETTLE_TICKS):
            self.tick(_PARKED)
        self._world.contacts()
        return self.state()

    def tick(self, controls: Controls) -> None:
        """Advance the car and its world by 5 ms.

        Raises:
            ActionError: a control is not finite or out of range; nothing has moved then.
        """
        controls.checked()
        p, m = self._params, self._motion
        self._turn_wheels(controls.steer)
        power = self._powertrain
        power.update(controls, m[12])
        mu = wet_at_speed(self._world.friction, m[12])
        how = Drive(self._steer_rad, power.motor_n, power.brake_n, power.handbrake_nm, mu)
        drag = 0.5 * p.air_kgpm3 * p.drag_area_m2 * sqrt(m[12] * m[12] + m[13] * m[13] + m[14] * m[14])
        self._pushed[:] = (-drag * m[12], -drag * m[13], 0.0, 0.0, 0.0, 0.0)
        ground = self._world.ground
        advance_wheels(self._wheels, self._car, m, ground, self._rough, how, self._hits, self._pushed)
        self._push()
        self._speed_before_mps = m[12] + m[16] * self._offset[2]
        self._world.step()
        self._read()

    def state(self) -> EgoState:
        """State after the last tick."""
        px, py, pz, r11, r12, r13, r21, r22, r23, r31, r32, r33, vx, vy, vz, wx, wy, wz = self._motion
        ox, oy, oz = self._offset
        bx, by, bz = vx + wy * oz - wz * oy, vy + wz * ox - wx * oz, vz + wx * oy - wy * ox
        wheels = self._wheels
        return EgoState(
            position_m=np.array(
                (
                    px + r11 * ox + r12 * oy + r13 * oz,
                    py + r21 * ox + r22 * oy + r23 * oz,
                    pz + r31 * ox + r32 * oy + r33 * oz,
                )
            ),
            quat_xyzw=np.array(self._quat),
            velocity_world_mps=np.array(
                (
                    r11 * bx + r12 * by + r13 * bz,
                    r21 * bx + r22 * by + r23 * bz,
                    r31 * bx + r32 * by + r33 * bz,
                )
            ),
            omega_body_radps=np.array((wx, wy, wz)),
            speed_mps=bx,
            acceleration_mps2=(bx - self._speed_before_mps) / TICK_S,
            heading_rad=arctan2(r21, r11),
            road_wheel_rad=self._steer_rad,
            wheel_spin_radps=tuple(wheels["spin_radps"].tolist()),
            wheel_travel_m=tuple(wheels["travel_m"].tolist()),
            wheel_load_n=tuple(wheels["load_n"].tolist()),
        )

    def _turn_wheels(self, steer: float) -> None:
        p = self._params
        most = p.wheel_rate_radps / p.steering_ratio * TICK_S
        change = steer * p.steer_max_rad - self._steer_rad
        self._steer_rad += max(-most, min(most, change))

    def _push(self) -> None:
        p = self._params
        px, py, pz, r11, r12, r13, r21, r22, r23, r31, r32, r33, *_ = self._motion
        fx, fy, fz, tx, ty, tz = self._pushed.tolist()
        # PyBullet's body has the whole mass; the springs carry the sprung part of it.
        fz *= p.mass_kg / p.sprung_kg
        force = (
            r11 * fx + r12 * fy + r13 * fz,
            r21 * fx + r22 * fy + r23 * fz,
            r31 * fx + r32 * fy + r33 * fz,
        )
        torque = (
            r11 * tx + r12 * ty + r13 * tz,
            r21 * tx + r22 * ty + r23 * tz,
            r31 * tx + r32 * ty + r33 * tz,
        )
        client = self._world.client
        pybullet.applyExternalForce(
            self._body, -1, force, (px, py, pz), pybullet.WORLD_FRAME, physicsClientId=client
        )
        pybullet.applyExternalTorque(self._body, -1, torque, pybullet.WORLD_FRAME, physicsClientId=client)

    def _read(self) -> None:
        client = self._world.client
        (px, py, pz), quat = pybullet.getBasePositionAndOrientation(self._body, physicsClientId=client)
        (vx, vy, vz), (wx, wy, wz) = pybullet.getBaseVelocity(self._body, physicsClientId=client)
        x, y, z, w = quat
        r11, r12, r13 = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
        r21, r22, r23 = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
        r31, r32, r33 = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
        self._quat = quat
        self._motion = (
            px, py, pz, r11, r12, r13, r21, r22, r23, r31, r32, r33,
            r11 * vx + r21 * vy + r31 * vz, r12 * vx + r22 * vy + r32 * vz, r13 * vx + r23 * vy + r33 * vz,
            r11 * wx + r21 * wy + r31 * wz, r12 * wx + r22 * wy + r32 * wz, r13 * wx + r23 * wy + r33 * wz,
        )  # fmt: skip

    def _renew_body(self, com_m: Array, quat_xyzw: Array) -> None:
        p = self._params
        low, high = np.array(p.body_min_m), np.array(p.body_max_m)
        self._body = self._world.renew_ego(
            mass_kg=p.mass_kg,
            inertia_kgm2=p.inertia_kgm2,
            half_extents_m=(0.5 * (high - low)).tolist(),
            box_centre_m=(0.5 * (high + low) + np.array(self._offset)).tolist(),
            position_m=com_m.tolist(),
            quat_xyzw=quat_xyzw.tolist(),
        )

    def _place_on_road(self, wanted_m: Array, heading_rad: float) -> tuple[Array, Array]:
        """Pose of `base_link` whose four wheels touch the road."""
        p = self._params
        s, c = sin_cos(heading_rad)
        feet = [(w["x"] + p.cog_x_m, w["y"]) for w in self._wheels]
        ground = [(wanted_m[0] + c * x - s * y, wanted_m[1] + s * x + c * y) for x, y in feet]
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
