"""First hits of rays, as parallel arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.parallel_arrays import ParallelArrays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hits(ParallelArrays):
    """The first surface along each of N rays."""

    range_m: F32
    """Distance along the ray [m], inf where nothing was hit, shape (N,)."""
    tag: NDArray[np.uint8]
    """Semantic `Tag` of the surface, shape (N,)."""
    instance: NDArray[np.uint32]
    """Instance id of the surface, 0 = none, shape (N,)."""
    material: NDArray[np.uint8]
    """`Material` of the surface, shape (N,)."""
    cos_incidence: F32
    """Cosine between the ray and the surface normal, 0 (grazing) to 1, shape (N,)."""
    tone: F32
    """Reflectance there over the material's mean, about 1, shape (N,)."""

    def __len__(self) -> int:
        return len(self.range_m)

    @classmethod
    def none(cls, count: int) -> Hits:
        """Rays that met nothing."""
        return cls(
            range_m=np.full(count, np.inf, np.float32),
            tag=np.zeros(count, np.uint8),
            instance=np.zeros(count, np.uint32),
            material=np.zeros(count, np.uint8),
            cos_incidence=np.zeros(count, np.float32),
            tone=np.ones(count, np.float32),
        )

    def put(self, rows: NDArray[np.intp] | slice, other: Hits) -> None:
        """Overwrite some rows, shape (M,), by the hits of M other rays."""
        for name in self.__slots__:
            getattr(self, name)[rows] = getattr(other, name)
