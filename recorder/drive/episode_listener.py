"""Listens to a driving world and writes its episode: ego, others, lights, collisions."""

import math
from collections import Counter, defaultdict
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


class _Touches:
    """What a car touches, and what it has collided with and not left yet."""

    def __init__(self) -> None:
        self.touching: dict[str, float] = {}
        self.seen: dict[str, float] = {}
        self.collisions: dict[str, tuple[int, Vector3]] = {}
        self.position_m: Vector3 = (0.0, 0.0, 0.0)

    def move_to(self, tick: int, position_m: Vector3) -> None:
        """Take note of where the car is after a tick."""
        self.touching, self.seen, self.position_m = self.seen, {}, position_m
        for what in [what for what, last in self.collisions.items() if self._has_left(tick, *last)]:
            del self.collisions[what]

    def _has_left(self, tick: int, last_tick: int, last_m: Vector3) -> bool:
        far = math.dist(self.position_m, last_m) > _APART_M
        return far and (tick - last_tick) * TICK_S > _APART_S


class EpisodeListener:
    """A `DriveListener` that records; one for each attempt at a drive.

    Args:
        begin: Makes the writer once the actors are known.
    """

    def __init__(self, begin: Callable[[ActorCatalog], EpisodeWriter]) -> None:
        self._begin = begin
        self._cars: dict[int, _Touches] = defaultdict(_Touches)
        self.raw: Controls | None = None
        """The device's axes before shaping, for the coming tick."""
        self.counts: Counter[str] = Counter()
        """How often each kind of event has happened; touches of one collision count once."""

    @property
    def is_touching(self) -> bool:
        """Whether the first car touches something now."""
        return bool(self._cars[0].seen or self._cars[0].touching)

    def on_start(self, catalog: ActorCatalog) -> None:
        """Open the episode."""
        self.writer = self._begin(catalog)

    def on_tick(self, tick: int, state: EgoTick, controls: Controls, car: int = 0) -> None:
        """Record a car."""
        self._cars[car].move_to(tick, state.position_m)
        self.writer.ego(tick, EgoRow(*state, controls, None if car else self.raw), car)

    def on_step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        """Record the others and the lights."""
        self.writer.step(step, frame, signals)

    def on_contact(self, tick: int, contact: Contact, car: int = 0) -> None:
        """Record where a touch begins or hits harder; ``again`` marks those of a collision that lasts."""
        touches = self._cars[car]
        what = str(contact.actor_id) if contact.actor_id is not None else "static"
        hardest_ns = touches.touching.get(what, 0.0)
        touches.seen[what] = max(hardest_ns, contact.impulse_ns)
        if contact.impulse_ns > hardest_ns:
            data = {"with": what, "impulse_ns": contact.impulse_ns, **of_car(car)}
            if what in touches.collisions:
                self.writer.event(tick, "collision", {**data, "again": True})
            else:
                self.event(tick, "collision", data)
        touches.collisions[what] = tick, touches.position_m

    def event(self, tick: int, kind: str, data: dict[str, object] | None = None) -> None:
        """Record something that happened, and count it where it happened to the first car."""
        self.counts[kind] += "car" not in (data or {})
        self.writer.event(tick, kind, data)


def of_car(car: int) -> dict[str, object]:
    """Note in an event of which car it is, from 1; none for the first."""
    return {"car": car + 1} if car else {}
