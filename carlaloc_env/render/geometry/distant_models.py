"""Models of few triangles for vehicles and walkers that look small."""

from dataclasses import replace

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.render.geometry.level_of_detail import Coarseness, gathered
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary

_FROM_PX = (1.0, 8.0, 120.0)
"""Sizes in the picture from which cars and walkers are drawn in the fewest triangles, in few, in all [px]."""
_SIMPLE_TRIANGLES = 200
"""Models of so few triangles have no simplest one."""
_CELLS = 12
"""Cells along the longest edge of the simplest models."""
_EGO_CELLS = 48
"""The same of the ego in small pictures, whose bonnet is near."""


def simplified(mesh: Mesh, cells: int) -> Mesh:
    """A model with its corners gathered in a number of cells along its longest edge."""
    edge_m = float(np.max(mesh.bounds_m[1] - mesh.bounds_m[0])) / cells
    how = Coarseness(from_m=0.0, crumb_m2=0.0, leaf_stride=1, edge_m=edge_m, ground_m=edge_m)
    return gathered(mesh, how, ())[0]


class Distant:
    """Simpler models that stand for others, by their size in the picture."""

    def __init__(self, library: ModelLibrary) -> None:
        """Pair ``name/body`` and its lamps with ``name/low``, and these with the simplest."""
        index = {name: k for k, name in enumerate(library.names)}
        lowered = {name.partition("/")[0] for name in index if "/low" in name}
        self.measured = [index.get(f"{name.partition('/')[0]}/body", k) for name, k in index.items()]
        """Model by which the size of each is judged: of a car's parts its body."""
        self._stand_in = np.tile(np.arange(len(library)), (4, 1))
        for name, k in index.items():
            family, _, part = name.partition("/")
            if f"{family}/body" in index and part.startswith("wheel"):
                self._stand_in[1:, k] = -1
            elif f"{family}/body" in index:
                low = f"{family}/low" if part == "body" else f"{family}/low/{part}"
                self._stand_in[1:, k] = index.get(low, k)
            self._stand_in[3, k] = -1 if family in lowered else k
        self.simplified: list[tuple[int, int]] = []
        """Models of which there are simpler ones, and their cells; these are numbered after the library's."""
        for k, (name, mesh) in enumerate(zip(library.names, library.meshes, strict=True)):
            if "/low" in name and len(mesh.triangles) > _SIMPLE_TRIANGLES:
                self._stand_in[2, self._stand_in[2] == k] = len(library) + len(self.simplified)
                self.simplified.append((k, _CELLS))
            elif name == "ego":
                self._stand_in[1:3, k] = len(library) + len(self.simplified) + np.arange(2)
                self.simplified += [(k, _EGO_CELLS), (k, _CELLS)]

    def of(self, instances: Instances, level: Index | int) -> Instances:
        """The instances with the models that stand for them at their levels (N,), or at one; see `levels`."""
        model = self._stand_in[level, instances.model].astype(np.int32)
        return replace(instances, model=model).take(np.flatnonzero(model >= 0))


def levels(size_px: Array) -> Index:
    """Levels of models by their size in the picture (N,) [px]: 0 whole, 1 few triangles, 2 fewest, 3 none."""
    return np.asarray(len(_FROM_PX) - np.searchsorted(_FROM_PX, size_px, side="right"))
