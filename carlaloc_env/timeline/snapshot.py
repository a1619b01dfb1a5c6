"""Snapshot: one instant of a drive, with which cameras, the window and rays draw moving things."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.timeline.actors import (
    LIGHT_BRAKE,
    LIGHT_REVERSE,
    ActorCatalog,
    ActorFrame,
    empty_catalog,
    empty_frame,
)
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.timeline.vehicle_track import BRAKE_FRACTION, CarTrack

_BLINK_NS = 666_666_666
"""Period of the indicators [ns]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """State of ego, actors and signals at one instant; holds no timeline, so it can go to another process."""

    stamp_ns: int
    """Time since the drive began [ns]."""
    T_world_base: Array
    """Pose of the ego's `base_link`, maps it to the world, shape (4, 4)."""
    ego_velocity_mps: Array = field(default_factory=lambda: np.zeros(3))
    """Velocity of `base_link` in world axes [m/s], shape (3,)."""
    ego_lights: int = 0
    """Bits of the ego's lit lights (`LIGHT_BRAKE` …)."""
    ego_headlamps: bool = True
    """Whether the ego's headlamps are switched on; they shine by night only."""
    catalog: ActorCatalog = field(default_factory=empty_catalog)
    """The other actors, N of them."""
    actors: ActorFrame = field(default_factory=empty_frame)
    """Their state."""
    signals: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    """State of every signal head of the town (0 off, 1 red, 2 yellow, 3 green), shape (S,)."""

    @classmethod
    def of(cls, timeline: Timeline, stamp_ns: int) -> Snapshot:
        """Snapshot of a timeline at a time [ns].

        Raises:
            ValueError: the time lies outside the timeline.
        """
        motion = timeline.ego_motion([stamp_ns])
        return cls(
            stamp_ns=stamp_ns,
            T_world_base=motion.T_world_frame[0],
            ego_velocity_mps=motion.velocity_world_mps[0],
            ego_lights=ego_lights(timeline.car, stamp_ns),
            catalog=timeline.catalog,
            actors=timeline.actors_at(stamp_ns),
            signals=timeline.signals_at(stamp_ns),
        )


def ego_lights(car: CarTrack, stamp_ns: int) -> int:
    """Bits of the ego's lit lights by its pedals and gear at a time [ns]; 0 where they are not known."""
    try:
        state = car.at(stamp_ns)
    except EpisodeError:
        return 0
    braking = float(state.brake[0]) > BRAKE_FRACTION
    return braking * LIGHT_BRAKE + bool(state.reverse[0]) * LIGHT_REVERSE


def is_blink(stamp_ns: int) -> bool:
    """Whether indicators that are switched on shine at a time [ns]."""
    return (stamp_ns % _BLINK_NS) * 2 < _BLINK_NS
