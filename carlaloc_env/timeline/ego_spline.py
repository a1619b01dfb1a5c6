"""The ego's true motion: a C² spline through time, controlled by the physics state of every tick.

Positions are a uniform cubic B-spline, attitudes a cumulative one on SO(3) (Sommer et al., "Efficient
derivative computation for cumulative B-splines on Lie groups", CVPR 2020). A value depends on four control
ticks alone, so that live run and replay give the same bytes. All sensors read it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary_kernels
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_NS, TICK_S
from carlaloc_env.core.jit import compiled
from carlaloc_env.timeline.motion import Motion


class EgoTrack:
    """Physics state of `base_link` per tick, read as a spline.

    Ticks are appended in order; a live run forgets old ones. A time t may be asked for when the
    tick after it is known: `end_ns` is the last such time.
    """

    def __init__(self, first_tick: int = 0) -> None:
        self._first_tick = first_tick
        self._count = 0
        self._position = np.zeros((1024, 3))
        self._quat = np.zeros((1024, 4))

    @classmethod
    def from_arrays(cls, position_m: ArrayLike, quat_xyzw: ArrayLike, first_tick: int = 0) -> EgoTrack:
        """Track of positions [m] (K, 3) and quaternions (K, 4), one row per tick."""
        track = cls(first_tick)
        track._position = np.array(position_m, dtype=np.float64)
        track._quat = np.array(quat_xyzw, dtype=np.float64)
        track._count = len(track._position)
        return track

    @property
    def last_tick(self) -> int:
        """Newest known tick."""
        return self._first_tick + self._count - 1

    @property
    def start_ns(self) -> int:
        """Earliest time that may be asked for [ns]."""
        return self._first_tick * TICK_NS if self._first_tick == 0 else (self._first_tick + 1) * TICK_NS

    @property
    def end_ns(self) -> int:
        """Latest time that may be asked for [ns]."""
        return (self.last_tick - 1) * TICK_NS

    @property
    def position_m(self) -> Array:
        """Control positions [m], one row per known tick, shape (K, 3)."""
        return self._position[: self._count]

    @property
    def quat_xyzw(self) -> Array:
        """Control attitudes, one row per known tick, shape (K, 4)."""
        return self._quat[: self._count]

    def append(self, position_m: ArrayLike, quat_xyzw: ArrayLike) -> None:
        """Add the state of the next tick: position [m] (3,), attitude (4,)."""
        if self._count == len(self._position):
            self._position = np.concatenate([self._position, np.zeros_like(self._position)])
            self._quat = np.concatenate([self._quat, np.zeros_like(self._quat)])
        self._position[self._count] = position_m
        self._quat[self._count] = quat_xyzw
        self._count += 1

    def forget_before(self, tick: int) -> None:
        """Drop ticks older than `tick`."""
        drop = min(max(tick - self._first_tick, 0), self._count)
        keep = self._count - drop
        self._position[:keep] = self._position[drop : self._count].copy()
        self._quat[:keep] = self._quat[drop : self._count].copy()
        self._count, self._first_tick = keep, self._first_tick + drop

    def motion(self, stamps_ns: ArrayLike) -> Motion:
        """Motion of `base_link` at M times [ns], shape (M,).

        Raises:
            ValueError: a time lies outside `start_ns` … `end_ns`.
        """
        t = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        if len(t) and (t.min() < self.start_ns or t.max() > self.end_ns):
            raise ValueError(
                f"times {t.min()}…{t.max()} ns lie outside the known motion {self.start_ns}…{self.end_ns} ns"
            )
        quat, out = np.empty((len(t), 4)), np.empty((5, len(t), 3))
        _evaluate(t, self._first_tick, self.position_m, self.quat_xyzw, np.empty((3, 3)), quat, out)
        return Motion(
            stamp_ns=t,
            position_m=out[0],
            quat_xyzw=quat,
            velocity_world_mps=out[1],
            acceleration_world_mps2=out[2],
            omega_body_radps=out[3],
            alpha_body_radps2=out[4],
        )


@compiled
def _evaluate(
    stamp_ns: NDArray[np.int64],
    first_tick: int,
    position_m: Array,
    quat_xyzw: Array,
    turn_rad: Array,
    out_quat: Array,
    out: Array,
) -> None:
    """The spline and its derivatives at M times.

    Args:
        stamp_ns: Times since the drive began [ns], shape (M,).
        first_tick: Tick of the first control point.
        position_m: Control positions, shape (K, 3).
        quat_xyzw: Control attitudes, shape (K, 4).
        turn_rad: Room for the three turns between four control points, shape (3, 3).
        out_quat: Receives attitudes, shape (M, 4).
        out: Receives position, velocity, acceleration, body rate and its derivative, shape (5, M, 3).
    """
    last = len(position_m) - 1
    turned_tick = np.int64(-1)
    for m in range(len(stamp_ns)):
        tick = stamp_ns[m] // TICK_NS
        u = (stamp_ns[m] % TICK_NS) / TICK_NS
        row = tick - first_tick
        # Before the first tick the car stood still; past the last one the weight is exactly zero.
        before, at = min(max(row - 1, 0), last), min(max(row, 0), last)
        after, beyond = min(max(row + 1, 0), last), min(max(row + 2, 0), last)
        if tick != turned_tick:
            _turns(quat_xyzw, (before, at, after, beyond), turn_rad)
            turned_tick = tick
        _place(position_m, (before, at, after, beyond), u, out, m)
        _attitude(quat_xyzw[before], turn_rad, u, out_quat, out, m)


@compiled
def _place(position_m: Array, rows: tuple[int, int, int, int], u: float, out: Array, m: int) -> None:
    """Position and its derivatives from four control points, written to row m."""
    before, at, after, beyond = rows
    for k in range(3):
        # Relative to one control point: second differences of coordinates of a few hundred metres
        # would otherwise lose six digits.
        anchor = position_m[at, k]
        a, b = position_m[before, k] - anchor, position_m[after, k] - anchor
        c = position_m[beyond, k] - anchor
        value = (1 - u) ** 3 * a + (-3 * u**3 + 3 * u**2 + 3 * u + 1) * b + u**3 * c
        first = -3 * (1 - u) ** 2 * a + (-9 * u**2 + 6 * u + 3) * b + 3 * u**2 * c
        second = 6 * (1 - u) * a + (-18 * u + 6) * b + 6 * u * c
        out[0, m, k] = anchor + value / 6
        out[1, m, k] = first / (6 * TICK_S)
        out[2, m, k] = second / (6 * TICK_S**2)


@compiled
def _attitude(first: Array, turn_rad: Array, u: float, out_quat: Array, out: Array, m: int) -> None:
    """Attitude, rate and angular acceleration from the first control point and the turns after it."""
    qx, qy, qz, qw = first[0], first[1], first[2], first[3]
    w, alpha = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(3):
        if k == 0:
            b, db, ddb = (5 + 3 * u - 3 * u**2 + u**3) / 6, (3 - 6 * u + 3 * u**2) / 6, (-6 + 6 * u) / 6
        elif k == 1:
            b, db, ddb = (1 + 3 * u + 3 * u**2 - 2 * u**3) / 6, (3 + 6 * u - 6 * u**2) / 6, (6 - 12 * u) / 6
        else:
            b, db, ddb = u**3 / 6, 3 * u**2 / 6, u
        db, ddb = db / TICK_S, ddb / TICK_S**2
        turn = (turn_rad[k, 0], turn_rad[k, 1], turn_rad[k, 2])
        x, y, z = b * turn[0], b * turn[1], b * turn[2]
        half = 0.5 * math.sqrt(x * x + y * y + z * z)
        scale = 0.5 * elementary_kernels.sin(half) / half if half > 1e-9 else 0.5
        x, y, z, c = x * scale, y * scale, z * scale, elementary_kernels.cos(half)
        w, alpha = _rotated(-x, -y, -z, c, w), _rotated(-x, -y, -z, c, alpha)
        alpha = (
            alpha[0] + db * (w[1] * turn[2] - w[2] * turn[1]) + ddb * turn[0],
            alpha[1] + db * (w[2] * turn[0] - w[0] * turn[2]) + ddb * turn[1],
            alpha[2] + db * (w[0] * turn[1] - w[1] * turn[0]) + ddb * turn[2],
        )
        w = (w[0] + db * turn[0], w[1] + db * turn[1], w[2] + db * turn[2])
        qx, qy, qz, qw = _product(qx, qy, qz, qw, x, y, z, c)
    size = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    out_quat[m, 0], out_quat[m, 1] = qx / size, qy / size
    out_quat[m, 2], out_quat[m, 3] = qz / size, qw / size
    for k in range(3):
        out[3, m, k], out[4, m, k] = w[k], alpha[k]


@compiled
def _turns(quat_xyzw: Array, rows: tuple[int, int, int, int], turn_rad: Array) -> None:
    """Rotation vectors between four control points [rad], shape (3, 3)."""
    for k in range(3):
        a, b = quat_xyzw[rows[k]], quat_xyzw[rows[k + 1]]
        x, y, z, w = _product(-a[0], -a[1], -a[2], a[3], b[0], b[1], b[2], b[3])
        sine = math.sqrt(x * x + y * y + z * z)
        scale = 2.0 * elementary_kernels.arctan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
        scale = scale if w >= 0 else -scale
        turn_rad[k, 0], turn_rad[k, 1], turn_rad[k, 2] = x * scale, y * scale, z * scale


@compiled
def _product(
    ax: float, ay: float, az: float, aw: float, bx: float, by: float, bz: float, bw: float
) -> tuple[float, float, float, float]:
    """Product of two quaternions."""
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


@compiled
def _rotated(
    x: float, y: float, z: float, w: float, v: tuple[float, float, float]
) -> tuple[float, float, float]:
    """A vector rotated by a unit quaternion."""
    tx, ty, tz = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + (y * tz - z * ty),
        v[1] + w * ty + (z * tx - x * tz),
        v[2] + w * tz + (x * ty - y * tx),
    )
