"""The ego's true motion: a C² spline through time, controlled by the physics state of every tick.

Positions are a uniform cubic B-spline, attitudes a cumulative cubic B-spline on SO(3) (Sommer et
al., "Efficient derivative computation for cumulative B-splines on Lie groups", CVPR 2020). A
value depends on the four control ticks around it and on nothing else, so a live run, which keeps
a few seconds, and a replay, which holds the whole drive, give the same bytes. The spline *is* the
truth: pictures, LiDAR, IMU and ground truth all read it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env import geometry
from carlaloc_env.clock import TICK_NS, TICK_S

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Motion of a frame at M instants; world axes are ENU, `body` axes those of the frame."""

    stamp_ns: NDArray[np.int64]
    """Times since the drive began [ns], shape (M,)."""
    position_m: Array
    """Position of the frame's origin in the world [m], shape (M, 3)."""
    quat_xyzw: Array
    """Attitude, maps body to world, shape (M, 4)."""
    velocity_world_mps: Array
    """Velocity in world axes [m/s], shape (M, 3)."""
    acceleration_world_mps2: Array
    """Acceleration in world axes, gravity not included [m/s²], shape (M, 3)."""
    omega_body_radps: Array
    """Body rate [rad/s], shape (M, 3)."""
    alpha_body_radps2: Array
    """Angular acceleration in body axes [rad/s²], shape (M, 3)."""

    @property
    def T_world_frame(self) -> Array:
        """Poses, shape (M, 4, 4)."""
        return geometry.transform(self.position_m, self.quat_xyzw)

    def at_mount(self, T_frame_mount: ArrayLike) -> Motion:
        """Motion of a frame fixed to this one, lever arm included.

        a_mount = a + R(α×l + ω×(ω×l)), v_mount = v + R(ω×l).
        """
        T = np.asarray(T_frame_mount, dtype=np.float64)
        moved = self._moved_by(T[:3, 3]) if T[:3, 3].any() else self
        return moved if np.array_equal(T[:3, :3], np.eye(3)) else moved._turned_by(T[:3, :3])

    def _moved_by(self, lever_m: Array) -> Motion:
        w, q = self.omega_body_radps, self.quat_xyzw
        arm = np.broadcast_to(lever_m, w.shape)
        wl = geometry.cross(w, arm)
        return dataclasses.replace(
            self,
            position_m=self.position_m + geometry.quat_rotate(q, arm),
            velocity_world_mps=self.velocity_world_mps + geometry.quat_rotate(q, wl),
            acceleration_world_mps2=self.acceleration_world_mps2
            + geometry.quat_rotate(q, geometry.cross(self.alpha_body_radps2, arm) + geometry.cross(w, wl)),
        )

    def _turned_by(self, R_frame_mount: Array) -> Motion:
        rotate = geometry.from_rotation(R_frame_mount.T)
        return dataclasses.replace(
            self,
            quat_xyzw=geometry.quat_multiply(self.quat_xyzw, geometry.matrix_to_quat(R_frame_mount)),
            omega_body_radps=geometry.apply(rotate, self.omega_body_radps),
            alpha_body_radps2=geometry.apply(rotate, self.alpha_body_radps2),
        )

    def row(self, index: int) -> Motion:
        """Motion at one of the instants, M = 1."""
        return Motion(**{name: getattr(self, name)[index : index + 1] for name in self.__slots__})


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
    def first_tick(self) -> int:
        """Oldest tick still known."""
        return self._first_tick

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
        tick = t // TICK_NS
        u = ((t % TICK_NS) / TICK_NS)[:, None]
        rows = self._rows(tick)
        # Relative to one control point: second differences of coordinates of a few hundred metres
        # would otherwise lose six digits.
        anchor = self._position[rows[:, 1]]
        p = self._position[rows] - anchor[:, None, :]
        value = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
        first = (-3 * (1 - u) ** 2, 9 * u**2 - 12 * u, -9 * u**2 + 6 * u + 3, 3 * u**2)
        second = (6 * (1 - u), 18 * u - 12, -18 * u + 6, 6 * u)
        quat, omega, alpha = _attitude(self._quat[rows[:, 0]], self._turns(tick), u)
        return Motion(
            stamp_ns=t,
            position_m=anchor + _blend(p, value),
            quat_xyzw=quat,
            velocity_world_mps=_blend(p, first) / TICK_S,
            acceleration_world_mps2=_blend(p, second) / TICK_S**2,
            omega_body_radps=omega,
            alpha_body_radps2=alpha,
        )

    def _rows(self, tick: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows of the four control points around times that follow M ticks, shape (M, 4)."""
        # Before the first tick the car stood still; past the last one the weight is exactly zero.
        rows: NDArray[np.int64] = tick[:, None] - self._first_tick + np.arange(-1, 3)
        return np.clip(rows, 0, self._count - 1)

    def _turns(self, tick: NDArray[np.int64]) -> Array:
        """Rotation vectors between these control points [rad], shape (M, 3, 3)."""
        first = int(tick.min()) if len(tick) else 0
        span = int(tick.max()) - first + 1 if len(tick) else 0
        if span < len(tick):  # many times within few ticks, as in a LiDAR's sweep
            return self._turns(np.arange(first, first + span))[tick - first]
        quats = self._quat[self._rows(tick)]
        between = geometry.quat_multiply(geometry.quat_conjugate(quats[:, :3]), quats[:, 1:])
        return geometry.quat_to_rotvec(between)


def _blend(offsets: Array, weights_times_six: tuple[Array, Array, Array, Array]) -> Array:
    total = np.zeros_like(offsets[:, 0])
    for k, weight in enumerate(weights_times_six):
        total = total + (weight / 6.0) * offsets[:, k]
    return total


def _attitude(first: Array, steps: Array, u: Array) -> tuple[Array, Array, Array]:
    """Attitude, rate and angular acceleration from the first control point and the turns after it."""
    basis = (
        ((5 + 3 * u - 3 * u**2 + u**3) / 6, (3 - 6 * u + 3 * u**2) / 6, (-6 + 6 * u) / 6),
        ((1 + 3 * u + 3 * u**2 - 2 * u**3) / 6, (3 + 6 * u - 6 * u**2) / 6, (6 - 12 * u) / 6),
        (u**3 / 6, 3 * u**2 / 6, u),
    )
    turns = geometry.rotvec_to_quat(np.stack([b for b, _, _ in basis], axis=1) * steps)
    backs = geometry.quat_conjugate(turns)
    q = first
    omega = alpha = np.zeros((len(q), 3))
    for k, (_, db, ddb) in enumerate(basis):
        step, back = steps[:, k], backs[:, k]
        db, ddb = db / TICK_S, ddb / TICK_S**2
        if k == 0:
            omega, alpha = db * step, ddb * step
        else:
            carried = geometry.quat_rotate(back, omega)
            alpha = geometry.quat_rotate(back, alpha) + db * geometry.cross(carried, step) + ddb * step
            omega = carried + db * step
        q = geometry.quat_multiply(q, turns[:, k])
    return geometry.quat_normalise(q), omega, alpha
