"""The static scene on the graphics side: clusters of triangles by material and by level of detail."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.core.freed_memory import give_back_freed_memory, give_back_mapped_pages
from carlaloc_env.render.geometry.clusters import cut, in_order
from carlaloc_env.render.geometry.level_of_detail import Coarseness, coarse
from carlaloc_env.render.geometry.mesh_buffers import MeshBuffers, ranges
from carlaloc_env.render.geometry.packed_meshes import PACKED, kept, packed, seen_from_front
from carlaloc_env.render.views import CameraView
from carlaloc_env.scene.materials import material_values
from carlaloc_env.scene.mesh import Mesh, merge

KEPT_FILES = 12
"""Cached scenes kept: a town has one for live pictures and one for others."""
_WORN_FROM = 0.15
"""Porosity from which dirt and wear show: not on leaves, metal and glass."""
NEAREST_M = 1.0
"""Levels of detail take nothing to be nearer: cameras on cars have roads and walls no nearer [m]."""
LEVEL_FROM = 0.9
"""Upward part of the normal from which ground is level."""
_SORTS: tuple[tuple[str, ...], ...] = ((), ("WORN",), ("WORN", "LEVEL"))
"""Features of the shader for smooth things, worn ones and worn level ground."""
_LAYERS = tuple((culled, sort) for culled in (False, True) for sort in range(len(_SORTS)))
"""Whether backs are culled, and the place in `_SORTS`; leaves first, since they stand before walls."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layer:
    """Triangles of one sort; one call draws any of its clusters."""

    geometry: MeshBuffers
    features: tuple[str, ...]
    """Features of the shader."""
    culled: bool
    """Whether backs need no drawing."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Table:
    """Properties of clusters, parallel arrays."""

    low_m: Array
    """Lowest corners [m], shape (N, 3)."""
    high_m: Array
    """Highest corners [m], shape (N, 3)."""
    large: NDArray[np.bool_]
    """Whether a cluster has large triangles, shape (N,)."""
    cell: Index
    """Which cell a cluster belongs to, shape (N,)."""
    level: Index
    """Its level of detail, 0 = all, shape (N,)."""
    culled: NDArray[np.bool_]
    """Whether backs of its triangles need no drawing, shape (N,)."""


class StaticScene:
    """Layers of one scene; their clusters are numbered through, layer by layer."""

    def __init__(
        self,
        context: moderngl.Context,
        chunks: Sequence[Mesh],
        far: Sequence[Coarseness],
        cell_m: float = math.inf,
    ) -> None:
        """Cut and upload.

        Args:
            context: Where it is drawn.
            chunks: Static scenery in squares of some tens of metres.
            far: Coarser levels, the nearest first.
            cell_m: Edge of the cells of a chunk that have a level of detail of their own [m].
        """
        chunks = [chunk for chunk in chunks if len(chunk.triangles)]
        self._from_m = [how.from_m for how in far]
        made = kept(
            "scene",
            chunks,
            lambda: _packed_layers(chunks, far, cell_m),
            module=__name__,
            content=repr((far, cell_m)),
            kept_files=KEPT_FILES,
        )
        self._end = made["end"]
        self._boxes_m, self._near_m = made["boxes_m"], made["near_m"]
        self.clusters = _Table(**{name: made[name] for name in _Table.__slots__})
        self._levels = 1 + len(far)
        key = self.clusters.cell * self._levels + self.clusters.level
        self._order = np.argsort(key, kind="stable")
        self._begin = np.searchsorted(key[self._order], np.arange(len(self) * self._levels + 1))
        self.layers = [
            Layer(
                geometry=MeshBuffers(context, {name: made[f"{k} {name}"] for name in PACKED}),
                features=_SORTS[sort],
                culled=culled,
            )
            for k, (culled, sort) in enumerate(_LAYERS)
        ]
        give_back_freed_memory()

    @property
    def low_m(self) -> Array:
        """Lowest corner of everything [m], shape (3,); zero in an empty scene."""
        return self._boxes_m[:, 0].min(axis=0) if len(self) else np.zeros(3)

    @property
    def high_m(self) -> Array:
        """Highest corner of everything [m], shape (3,)."""
        return self._boxes_m[:, 1].max(axis=0) if len(self) else np.zeros(3)

    def __len__(self) -> int:
        return len(self._boxes_m)

    def in_view(self, view: CameraView, *, farther: float = 1.0) -> tuple[Index, Array]:
        """Clusters that may be seen, nearest first, and their distances [m].

        The distance of a cell decides its level of detail, so that it has no seams inside.

        Args:
            view: Camera.
            farther: Factor on the distance by which levels are chosen; above 1 where pixels are large.
        """
        table = self.clusters
        seen, _ = view.visible(self._boxes_m[:, 0], self._boxes_m[:, 1])
        low_m, high_m = np.moveaxis(self._near_m[seen], 1, 0)
        gap_m = np.maximum(np.maximum(low_m - view.position_m, view.position_m - high_m), 0.0)
        distance = np.sqrt(np.sum(gap_m**2, axis=1))
        level = np.searchsorted(self._from_m, farther * np.maximum(distance, NEAREST_M), side="right")
        key = seen * self._levels + level
        candidates = np.sort(self._order[ranges(self._begin[key], self._begin[key + 1])])
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
    worn = material_values("porosity")[material] > _WORN_FROM
    up = mesh.normals[:, 2] > LEVEL_FROM
    first, second, third = (np.take(up, mesh.triangles[:, k]) for k in range(3))
    level = worn & (first | second | third)
    return seen_from_front()[material], worn.astype(np.intp) + level


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    """Triangles of one level of detail in one layer."""

    mesh: Mesh
    """Triangles in the order of their clusters."""
    count: NDArray[np.int64]
    """Triangles of each cluster, shape (N,)."""
    table: _Table
    """The clusters."""


def _cut_level(chunks: Sequence[Mesh], cells: Sequence[Index], level: int) -> list[_Part]:
    """Clusters of all chunks in one level of detail, a part for every layer.

    Args:
        chunks: The chunks in that level.
        cells: Cell of each triangle of each chunk.
        level: The level.
    """
    whole, of = merge(chunks), np.concatenate([np.zeros(0, np.intp), *cells])
    for chunk in chunks:
        give_back_mapped_pages(chunk.vertices_m)
    front, sort = _sorts(whole)
    layer, number = np.where(front, len(_SORTS), 0) + sort, int(of.max(initial=0)) + 1
    clusters = cut(whole, layer * number + of)
    owner = clusters.group // number
    end = np.cumsum(clusters.count)
    parts = []
    for k, (culled, _) in enumerate(_LAYERS):
        part = slice(*np.searchsorted(owner, [k, k + 1]))
        first, last = np.concatenate([[0], end])[[part.start, part.stop]]
        count = clusters.count[part]
        table = _Table(
            low_m=clusters.low_m[part],
            high_m=clusters.high_m[part],
            large=clusters.large[part],
            cell=clusters.group[part] % number,
            level=np.full(len(count), level),
            culled=np.full(len(count), culled),
        )
        parts.append(_Part(mesh=in_order(whole, clusters.order[first:last]), count=count, table=table))
    return parts


def _coarse(chunk: Mesh, how: Coarseness) -> tuple[Mesh, Index]:
    """A coarser level of a chunk; of a town's file no more is in memory meanwhile than of one chunk."""
    coarser = coarse(chunk, how)
    give_back_mapped_pages(chunk.vertices_m)
    return coarser


def _cells(chunks: Sequence[Mesh], edge_m: float) -> tuple[list[Index], NDArray[np.int64]]:
    """Cells of the triangles of chunks, numbered through, shape (T,) each, and their squares, (N, 2)."""
    cells, squares = [], [np.zeros((0, 2), np.int64)]
    for chunk in chunks:
        middle_m = sum(chunk.vertices_m[chunk.triangles[:, k], :2] for k in range(3)) / 3.0
        square, cell = np.unique(np.floor(middle_m / edge_m).astype(np.int64), axis=0, return_inverse=True)
        cells.append(sum(map(len, squares)) + cell.reshape(-1))
        squares.append(square)
    return cells, np.concatenate(squares)


def mesh_boxes(chunks: Sequence[Mesh]) -> tuple[Array, Array]:
    """Lowest and highest corners of meshes [m], shape (N, 3) each; zero where one is empty."""
    bounds = [chunk.bounds_m if len(chunk.vertices_m) else np.zeros((2, 3)) for chunk in chunks]
    low_m, high_m = np.moveaxis(np.array(bounds, dtype=np.float64).reshape(-1, 2, 3), 1, 0)
    return low_m, high_m


def _packed_layers(chunks: Sequence[Mesh], far: Sequence[Coarseness], cell_m: float) -> Arrays:
    """The clusters of all layers, columns of `_Table`; where each layer's end; each layer as it is uploaded.

    Parts are let go as soon as they are packed: together they are larger than the buffers.
    """
    cells, squares = _cells(chunks, cell_m)
    parts = [_cut_level(chunks, cells, 0)]
    for level, how in enumerate(far, start=1):
        made_of = [_coarse(chunk, how) for chunk in chunks]
        of = [cell[made] for cell, (_, made) in zip(cells, made_of, strict=True)]
        parts.append(_cut_level([mesh for mesh, _ in made_of], of, level))
    layers = range(len(_LAYERS))
    tables = [part[k].table for k in layers for part in parts]
    made = {name: np.concatenate([getattr(table, name) for table in tables]) for name in _Table.__slots__}
    made["end"] = np.cumsum([sum(len(part[k].count) for part in parts) for k in layers])
    made |= _boxes(made, squares, cell_m)
    for k in layers:
        count = np.concatenate([level[0].count for level in parts])
        layer = packed((level.pop(0).mesh for level in parts), count)
        made |= {f"{k} {name}": value for name, value in layer.items()}
    return made


def _boxes(table: Arrays, squares: NDArray[np.int64], edge_m: float) -> Arrays:
    """Boxes round cells in full detail, and the parts of them in their squares, (N, 2, 3) each [m]."""
    whole = table["level"] == 0
    boxes_m = np.stack([np.full((len(squares), 3), bound) for bound in (np.inf, -np.inf)], axis=1)
    np.minimum.at(boxes_m[:, 0], table["cell"][whole], table["low_m"][whole])
    np.maximum.at(boxes_m[:, 1], table["cell"][whole], table["high_m"][whole])
    near_m = boxes_m.copy()
    if edge_m < math.inf:
        low_m = edge_m * squares[:, None]
        near_m[..., :2] = np.clip(near_m[..., :2], low_m, low_m + edge_m)
    return {"boxes_m": boxes_m, "near_m": near_m}
