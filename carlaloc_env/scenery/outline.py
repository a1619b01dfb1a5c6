"""The standing part of a town: what is hit and felt, its lights, and what is seen."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.signal_lenses import SignalLenses


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TownOutline:
    """The part that is needed where nothing is drawn: what is hit and felt, and where lights are."""

    collision_vertices_m: Array
    """Corners of all that is solid [m], shape (V, 3)."""
    collision_triangles: NDArray[np.int32]
    """Corner indices, shape (T, 3)."""
    collision_tags: NDArray[np.uint8]
    """Semantic `Tag` of each of these triangles, shape (T,)."""
    lenses: SignalLenses
    """Lenses of the traffic lights."""
    road_events: Array
    """Events that wheels feel beside the meshes, columns of `road.road_events`, shape (N, 7)."""
    lamps_m: Array
    """Light sources of the street lamps [m], shape (K, 3)."""

    def to_arrays(self) -> Arrays:
        """The outline as named arrays."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        lenses = {f"lenses/{f.name}": getattr(self.lenses, f.name) for f in fields(SignalLenses)}
        return arrays | {name: value for name, value in lenses.items() if value is not None}

    @staticmethod
    def from_arrays(arrays: Arrays) -> TownOutline:
        """The outline again.

        Raises:
            KeyError: An array is missing.
        """
        prefix = "lenses/"
        lenses = {name[len(prefix) :]: value for name, value in arrays.items() if name.startswith(prefix)}
        return TownOutline(lenses=SignalLenses(**lenses), **{name: arrays[name] for name in _ARRAYS})


_ARRAYS = tuple(field.name for field in fields(TownOutline) if field.name != "lenses")
"""Fields of an outline that are arrays."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TownScenery(TownOutline):
    """The standing part of a town."""

    chunks: tuple[Mesh, ...]
    """Everything that is seen, in squares."""
