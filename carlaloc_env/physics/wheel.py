"""One corner of the car: unsprung mass between spring and tyre, wheel spin, road under three rays."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin, sqrt
from typing import Any

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.physical_constants import GRAVITY_MPS2
from carlaloc_env.physics.params import VehicleParams
from carlaloc_env.physics.tyre import Tyre, lateral_mu

_RAY_ABOVE_M = 0.5
"""Rays to the road start so far above the hub [m]."""
_RAY_BELOW_M = 1.0
"""Rays to the road end so far below the hub [m]."""

BodyMotion = tuple[
    float, float, float, float, float, float, float, float, float,
    float, float, float, float, float, float, float, float, float,
]  # fmt: skip
"""Motion of the body: position of the centre of mass [m] in the world, rotation body → world row by
row, velocity [m/s] and rate [rad/s] in body axes. A plain tuple, since it is unpacked 8 times a tick."""


class Wheel:
    """A wheel that moves along the body's z axis, with its tyre and its spin.

    All vectors are in body axes about the centre of mass, all states advance semi-implicitly at
    200 Hz: positions with the newest speeds, forces from the newest positions.
    """

    def __init__(self, params: VehicleParams, *, is_front: bool, is_left: bool) -> None:
        p = self._params = params
        axle = 0 if is_front else 1
        self.x = (p.wheelbase_m if is_front else 0.0) - p.cog_x_m
        self.y = 0.5 * p.track_m * (1.0 if is_left else -1.0)
        load = p.static_load_n[axle]
        self._radius = p.wheel_radius_m - load / p.tyre_npm
        self._z_hub = self._radius - p.cog_z_m
        # Unsprung mass in proportion to the load keeps the sprung mass's centre at the car's centre.
        self._preload = load * p.sprung_kg / p.mass_kg
        self._unsprung_kg = (load - self._preload) / GRAVITY_MPS2
        self._spring = p.spring_npm[axle]
        self._damper = p.damper_nspm[axle]
        self._drop = p.wheel_radius_m - sqrt(p.wheel_radius_m**2 - p.envelope_m**2)
        self.tyre = Tyre(p, is_front=is_front)
        self.hub_m = (0.0, 0.0, 0.0)
        """Where the hub is in the world [m]."""
        self.force_x = self.force_y = self.force_spring = self.contact_z = 0.0
        self.settle(0.0)

    def settle(self, speed_mps: float) -> None:
        """Set the wheel to its state at rest on flat ground, rolling at a speed [m/s]."""
        self.travel_m = 0.0
        """Compression of the suspension from rest [m]."""
        self.speed_z = 0.0
        """Absolute speed of the hub along the body's z axis [m/s]."""
        self.spin_radps = speed_mps / self._radius
        """Spin of the wheel [rad/s], > 0 forwards."""
        self.load_n = self._preload
        """Normal force of the tyre [N]."""
        self._height: float | None = None
        self._normal = (0.0, 0.0, 1.0)
        self.tyre.release()

    def add_rays(
        self, m: BodyMotion, starts: list[tuple[float, float, float]], ends: list[tuple[float, float, float]]
    ) -> None:
        """Advance the travel and append this wheel's three rays: rear, centre, front."""
        px, py, pz, r11, r12, r13, r21, r22, r23, r31, r32, r33, _, _, vz, wx, wy, _ = m
        x, y = self.x, self.y
        self.travel_m += (self.speed_z - (vz + wx * y - wy * x)) * TICK_S
        z = self._z_hub + self.travel_m
        hx = px + r11 * x + r12 * y + r13 * z
        hy = py + r21 * x + r22 * y + r23 * z
        hz = pz + r31 * x + r32 * y + r33 * z
        self.hub_m = hx, hy, hz
        top, low = hz + _RAY_ABOVE_M, hz - _RAY_BELOW_M
        e = self._params.envelope_m
        ex, ey = e * r11, e * r21
        starts += ((hx - ex, hy - ey, top), (hx, hy, top), (hx + ex, hy + ey, top))
        ends += ((hx - ex, hy - ey, low), (hx, hy, low), (hx + ex, hy + ey, low))

    def update(
        self,
        m: BodyMotion,
        hits: Sequence[Any],
        *,
        steer_rad: float,
        drive_nm: float,
        brake_nm: float,
        park_nm: float,
        anti_roll_n: float,
        mu: float,
        rough_m: float,
    ) -> None:
        """Advance by one tick and set the forces on the body.

        Args:
            m: Motion of the body now.
            hits: The three ray results.
            steer_rad: Angle of this wheel, left positive [rad].
            drive_nm: Motor torque [N m].
            brake_nm: Brake torque asked for, before slip control [N m].
            park_nm: Handbrake torque, without slip control [N m].
            anti_roll_n: Force of the anti-roll bar, pushes the body up [N].
            mu: Friction factor.
            rough_m: Height of the road under the tyre above the town's mesh [m].
        """
        _, _, _, r11, r12, r13, r21, r22, r23, r31, r32, r33, vx, vy, vz, wx, wy, wz = m
        p = self._params
        x, y, d = self.x, self.y, self.travel_m
        self.contact_z = cz = self._z_hub + d - self._radius
        ux, uy, uz = vx + wy * cz - wz * y, vy + wz * x - wx * cz, self.speed_z

        height = self._road(hits, r11 * ux + r12 * uy + r13 * uz, r21 * ux + r22 * uy + r23 * uz)
        gx, gy, gz = self._normal
        nx = r11 * gx + r21 * gy + r31 * gz
        ny = r12 * gx + r22 * gy + r32 * gz
        nz = r13 * gx + r23 * gy + r33 * gz
        load = 0.0
        if height is not None:
            squeeze = p.wheel_radius_m - (self.hub_m[2] - height - rough_m) * gz
            if squeeze > 0.0:
                load = p.tyre_npm * squeeze - p.tyre_nspm * (ux * nx + uy * ny + uz * nz)
                load = load if load > 0.0 else 0.0
        self.load_n = load

        # Wheel axes in the road plane: t along the wheel, s = n × t to its left.
        tx, ty = cos(steer_rad), sin(steer_rad)
        along = tx * nx + ty * ny
        tx, ty, tz = tx - along * nx, ty - along * ny, -along * nz
        scale = 1.0 / sqrt(tx * tx + ty * ty + tz * tz)
        tx, ty, tz = tx * scale, ty * scale, tz * scale
        sx, sy, sz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        v_long = ux * tx + uy * ty + uz * tz
        v_lat = ux * sx + uy * sy + uz * sz
        tyre = self.tyre
        tyre.update(load, v_long, self.spin_radps * self._radius - v_long, -v_lat, mu)
        f_long, f_lat = tyre.force_long_n, tyre.force_lat_n
        self._spin(f_long, drive_nm, brake_nm, park_nm, mu)

        spring = self._preload + self._spring * d + anti_roll_n
        spring += self._damper * (self.speed_z - (vz + wx * y - wy * x))
        if d > p.bump_stop_m:
            spring += p.stop_npm * (d - p.bump_stop_m)
        elif d < -p.rebound_stop_m:
            spring += p.stop_npm * (d + p.rebound_stop_m)
        self.force_spring = spring
        self.force_x = load * nx + f_long * tx + f_lat * sx
        self.force_y = load * ny + f_long * ty + f_lat * sy
        force_z = load * nz + f_long * tz + f_lat * sz
        # The z axis turns with the body: d(v·z)/dt = a·z + v·(ω × z).
        self.speed_z += TICK_S * (
            (force_z - spring) / self._unsprung_kg - GRAVITY_MPS2 * r33 + ux * wy - uy * wx
        )

    def _road(self, hits: Sequence[Any], v_east: float, v_north: float) -> float | None:
        """Height of the road under the wheel [m]: tyre envelope over the rays, spread over some travel."""
        height = None
        for hit, drop in zip(hits, (self._drop, 0.0, self._drop), strict=True):
            if hit[0] >= 0:
                h = hit[3][2] - drop
                if height is None or h > height:
                    height = h
        if height is None:
            self._height = None
            return None
        a = (sqrt(v_east * v_east + v_north * v_north) + 0.05) * TICK_S / self._params.smoothing_m
        gain = a / (1.0 + a)
        nx, ny, nz = self._normal
        if hits[1][0] >= 0:
            mx, my, mz = hits[1][4]
            if mz > 0.3:
                gain_n = gain * 0.25
                nx, ny, nz = nx + gain_n * (mx - nx), ny + gain_n * (my - ny), nz + gain_n * (mz - nz)
                if self._height is None:
                    nx, ny, nz = mx, my, mz
                scale = 1.0 / sqrt(nx * nx + ny * ny + nz * nz)
                self._normal = nx, ny, nz = nx * scale, ny * scale, nz * scale
        if self._height is None:
            self._height = height
        else:
            # Follow the plane first, so that a constant slope leaves no lag.
            ahead = self._height - (nx * v_east + ny * v_north) / nz * TICK_S
            self._height = ahead + gain * (height - ahead)
        return self._height

    def _spin(self, f_long: float, drive_nm: float, brake_nm: float, park_nm: float, mu: float) -> None:
        p = self._params
        load = self.load_n
        side = self.tyre.force_lat_n / (lateral_mu(p, load) * mu * load) if load > 0.0 else 0.0
        grip = p.slip_control * p.mu_long * mu * load * self._radius * sqrt(max(0.1, 1.0 - side * side))
        drive = max(-grip, min(grip, drive_nm))
        hold = min(brake_nm, grip) + park_nm + p.rolling * load * self._radius
        rate = TICK_S / p.wheel_inertia_kgm2
        spin = self.spin_radps + rate * (drive - self._radius * f_long)
        slow = rate * hold
        self.spin_radps = 0.0 if abs(spin) <= slow else spin - slow if spin > 0.0 else spin + slow


def wet_at_speed(mu_factor: float, speed_mps: float) -> float:
    """Friction factor at a speed [m/s]: 0.75 in the wet falls to 0.6 at 100 km/h, dry stays dry."""
    if mu_factor >= 1.0:
        return mu_factor
    return mu_factor * (1.0 - 0.8 * (1.0 - mu_factor) * min(1.0, abs(speed_mps) / 27.8))
