"""Timeline: where the ego, every actor and every traffic light were at any time, for sensors.

A live environment fills a short Timeline while it drives, a replay loads a whole one.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.clock import STEP_NS, STEP_TICKS
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.timeline.actors import (
    ActorCatalog,
    ActorFrame,
    came_in_elsewhere,
    joined_catalogs,
)
from carlaloc_env.timeline.vehicle_track import CarTrack

if TYPE_CHECKING:
    from carlaloc_env.timeline.driven_cars import DrivenCars
    from carlaloc_env.timeline.ego_spline import EgoTrack
    from carlaloc_env.timeline.motion import Motion


_KEPT_MOTIONS = 3
_LINEAR = ("position_m", "pitch_rad", "speed_mps", "travelled_m", "steer_rad", "roll_rad")
"""Fields of `ActorFrame` that change evenly between two steps."""


class ActorPoses(NamedTuple):
    """Poses of actors at M times: Rz(heading)·Ry(−pitch)·Rx(roll) at a position on the ground."""

    position_m: NDArray[np.float64]
    """World [m], shape (M, 3)."""
    heading_rad: NDArray[np.float64]
    """Anticlockwise from east [rad], shape (M,)."""
    pitch_rad: NDArray[np.float64]
    """Nose up positive [rad], shape (M,)."""
    roll_rad: NDArray[np.float64]
    """Left side up positive [rad], shape (M,)."""


class Timeline:
    """Ego, actors and signals over time.

    Actor frames and signal states lie on the 50 ms step grid (stamp = step · 50 ms); actors move
    linearly in between, signals hold their state until the next frame. Other cars with physics of their own
    are the last actors of the catalogue, and move along their splines.

    Args:
        catalog: Road users of the traffic.
        ego: The ego's motion.
        car: Its wheels and pedals.
        cars: All cars of the drive, where there are several.
        own: Which of them is the ego; None: none, and `ego` is a fixed unit.
    """

    def __init__(
        self,
        catalog: ActorCatalog,
        *,
        ego: EgoTrack | None = None,
        car: CarTrack | None = None,
        cars: DrivenCars | None = None,
        own: int | None = 0,
    ) -> None:
        self._traffic, self._cars, self._own = catalog, cars, own
        self._others = np.zeros(0, np.intp)
        self.catalog = catalog
        """All actors: the traffic, then the other cars."""
        if cars is not None:
            if own is not None:
                ego, car = cars.tracks[own]
            self._others = np.delete(np.arange(len(cars)), [] if own is None else own)
            self.catalog = joined_catalogs(catalog, cars.catalog.take(self._others))
        if ego is None:
            # Here, since numba takes half a second to import, and much is read without any motion.
            from carlaloc_env.timeline.ego_spline import EgoTrack

            ego = EgoTrack()
        self.ego = ego
        self.car = car if car is not None else CarTrack()
        self._frames: list[ActorFrame] = []
        self._signals: list[NDArray[np.uint8]] = []
        self._first_step = 0
        self._motions: deque[Motion] = deque(maxlen=_KEPT_MOTIONS)

    @property
    def end_ns(self) -> int:
        """Latest time at which ego and actors are known [ns]."""
        return min(self.ego.end_ns, (self._first_step + len(self._frames) - 1) * STEP_NS)

    @property
    def start_ns(self) -> int:
        """Earliest time at which ego and actors are known [ns]."""
        return max(self.ego.start_ns, self._first_step * STEP_NS)

    def append_step(self, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        """Add the traffic's and signals' state of the next 50 ms step."""
        if len(frame) != len(self._traffic):
            raise ValueError(f"frame of {len(frame)} actors, catalogue of {len(self._traffic)}")
        self._frames.append(frame)
        self._signals.append(signals)

    def forget_before(self, stamp_ns: int) -> None:
        """Drop all steps more than two steps before a time [ns]."""
        step = stamp_ns // STEP_NS - 2
        drop = min(max(step - self._first_step, 0), len(self._frames))
        del self._frames[:drop], self._signals[:drop]
        self._first_step += drop
        self.ego.forget_before(self._first_step * STEP_TICKS)
        self.car.forget_before(self._first_step * STEP_TICKS)

    def ego_motion(self, stamps_ns: ArrayLike) -> Motion:
        """Motion of the ego's `base_link` at M times [ns]."""
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        # Several sensors ask for the same times; what is known of a time never changes.
        for kept in self._motions:
            if np.array_equal(kept.stamp_ns, stamps):
                return kept
            if len(stamps) == 1 and len(row := np.flatnonzero(kept.stamp_ns == stamps[0])):
                return kept.take(row[:1])
        motion = self.ego.motion(stamps)
        self._motions.append(motion)
        return motion

    def actors_at(self, stamp_ns: int) -> ActorFrame:
        """State of all actors at one time [ns]."""
        traffic = self.traffic_at(stamp_ns)
        if self._cars is None:
            return traffic
        return ActorFrame.joined([traffic, self._cars.frame_at(stamp_ns).take(self._others)])

    def traffic_at(self, stamp_ns: int) -> ActorFrame:
        """State of the traffic alone at one time [ns]."""
        a, b, fraction = self._bracket(stamp_ns)
        if fraction == 0.0:
            return a
        f = np.float32(fraction)
        away = came_in_elsewhere(b.position_m - a.position_m, b.heading_rad - a.heading_rad)
        if away.any():
            b = _held(a, b, away)
        pairs = {name: (getattr(a, name), getattr(b, name)) for name in _LINEAR}
        even = {name: begin + f * (end - begin) for name, (begin, end) in pairs.items()}
        return ActorFrame(**even, heading_rad=_turn(a.heading_rad, b.heading_rad, f), lights=a.lights)

    def actor_poses(self, index: int | NDArray[np.intp], stamps_ns: NDArray[np.int64]) -> ActorPoses:
        """Poses of actors at M times [ns].

        Args:
            index: One actor for all times, or an actor for each time, shape (M,).
            stamps_ns: Times since the drive began [ns], shape (M,).
        """
        if self._cars is None:
            return self._traffic_poses(index, stamps_ns)
        index = np.broadcast_to(index, stamps_ns.shape)
        out, driven = np.empty((len(stamps_ns), 6)), index >= len(self._traffic)
        if not driven.all():
            out[~driven] = np.column_stack(self._traffic_poses(index[~driven], stamps_ns[~driven]))
        if driven.any():
            car = self._others[index[driven] - len(self._traffic)]
            out[driven] = self._cars.poses(car, stamps_ns[driven])
        return ActorPoses(out[:, :3], out[:, 3], out[:, 4], out[:, 5])

    def car_rates_at(self, stamp_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Velocities [m/s] (K, 3) and yaw rates [rad/s] (K,) of the other cars, the last actors."""
        if self._cars is None:
            return np.zeros((0, 3)), np.zeros(0)
        return self._cars.rates_at(self._others, stamp_ns)

    def _traffic_poses(self, index: int | NDArray[np.intp], stamps_ns: NDArray[np.int64]) -> ActorPoses:
        step = stamps_ns // STEP_NS - self._first_step
        first, last = int(step.min()), int(step.max()) + 1
        frames = [self._frames[min(k, len(self._frames) - 1)] for k in range(first, last + 1)]
        position, heading, pitch, roll = (
            np.array([getattr(frame, name) for frame in frames], dtype=np.float64)
            for name in ActorPoses._fields
        )
        still = came_in_elsewhere(np.diff(position, axis=0), np.diff(heading, axis=0))
        row = (step - first) * len(self._traffic) + index
        fraction = (stamps_ns % STEP_NS) / STEP_NS

        def between(
            start: NDArray[np.float64], change: NDArray[np.float64], f: ArrayLike
        ) -> NDArray[np.float64]:
            flat = (-1, *start.shape[2:])
            change[still] = 0.0
            moved: NDArray[np.float64] = start.reshape(flat)[row] + f * change.reshape(flat)[row]
            return moved

        return ActorPoses(
            between(position, np.diff(position, axis=0), fraction[:, None]),
            between(heading, wrap_angle(np.diff(heading, axis=0)), fraction),
            between(pitch, np.diff(pitch, axis=0), fraction),
            between(roll, np.diff(roll, axis=0), fraction),
        )

    def signals_at(self, stamp_ns: int) -> NDArray[np.uint8]:
        """State of every signal head of the town (`SignalState`), shape (S,)."""
        step = stamp_ns // STEP_NS - self._first_step
        return self._signals[min(max(step, 0), len(self._signals) - 1)]

    def select_actors(self, index: NDArray[np.intp]) -> Timeline:
        """The same drive with some of the traffic only; cars with physics of their own always remain."""
        index = index[index < len(self._traffic)]
        view = Timeline(self._traffic.take(index), ego=self.ego, car=self.car, cars=self._cars, own=self._own)
        view._frames = [frame.take(index) for frame in self._frames]
        view._signals = self._signals
        view._first_step = self._first_step
        return view

    def _bracket(self, stamp_ns: int) -> tuple[ActorFrame, ActorFrame, float]:
        step = stamp_ns // STEP_NS - self._first_step
        if not 0 <= step < len(self._frames):
            raise ValueError(
                f"time {stamp_ns} ns lies outside the known steps "
                f"{self._first_step * STEP_NS}…{(self._first_step + len(self._frames) - 1) * STEP_NS} ns"
            )
        following = self._frames[min(step + 1, len(self._frames) - 1)]
        return self._frames[step], following, (stamp_ns % STEP_NS) / STEP_NS


def _held(a: ActorFrame, b: ActorFrame, stays: NDArray[np.bool_]) -> ActorFrame:
    """The later frame with some actors still where they were."""
    values = {name: (getattr(a, name), getattr(b, name)) for name in ActorFrame.__slots__}
    return ActorFrame(
        **{name: np.where(stays[:, None] if x.ndim > 1 else stays, x, y) for name, (x, y) in values.items()}
    )


def _turn(a_rad: F32, b_rad: F32, fraction: np.float32) -> F32:
    delta = wrap_angle(b_rad.astype(np.float64) - a_rad)
    return (a_rad + fraction * delta).astype(np.float32)
