"""Lens discs of the traffic lights of a town."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalLenses:
    """Lens discs of all traffic-light heads of a town, parallel arrays of L lenses."""

    signal: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Index of the signal whose state lights the lens, shape (L,)."""
    state: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    """State in which the lens is lit (1 red, 2 yellow, 3 green), shape (L,)."""
    T_world_lens: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """Pose of each lens, x out of it, shape (L, 4, 4)."""
    instance: NDArray[np.uint32] | None = None
    """Instance id of each lens' traffic light, shape (L,); none when left out."""

    def __len__(self) -> int:
        return len(self.signal)
