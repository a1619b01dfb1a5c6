"""What the ego's body touched."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """One thing that the ego's body touched since the last query."""

    actor_id: int | None
    """Instance id of the actor, None for the static town."""
    impulse_ns: float
    """Sum of the normal impulses [N s]."""
    position_m: tuple[float, float, float]
    """Where the strongest impulse acted [m], world."""

    @property
    def is_static(self) -> bool:
        """Whether the static town was touched."""
        return self.actor_id is None
