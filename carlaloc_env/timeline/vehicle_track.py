"""Motion of the ego's wheels and pedals at every tick: the truth of wheel odometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_NS, TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import EpisodeError

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
"""Order of the wheels in all arrays."""
BRAKE_FRACTION = 0.02
"""Fraction of the pedal's travel from which brake lamps are lit."""
_WIDTH = 13
"""Columns: four angles, four spins, road wheel, throttle, brake, reverse, handbrake."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CarState:
    """Wheels and controls at M instants."""

    wheel_angle_rad: Array
    """How far each wheel has turned since the drive began, in the order of `WHEELS` [rad], shape (M, 4)."""
    wheel_spin_radps: Array
    """Rate of each wheel [rad/s], shape (M, 4)."""
    road_wheel_rad: Array
    """Angle of the front wheels, left positive [rad], shape (M,)."""
    throttle: Array
    """Throttle pedal 0–1, shape (M,)."""
    brake: Array
    """Brake pedal 0–1, shape (M,)."""
    reverse: NDArray[np.bool_]
    """Whether the reverse gear is engaged, shape (M,)."""
    handbrake: NDArray[np.bool_]
    """Whether the handbrake is pulled, shape (M,)."""


class CarTrack:
    """Rows of `CarState`, one per tick; a live run forgets old ones and keeps the wheels' angles.

    A wheel's angle is the running sum of its spins, always added tick by tick, so that live and
    replayed drives agree to the last bit.
    """

    def __init__(self) -> None:
        self._first_tick = 0
        self._count = 0
        self._rows = np.zeros((256, _WIDTH))

    @classmethod
    def from_arrays(cls, wheel_spin_radps: ArrayLike, road_wheel_rad: ArrayLike, controls: Array) -> CarTrack:
        """Track of a whole drive.

        Args:
            wheel_spin_radps: Spins per tick [rad/s], shape (K, 4).
            road_wheel_rad: Angle of the front wheels per tick [rad], shape (K,).
            controls: Throttle, brake, reverse, handbrake per tick, shape (K, 4).
        """
        spin = np.asarray(wheel_spin_radps, dtype=np.float64)
        track = cls()
        track._count = len(spin)
        track._rows = np.zeros((max(len(spin), 1), _WIDTH))
        rows = track._rows[: len(spin)]
        rows[:, 4:8] = spin
        rows[:, 8] = road_wheel_rad
        rows[:, 9:] = controls
        turned = spin * TICK_S
        turned[:1] = 0.0
        rows[:, :4] = np.cumsum(turned, axis=0)
        return track

    def __len__(self) -> int:
        return self._count

    def append(self, wheel_spin_radps: Sequence[float], road_wheel_rad: float, controls: Controls) -> None:
        """Add the next tick: spins [rad/s] (4,), angle of the front wheels [rad], controls taken."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        turned = [0.0] * 4
        if self._count:
            before = self._rows[self._count - 1, :4].tolist()
            turned = [angle + spin * TICK_S for angle, spin in zip(before, wheel_spin_radps, strict=True)]
        pedals = (controls.throttle, controls.brake, controls.reverse, controls.handbrake)
        self._rows[self._count] = (*turned, *wheel_spin_radps, road_wheel_rad, *pedals)
        self._count += 1

    def forget_before(self, tick: int) -> None:
        """Drop ticks older than `tick`; the newest is always kept."""
        drop = min(max(tick - self._first_tick, 0), max(self._count - 1, 0))
        keep = self._count - drop
        self._rows[:keep] = self._rows[drop : self._count].copy()
        self._count, self._first_tick = keep, self._first_tick + drop

    def at(self, stamps_ns: ArrayLike) -> CarState:
        """State at M times [ns]; between ticks angles and pedals run straight, switches hold.

        Raises:
            EpisodeError: the drive holds no wheels (it was recorded by an early version), or not this time.
        """
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        if self._count == 0:
            raise EpisodeError(
                "the drive has no record of its wheels and pedals; record it again with this version, or "
                "leave wheels out of the rig"
            )
        row = stamps // TICK_NS - self._first_tick
        if len(row):
            self._check_known(int(row.min()), int(row.max()))
        after = np.minimum(row + 1, self._count - 1)
        begin = self._rows[row]
        fraction = ((stamps % TICK_NS) / TICK_NS)[:, None]
        values = begin + fraction * (self._rows[after] - begin)
        return CarState(
            wheel_angle_rad=values[:, :4],
            wheel_spin_radps=values[:, 4:8],
            road_wheel_rad=values[:, 8],
            throttle=values[:, 9],
            brake=values[:, 10],
            reverse=begin[:, 11] > 0.5,
            handbrake=begin[:, 12] > 0.5,
        )

    def one_at(self, stamp_ns: int) -> tuple[float, float, float, bool]:
        """Mean angle of the wheels [rad], angle of the front wheels [rad], brake 0–1 and reverse, as `at`.

        Numbers of a single time come six times as fast as arrays.
        """
        row, rest_ns = divmod(stamp_ns - self._first_tick * TICK_NS, TICK_NS)
        self._check_known(row, row)
        fraction, begin = rest_ns / TICK_NS, self._rows[row].tolist()
        after = self._rows[min(row + 1, self._count - 1)].tolist()
        a, b, c, d, *_, steer, _, brake, _, _ = (
            start + fraction * (end - start) for start, end in zip(begin, after, strict=True)
        )
        return (a + b + c + d) * 0.25, steer, brake, begin[11] > 0.5

    def _check_known(self, first: int, last: int) -> None:
        if not 0 <= first <= last < self._count:
            raise EpisodeError(
                f"wheels are known from tick {self._first_tick} to {self._first_tick + self._count - 1} only"
            )
