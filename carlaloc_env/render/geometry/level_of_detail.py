"""Levels of detail: triangles that a part of the scenery loses from some distance on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Index
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, face_vectors, merge
from carlaloc_env.scene.semantic_tags import Tag

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Coarseness:
    """Loss of detail of a chunk from some distance on."""

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


def coarse(mesh: Mesh, how: Coarseness = FAR[0]) -> tuple[Mesh, Index]:
    """A mesh from afar, with fewer and larger leaves and no crumbs; and the triangles it is made of."""
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
    """A mesh with all corners in one cell of a grid moved to one of them (Rossignac and Borrel 1993).

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
