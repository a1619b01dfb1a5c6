"""States of a sensor at stamps on a grid, each made from the one before, for stamps asked for in any order.

States begin anew at fixed times of the drive. A stamp that does not follow the last one is reached from the
last such beginning. So a state depends on the drive alone, not on the stamps that were asked for before.
"""

import weakref
from collections.abc import Callable, Hashable, Iterator
from typing import Generic, TypeVar

from carlaloc_env.sensors.camera_config import beginning_ns, rounded_up_ns
from carlaloc_env.timeline.timeline import Timeline

S = TypeVar("S")


class Chain(Generic[S]):
    """States at stamps on a grid, each made from the one before."""

    def __init__(self, period_ns: int, restart_ns: int) -> None:
        """Make an empty chain.

        Args:
            period_ns: Time between two states [ns].
            restart_ns: States at its multiples do not depend on earlier ones [ns].
        """
        self._period_ns = period_ns
        self._restart_ns = restart_ns
        self._held: tuple[weakref.ref[Timeline], Hashable, int, S] | None = None

    def at(
        self,
        timeline: Timeline,
        stamp_ns: int,
        key: Hashable,
        begin: Callable[[int], S],
        follow: Callable[[S, int], S],
    ) -> S:
        """State at a stamp [ns].

        Args:
            timeline: The drive; the oldest stamp that it knows is a beginning too.
            stamp_ns: A multiple of the period [ns].
            key: What else the state depends on, e.g. the weathers.
            begin: Makes the state at a stamp without history.
            follow: Makes the state at a stamp from that one period before; at a multiple of the
                restart it must forget by itself.
        """
        for _ in self.towards(timeline, stamp_ns, key, begin, follow):
            pass
        state = self._kept(timeline, stamp_ns, key)
        assert state is not None
        return state

    def towards(
        self,
        timeline: Timeline,
        stamp_ns: int,
        key: Hashable,
        begin: Callable[[int], S],
        follow: Callable[[S, int], S],
    ) -> Iterator[int]:
        """Stamps of the states that are missing up to one [ns]; each is made when the next is asked for.

        Takes the arguments of `at`, which continues from the last state that was made.
        """
        if self._kept(timeline, stamp_ns, key) is not None:
            return
        before_ns = stamp_ns - self._period_ns
        state = self._kept(timeline, before_ns, key)
        if state is not None:
            next_ns = stamp_ns
        else:
            first_ns = beginning_ns(stamp_ns, self._period_ns, self._restart_ns)
            oldest_ns = rounded_up_ns(timeline.start_ns, self._period_ns)
            next_ns = stamp_ns if before_ns < oldest_ns else max(first_ns, oldest_ns)
        for at_ns in range(next_ns, stamp_ns + 1, self._period_ns):
            yield at_ns
            state = begin(at_ns) if state is None else follow(state, at_ns)
            self._held = (weakref.ref(timeline), key, at_ns, state)

    def _kept(self, timeline: Timeline, stamp_ns: int, key: Hashable) -> S | None:
        if self._held is None:
            return None
        of, held_key, held_ns, state = self._held
        return state if of() is timeline and held_key == key and held_ns == stamp_ns else None
