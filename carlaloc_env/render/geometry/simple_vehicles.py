"""Cars of few triangles for small pictures, from nearer on than the scene chooses them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.scene.mesh import Instances, ModelLibrary

SIMPLE_FROM_M = 18.0
"""Distance from which cars are simpler in pictures of `detail.FAR_LOW_FOCAL_PX` [m]."""


class Distant:
    """Which simple model stands for which whole one."""

    def __init__(self, library: ModelLibrary) -> None:
        """Pair the models ``name/body`` and ``name/low``, their lamps, and leave single wheels out."""
        index = {name: k for k, name in enumerate(library.names)}
        self._simple = np.arange(len(library))
        self._left_out = np.zeros(len(library), dtype=bool)
        for name, k in index.items():
            family, _, part = name.partition("/")
            if f"{family}/body" not in index or f"{family}/low" not in index:
                continue
            if part == "body":
                self._simple[k] = index[f"{family}/low"]
            elif part.startswith("wheel"):
                self._left_out[k] = True
            else:
                self._simple[k] = index.get(f"{family}/low/{part}", k)

    def of(self, instances: Instances, far: NDArray[np.bool_] | bool) -> Instances:
        """The instances with simple models for those that are far from the eye, shape (N,), or for all."""
        keep = np.flatnonzero(~(far & self._left_out[instances.model]))
        model = np.where(far, self._simple[instances.model], instances.model).astype(np.int32)
        return replace(instances, model=model).take(keep)
