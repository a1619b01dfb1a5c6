"""Instance ids of what stands in a town: one counter, so that no two things share one."""

from __future__ import annotations

from carlaloc_env.core.errors import MapError
from carlaloc_env.scene.mesh import EGO_INSTANCE


class InstanceIds:
    """Ids handed out upwards from 1; 0 is the id of what has none, such as the ground."""

    def __init__(self) -> None:
        self._next = 1

    def take(self, count: int = 1) -> int:
        """First of `count` consecutive ids that nothing else has.

        Raises:
            MapError: The ids below that of the ego are used up.
        """
        first = self._next
        if first + count > EGO_INSTANCE:
            raise MapError(f"the town holds more than {EGO_INSTANCE - 1} single things; take a smaller map")
        self._next += count
        return first
