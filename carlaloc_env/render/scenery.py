"""The static scene on the graphics side: clusters of triangles by material and by level of detail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env import materials
from carlaloc_env.render.clusters import cut
from carlaloc_env.render.detail import Coarseness, coarse, part
from carlaloc_env.render.geometry import Geometry, seen_from_front
from carlaloc_env.render.projection import View
from carlaloc_env.scene import Mesh

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_WORN_FROM = 0.15
"""Porosity from which dirt and wear show: not on leaves, metal and glass."""
_LEVEL_FROM = 0.9
"""Upward part of the normal from which ground bears spots, as in ``gbuffer.frag``."""
_SORTS: tuple[tuple[str, ...], ...] = ((), ("WORN",), ("WORN", "LEVEL"))
"""Features of the shader for smooth things, worn ones and worn level ground."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layer:
    """Triangles of one sort; one call draws any of its clusters."""

    geometry: Geometry
    features: tuple[str, ...]
    """Features of the shader."""
    culled: bool
    """Whether backs need no drawing."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Table:
    """What is known of clusters, parallel arrays."""

    low_m: Array
    """Lowest corners [m], shape (N, 3)."""
    high_m: Array
    """Highest corners [m], shape (N, 3)."""
    large: NDArray[np.bool_]
    """Whether a cluster has large triangles, shape (N,)."""
    chunk: Index
    """Which chunk a cluster belongs to, shape (N,)."""
    level: Index
    """Its level of detail, 0 = all, shape (N,)."""
    culled: NDArray[np.bool_]
    """Whether backs of its triangles need no drawing, shape (N,)."""


class Scenery:
    """Layers of one scene; their clusters are numbered through, layer by layer."""

    def __init__(
        self,
        context: moderngl.Context,
        chunks: Sequence[Mesh],
        far: Sequence[Coarseness],
    ) -> None:
        """Cut and upload.

        Args:
            context: Where it is drawn.
            chunks: Static scenery in squares of some tens of metres.
            far: Coarser levels, the nearest first.
        """
        chunks = [chunk for chunk in chunks if len(chunk.triangles)]
        bounds = np.array([chunk.bounds_m for chunk in chunks], dtype=np.float64).reshape(-1, 2, 3)
        self._low_m, self._high_m = bounds[:, 0], bounds[:, 1]
        self._from_m = [how.from_m for how in far]
        levels = [chunks, *([coarse(chunk, how) for chunk in chunks] for how in far)]
        made = [
            _layer(context, levels, culled, sort) for culled in (True, False) for sort in range(len(_SORTS))
        ]
        self.layers = [layer for layer, _ in made]
        self._end = np.cumsum([len(table.chunk) for _, table in made])
        self.clusters = _Table(
            **{name: np.concatenate([getattr(table, name) for _, table in made]) for name in _Table.__slots__}
        )

    @property
    def low_m(self) -> Array:
        """Lowest corner of everything [m], shape (3,); zero in an empty scene."""
        return self._low_m.min(axis=0) if len(self._low_m) else np.zeros(3)

    @property
    def high_m(self) -> Array:
        """Highest corner of everything [m], shape (3,)."""
        return self._high_m.max(axis=0) if len(self._high_m) else np.zeros(3)

    def __len__(self) -> int:
        return len(self._low_m)

    def in_view(self, view: View, *, farther: float = 1.0) -> tuple[Index, Array]:
        """Clusters that may be seen, nearest first, and their distances [m].

        The level of detail goes by the distance of the chunk, so that it has no seams inside.

        Args:
            view: Camera.
            farther: Chunks have the level of so many times their distance, e.g. since pixels are large.
        """
        table = self.clusters
        seen, distance = view.visible(self._low_m, self._high_m)
        wanted = np.full(len(self._low_m), -1)
        wanted[seen] = np.searchsorted(self._from_m, farther * distance, side="right")
        candidates = np.flatnonzero(wanted[table.chunk] == table.level)
        inside, away = view.visible(table.low_m[candidates], table.high_m[candidates])
        return candidates[inside], away

    def by_layer(self, clusters: Index) -> list[Index]:
        """Clusters of every layer among some, by their numbers in it, in the order given."""
        owner = np.searchsorted(self._end, clusters, side="right")
        first = np.concatenate([[0], self._end])
        return [clusters[owner == k] - first[k] for k in range(len(self.layers))]

    def casting(self, axes: Array, low: Array, high: Array) -> Index:
        """Clusters in full detail that reach into a box along some axes.

        Args:
            axes: Directions of the box's edges, shape (K, 3).
            low: Lower bounds along them [m], shape (K,).
            high: Upper bounds, shape (K,).
        """
        table = self.clusters
        middle, half = (table.low_m + table.high_m) / 2, (table.high_m - table.low_m) / 2
        along = np.sum(axes[:, None] * middle, axis=2)
        reach = np.sum(np.abs(axes)[:, None] * half, axis=2)
        inside = (along + reach > low[:, None]) & (along - reach < high[:, None])
        return np.flatnonzero(inside.all(axis=0) & (table.level == 0))

    def draw_bare(self, program: moderngl.Program, clusters: Index) -> None:
        """Draw some clusters for a map of depths."""
        for layer, some in zip(self.layers, self.by_layer(clusters), strict=True):
            layer.geometry.draw(program, some, bare=True)

    def release(self) -> None:
        """Free the buffers."""
        for layer in self.layers:
            layer.geometry.release()


def _sorts(mesh: Mesh) -> tuple[NDArray[np.bool_], Index]:
    """Of every triangle: whether its back needs no drawing, and its place in `_SORTS`, shape (T,)."""
    material = mesh.material[mesh.triangles[:, 2]]
    worn = materials.table("porosity")[material] > _WORN_FROM
    level = worn & (mesh.normals[mesh.triangles, 2] > _LEVEL_FROM).any(axis=1)
    return seen_from_front()[material], worn.astype(np.intp) + level


def _layer(
    context: moderngl.Context, levels: Sequence[Sequence[Mesh]], culled: bool, sort: int
) -> tuple[Layer, _Table]:
    cuts, chunk, level = [], [], []
    for k, meshes in enumerate(levels):
        for c, mesh in enumerate(meshes):
            front, sorts = _sorts(mesh)
            clusters = cut(part(mesh, (front == culled) & (sorts == sort)))
            cuts.append(clusters)
            chunk.append(np.full(len(clusters.count), c))
            level.append(np.full(len(clusters.count), k))

    def joined(parts: list[NDArray[np.generic]], empty: tuple[int, ...] = (0,)) -> NDArray[np.generic]:
        return np.concatenate(parts) if parts else np.zeros(empty)

    count = joined([one.count for one in cuts]).astype(np.int64)
    layer = Layer(
        geometry=Geometry(context, [one.mesh for one in cuts], count), features=_SORTS[sort], culled=culled
    )
    return layer, _Table(
        low_m=joined([one.low_m for one in cuts], (0, 3)).astype(np.float64),
        high_m=joined([one.high_m for one in cuts], (0, 3)).astype(np.float64),
        large=joined([one.large for one in cuts]).astype(bool),
        chunk=joined(chunk).astype(np.intp),
        level=joined(level).astype(np.intp),
        culled=np.full(len(count), culled),
    )
