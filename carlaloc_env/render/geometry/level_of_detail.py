"""Parts of the scenery that are culled and simplified as wholes.

Levels of detail: what a part of the scenery loses from some distance on.

Cars of few triangles for small pictures, from nearer on than the scene chooses them.

Scenery cut into clusters: some hundred triangles that lie together and are culled as one.

In a street most triangles of a chunk lie outside the picture or behind a house; on a CPU each of them
costs as much as one that is seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary, face_vectors, merge
from carlaloc_env.scene.semantic_tags import Tag


@dataclass(frozen=True, slots=True, kw_only=True)
class Coarseness:
    """How much a chunk loses from some distance on."""

    from_m: float
    """Distance of the chunk [m]."""
    crumb_m2: float
    """Loose triangles of less area are left out [m²]."""
    any_m2: float = 0.0
    """Any triangles of less area are left out [m²]; in a wall this leaves holes of that size."""
    leaf_stride: int
    """Every n-th leaf is kept, enlarged to the same total area."""
    edge_m: float = 0.0
    """Corners that lie in one cell of this size become one [m]; 0 = none do."""
    ground_m: float = 0.0
    """The same for corners of the ground, which is seen at a grazing angle [m]."""


FAR = (Coarseness(from_m=150.0, crumb_m2=0.012, leaf_stride=4),)
"""Crumbs of a quarter of a pixel; LiDARs reach less far."""
FAR_LOW = (
    Coarseness(from_m=10.0, crumb_m2=0.025, leaf_stride=8),
    Coarseness(from_m=45.0, crumb_m2=0.12, any_m2=0.03, leaf_stride=12, edge_m=0.15, ground_m=1.0),
    Coarseness(from_m=80.0, crumb_m2=0.3, any_m2=0.06, leaf_stride=20, edge_m=0.2, ground_m=1.5),
    Coarseness(from_m=130.0, crumb_m2=0.8, any_m2=0.15, leaf_stride=36, edge_m=0.3, ground_m=3.0),
    Coarseness(from_m=200.0, crumb_m2=2.0, any_m2=0.4, leaf_stride=100, edge_m=0.5, ground_m=5.0),
    Coarseness(from_m=300.0, crumb_m2=5.0, any_m2=0.9, leaf_stride=220, edge_m=0.8, ground_m=9.0),
    Coarseness(from_m=650.0, crumb_m2=25.0, any_m2=6.0, leaf_stride=600, edge_m=1.6, ground_m=16.0),
    Coarseness(from_m=1400.0, crumb_m2=80.0, any_m2=20.0, leaf_stride=1500, edge_m=3.5, ground_m=35.0),
    Coarseness(from_m=2500.0, crumb_m2=200.0, any_m2=70.0, leaf_stride=3000, edge_m=8.0, ground_m=80.0),
)
"""For small live pictures, in which vertices cost the most; a pixel covers about one `edge_m`.

The last ones are for pictures of about 100 px, in which they begin at 60 and 160 m.
"""
CELL_M = 20.0
"""Edge of the cells that have levels of their own in live pictures [m]."""
FAR_LOW_FOCAL_PX = 450.0
"""Focal length for which these are meant; larger ones take them farther away [px]."""
_GROUND = (Tag.ROAD, Tag.SIDEWALK, Tag.GROUND, Tag.TERRAIN)
"""Semantic tags of what is seen at a grazing angle."""
_LEVEL_M = 0.5
"""Height of the cells of the ground [m]: what crosses above is not drawn down."""
_CELL_BITS = 20
"""Bits of a coordinate of a cell in its packed number."""
_LOOSE = (Material.METAL_PAINTED, Material.METAL_GALVANISED, Material.WOOD, Material.PLASTIC, Material.BARK)
"""Materials of railings, furniture and twigs, which leave no hole in a wall."""


def coarse(mesh: Mesh, how: Coarseness = FAR[0]) -> tuple[Mesh, Index]:
    """The same from afar: fewer and larger leaves, no crumbs; and which triangles it was made of."""
    area_m2 = 0.5 * np.sqrt(np.sum(face_vectors(mesh.vertices_m, mesh.triangles) ** 2, axis=1))
    material = mesh.material[mesh.triangles[:, 2]]
    leaf = material == Material.LEAF
    crumb = area_m2 < np.where(np.isin(material, _LOOSE), how.crumb_m2, how.any_m2)
    chosen = leaf & (np.cumsum(leaf) % how.leaf_stride == 0)
    leaves = part(mesh, chosen)
    corners = leaves.vertices_m[leaves.triangles]
    centre = corners.mean(axis=1, keepdims=True)
    flat = leaves.triangles.reshape(-1)
    apart = leaves.taking(flat, np.arange(len(flat), dtype=np.uint32).reshape(-1, 3))
    larger = centre + np.sqrt(how.leaf_stride) * (corners - centre)
    grown = replace(apart, vertices_m=larger.reshape(-1, 3).astype(np.float32))
    rest, of = part(mesh, ~leaf & ~crumb), np.flatnonzero(~leaf & ~crumb)
    if how.edge_m > 0.0:
        rest, kept = gathered(rest, how)
        of = of[kept]
    return merge([rest, grown]), np.concatenate([of, np.flatnonzero(chosen)])


def gathered(mesh: Mesh, how: Coarseness, loose: Sequence[Material] = _LOOSE) -> tuple[Mesh, Index]:
    """The same with all corners in one cell of a grid moved to one of them (Rossignac and Borrel 1993).

    What is thinner than a cell vanishes. Corners where materials meet are moved to before others, so
    that borders stay where they are. Loose parts and paint, which would vanish entirely, stay as they are.

    Returns:
        The mesh, and which triangles it was made of.
    """
    corner = mesh.triangles[:, 2]
    still = np.isin(mesh.material[corner], loose) | (mesh.tag[corner] == Tag.ROAD_LINE)
    moving = part(mesh, ~still)
    if not len(moving.triangles):
        return mesh, np.arange(len(mesh.triangles))
    place = moving.vertices_m.astype(np.float64)
    ground = np.isin(moving.tag, _GROUND)
    size = np.where(ground, how.ground_m, how.edge_m)[:, None] * np.ones(3)
    size[ground, 2] = _LEVEL_M
    cell = np.floor(place / size)
    seam = _where_materials_meet(moving)
    off = np.sum((place / size - cell - 0.5) ** 2, axis=1)
    key = 2 * _packed(cell) + ground
    order = np.lexsort((off, ~seam, key))
    new = np.concatenate([[True], np.diff(key[order]) != 0])
    number = np.empty(len(key), np.int64)
    number[order] = np.cumsum(new) - 1
    moved = place[order[new]][number]
    corners = number[moving.triangles]
    a, b, c = corners.T
    left = (a != b) & (b != c) & (c != a)
    # A triangle that was turned over would show its back.
    left &= (
        np.sum(face_vectors(place, moving.triangles) * face_vectors(moved, moving.triangles), axis=1) > 0.0
    )
    gathered_m = replace(moving, vertices_m=moved.astype(np.float32))
    of = np.concatenate([np.flatnonzero(~still)[left], np.flatnonzero(still)])
    return merge([part(gathered_m, left), part(mesh, still)]), of


def _packed(cell: NDArray[np.float64]) -> NDArray[np.int64]:
    """One number for each cell (N, 3)."""
    whole = cell.astype(np.int64) + (1 << (_CELL_BITS - 1))
    return (whole[:, 0] << (2 * _CELL_BITS)) | (whole[:, 1] << _CELL_BITS) | whole[:, 2]


def _where_materials_meet(mesh: Mesh) -> NDArray[np.bool_]:
    """Whether vertices of several materials lie at a vertex's place, within 2 cm, shape (V,)."""
    _, at = np.unique(_packed(np.floor(mesh.vertices_m.astype(np.float64) / 0.02)), return_inverse=True)
    at = at.reshape(-1)
    pairs = np.unique(at * 256 + mesh.material)
    return np.bincount(pairs // 256, minlength=at.max() + 1)[at] > 1


def part(mesh: Mesh, keep: NDArray[np.bool_]) -> Mesh:
    """Some of a mesh's triangles (T,), with the vertices that these use."""
    if keep.all():
        return mesh
    triangles = np.take(mesh.triangles, np.flatnonzero(keep), axis=0)
    used = np.zeros(len(mesh.vertices_m), dtype=bool)
    used[triangles] = True
    rows = np.flatnonzero(used)
    renumber = np.empty(len(used), np.uint32)
    renumber[rows] = np.arange(len(rows), dtype=np.uint32)
    return mesh.taking(rows, np.take(renumber, triangles))


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
    """Which simpler model stands for which, by how large it looks."""

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


CLUSTER_TRIANGLES = 160
"""Most triangles of a cluster."""
SIZES_M = (1.0, 8.0)
"""Edges of boxes round a triangle that part small, middling and large ones [m]: walls hide more alone."""
_BITS = 10
"""Bits of a coordinate along the space-filling curve."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clusters:
    """Triangles of a mesh in the order of their clusters, and these clusters, group by group."""

    order: Index
    """Triangles of the mesh, shape (T,)."""
    count: NDArray[np.int64]
    """Triangles of each cluster, shape (N,)."""
    group: Index
    """Group of each cluster, rising, shape (N,)."""
    low_m: Array
    """Lowest corners [m], shape (N, 3)."""
    high_m: Array
    """Highest corners [m], shape (N, 3)."""
    large: NDArray[np.bool_]
    """Whether a cluster has triangles of the largest size, which hide what is behind, shape (N,)."""


def cut(mesh: Mesh, group: Index) -> Clusters:
    """Cut a mesh: triangles of one group and size in the order of a space-filling curve, in equal portions.

    Args:
        mesh: All triangles.
        group: Triangles of different groups share no cluster, shape (T,).
    """
    low, high = _triangle_boxes(mesh)
    size = np.searchsorted(SIZES_M, _longest(high - low))
    kind = group * (len(SIZES_M) + 1) + size
    place = _along_curve(_within_group((low + high) / 2, group))
    order = np.argsort((kind << (3 * _BITS)) | place, kind="stable")
    del place
    kind = kind[order]
    rank = np.arange(len(order)) - np.searchsorted(kind, kind)
    begin = np.flatnonzero(rank % CLUSTER_TRIANGLES == 0)
    low, high = low[order], high[order]
    return Clusters(
        order=order,
        count=np.diff(np.append(begin, len(order))),
        group=kind[begin] // (len(SIZES_M) + 1),
        low_m=(np.minimum.reduceat(low, begin, axis=0) if len(begin) else low).astype(np.float64),
        high_m=(np.maximum.reduceat(high, begin, axis=0) if len(begin) else high).astype(np.float64),
        large=kind[begin] % (len(SIZES_M) + 1) == len(SIZES_M),
    )


def _triangle_boxes(mesh: Mesh) -> tuple[F32, F32]:
    """Lowest and highest corners of boxes round triangles [m], shape (T, 3) each."""
    low = np.take(mesh.vertices_m, mesh.triangles[:, 0], axis=0)
    high = low.copy()
    for k in (1, 2):
        corner = np.take(mesh.vertices_m, mesh.triangles[:, k], axis=0)
        np.minimum(low, corner, out=low)
        np.maximum(high, corner, out=high)
    return low, high


def _longest(across: F32) -> F32:
    """Longest edges of boxes (N, 3), shape (N,)."""
    # Axis by axis: numpy takes ten times as long over rows of three.
    return np.asarray(np.maximum(np.maximum(across[:, 0], across[:, 1]), across[:, 2]))


def _within_group(point_m: NDArray[np.floating], group: Index) -> NDArray[np.floating]:
    """Points (T, 3) within the cube round all of their group, 0–1."""
    if not len(group):
        return point_m
    # Two bytes are sorted by counting.
    short = group.astype(np.uint16) if group.max() < 1 << 16 else group
    order = np.argsort(short, kind="stable")
    begin = np.flatnonzero(np.diff(group[order], prepend=-1))
    of = np.empty(len(group), np.intp)
    of[order] = np.repeat(np.arange(len(begin)), np.diff(np.append(begin, len(group))))
    sorted_m = np.take(point_m, order, axis=0)
    low, high = (bound.reduceat(sorted_m, begin, axis=0) for bound in (np.minimum, np.maximum))
    edge = np.maximum((high - low).max(axis=1), np.float32(1e-3))
    return np.asarray((point_m - np.take(low, of, axis=0)) / np.take(edge, of)[:, None])


def _along_curve(place: NDArray[np.floating]) -> NDArray[np.int64]:
    """Places of points (N, 3) in the unit cube along a Morton curve, shape (N,)."""
    cell = np.clip(place * (1 << _BITS), 0, (1 << _BITS) - 1).astype(np.int64)
    # Each step puts two zeros between halves of the bits that are still together.
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cell = (cell | (cell << shift)) & mask
    return np.asarray(cell[:, 0] | (cell[:, 1] << 1) | (cell[:, 2] << 2))


def in_order(mesh: Mesh, order: Index) -> Mesh:
    """Some triangles in a given order, and their vertices in the order in which they name them."""
    triangles = np.take(mesh.triangles, order, axis=0)
    named = triangles.reshape(-1)
    first = np.full(len(mesh.vertices_m), len(named), np.int64)
    first[named[::-1]] = np.arange(len(named))[::-1]
    used = np.flatnonzero(first < len(named))
    rows = used[np.argsort(first[used], kind="stable")]
    place = np.empty(len(mesh.vertices_m), np.uint32)
    place[rows] = np.arange(len(rows), dtype=np.uint32)
    return mesh.taking(rows, np.take(place, triangles))
