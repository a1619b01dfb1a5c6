"""Listens to a driving world and writes its episode: ego, others, lights, collisions."""

import math
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.physics.contacts import Contact, Vector3
from carlaloc_env.physics.ego import EgoTick
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from recorder.episode.ego_messages import EgoRow
from recorder.episode.writer import EpisodeWriter

FIRST_DRIVEN_TICK = 2
"""Ticks 0 and 1 are part of `DrivingWorld.reset`."""
_APART_S, _APART_M = 1.0, 1.0
"""A car that is free for so long [s], and so far from the last touch [m], has left what it touched."""


class EpisodeListener:
    """A `DriveListener` that records; one for each attempt at a drive.

    Args:
        begin: Makes the writer once the actors are known.
    """

    def __init__(self, begin: Callable[[ActorCatalog], EpisodeWriter]) -> None:
        self._begin = begin
        self._touching: dict[str, float] = {}
        self._seen: dict[str, float] = {}
        self._collisions: dict[str, tuple[int, Vector3]] = {}
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

    def on_tick(self, tick: int, state: EgoTick, controls: Controls) -> None:
        """Record the ego."""
        self._touching, self._seen = self._seen, {}
        self._position_m = state.position_m
        for what in [what for what, last in self._collisions.items() if self._has_left(tick, *last)]:
            del self._collisions[what]
        self.writer.ego(tick, EgoRow(*state, controls, self.raw))

    def on_step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        """Record the others and the lights."""
        self.writer.step(step, frame, signals)

    def on_contact(self, tick: int, contact: Contact) -> None:
        """Record where a touch begins or hits harder; ``again`` marks those of a collision that lasts."""
        what = str(contact.actor_id) if contact.actor_id is not None else "static"
        hardest_ns = self._touching.get(what, 0.0)
        self._seen[what] = max(hardest_ns, contact.impulse_ns)
        if contact.impulse_ns > hardest_ns:
            data = {"with": what, "impulse_ns": contact.impulse_ns}
            if what in self._collisions:
                self.writer.event(tick, "collision", {**data, "again": True})
            else:
                self.event(tick, "collision", data)
        self._collisions[what] = tick, self._position_m

    def _has_left(self, tick: int, last_tick: int, last_m: Vector3) -> bool:
        far = math.dist(self._position_m, last_m) > _APART_M
        return far and (tick - last_tick) * TICK_S > _APART_S

    def event(self, tick: int, kind: str, data: dict[str, object] | None = None) -> None:
        """Record and count something that happened."""
        self.counts[kind] += 1
        self.writer.event(tick, kind, data)
