"""Listens to a driving world and writes its episode: ego, others, lights, collisions."""

import math
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoState
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from recorder.episode.ego_messages import EgoRow
from recorder.episode.writer import EpisodeWriter

FIRST_DRIVEN_TICK = 2
"""Ticks 0 and 1 are part of `DrivingWorld.reset`."""
_APART_S, _APART_M = 1.0, 1.0
"""A car that is free for so long [s], and so far from the last touch [m], has left what it touched."""


def ego_row(state: EgoState, controls: Controls, raw: Controls | None) -> EgoRow:
    """Row of an episode for the ego after a tick."""
    return EgoRow(
        position_m=state.position_m,
        quat_xyzw=state.quat_xyzw,
        velocity_world_mps=state.velocity_world_mps,
        omega_body_radps=state.omega_body_radps,
        controls=controls,
        raw=raw,
        road_wheel_rad=state.road_wheel_rad,
        speed_mps=state.speed_mps,
        wheel_spin_radps=state.wheel_spin_radps,
    )


class EpisodeListener:
    """A `DriveListener` that records; one for each attempt at a drive.

    Args:
        begin: Makes the writer once the actors are known.
    """

    def __init__(self, begin: Callable[[ActorCatalog], EpisodeWriter]) -> None:
        self._begin = begin
        self._touching: set[str] = set()
        self._seen: set[str] = set()
        self._collisions: dict[str, tuple[int, NDArray[np.float64]]] = {}
        self.raw: Controls | None = None
        """The device's axes before shaping, for the coming tick."""
        self.counts: Counter[str] = Counter()
        """How often each kind of event has happened; touches of one collision count once."""

    @property
    def is_touching(self) -> bool:
        """Whether the ego touches something now."""
        return bool(self._seen or self._touching)

    def on_start(self, catalog: ActorCatalog) -> None:
        """Open the episode."""
        self.writer = self._begin(catalog)

    def on_tick(self, tick: int, state: EgoState, controls: Controls) -> None:
        """Record the ego."""
        self._touching, self._seen = self._seen, set()
        self._position_m = state.position_m
        for what in [what for what, last in self._collisions.items() if self._has_left(tick, *last)]:
            del self._collisions[what]
        self.writer.ego(tick, ego_row(state, controls, self.raw))

    def on_step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        """Record the others and the lights."""
        self.writer.step(step, frame, signals)

    def on_contact(self, tick: int, contact: Contact) -> None:
        """Record where a touch begins; one of a collision that still lasts is marked by ``again``."""
        what = str(contact.actor_id) if contact.actor_id is not None else "static"
        self._seen.add(what)
        if what not in self._touching:
            data = {"with": what, "impulse_ns": contact.impulse_ns}
            if what in self._collisions:
                self.writer.event(tick, "collision", {**data, "again": True})
            else:
                self.event(tick, "collision", data)
        self._collisions[what] = tick, self._position_m

    def _has_left(self, tick: int, last_tick: int, last_m: NDArray[np.float64]) -> bool:
        far = math.dist(self._position_m, last_m) > _APART_M
        return far and (tick - last_tick) * TICK_S > _APART_S

    def event(self, tick: int, kind: str, data: dict[str, object] | None = None) -> None:
        """Record and count something that happened."""
        self.counts[kind] += 1
        self.writer.event(tick, kind, data)
