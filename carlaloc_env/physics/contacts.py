"""Contacts of a car's body with other things, added up until they are read."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from carlaloc_env.core.clock import TICK_S

Vector3 = tuple[float, float, float]
"""x, y, z."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """One thing that a car's body touched since the last query."""

    actor_id: int | None
    """Instance id of the actor or other car, None for the static town."""
    impulse_ns: float
    """Sum of the normal impulses [N s]."""
    position_m: Vector3
    """Where the strongest impulse acted [m], world."""


class ContactLog:
    """Adds up PyBullet's contact points per thing touched until they are read."""

    def __init__(self) -> None:
        self._touched: dict[int | None, tuple[float, float, Vector3]] = {}

    def add(self, points: Iterable[Any], actor_of: Callable[[int], int | None]) -> None:
        """Take in the contact points of one tick; `actor_of` names the actor of a body."""
        for point in points:
            impulse = point[9] * TICK_S
            if impulse <= 0.0:
                continue
            actor = actor_of(point[2])
            total, hardest, where = self._touched.get(actor, (0.0, 0.0, point[5]))
            if impulse > hardest:
                hardest, where = impulse, point[5]
            self._touched[actor] = (total + impulse, hardest, where)

    def take(self) -> list[Contact]:
        """All contacts since the last call, hardest first."""
        if not self._touched:
            return []
        contacts = [
            Contact(actor_id=actor, impulse_ns=total, position_m=where)
            for actor, (total, _, where) in self._touched.items()
        ]
        self._touched.clear()
        return sorted(contacts, key=lambda contact: -contact.impulse_ns)
