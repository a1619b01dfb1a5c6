"""Solid shapes as meshes: boxes, tubes, lathed and lofted bodies; all outward-facing.

Faces of meshes: smooth normals, the volume inside, and points thrown onto them.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import apply, cross
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import WHITE, Colour, Mesh, face_vectors, make_mesh
from carlaloc_env.scene.semantic_tags import Tag


def crease(mesh: Mesh, crease_deg: float) -> Mesh:
    """The mesh with normals averaged over neighbouring faces that meet below an angle [deg].

    Degenerate triangles are dropped; corners are split where the normal differs.
    """
    tri = mesh.triangles.astype(np.int64)
    face = face_vectors(mesh.vertices_m.astype(np.float64), tri)
    area = np.sqrt(np.sum(face * face, axis=-1))
    keep = area > 1e-9
    tri, face, area = tri[keep], face[keep], area[keep]
    corner = tri.ravel()
    if not len(corner):
        return mesh
    place = np.round(mesh.vertices_m[corner].astype(np.float64) * 1e4).astype(np.int64)
    _, weld = np.unique(_packed(place, 21), return_inverse=True)
    normals = _corner_normals(weld, np.repeat(face, 3, axis=0), np.repeat(area, 3), crease_deg)
    key = (corner << 33) + _packed(np.round(normals * 500).astype(np.int64), 11)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    taken = corner[first]
    welded = mesh.taking(taken, index.reshape(-1, 3).astype(np.uint32))
    return replace(welded, normals=normals[first].astype(np.float32))


def _packed(rows: NDArray[np.int64], bits: int) -> NDArray[np.int64]:
    """Three whole numbers of a few bits in one, so that sorting is fast, shape (N,)."""
    shifted = (rows + (1 << (bits - 1))) & ((1 << bits) - 1)
    packed: NDArray[np.int64] = (shifted[:, 0] << (2 * bits)) | (shifted[:, 1] << bits) | shifted[:, 2]
    return packed


def _corner_normals(weld: NDArray[np.int64], face: Array, area: Array, crease_deg: float) -> Array:
    order = np.argsort(weld, kind="stable")
    count = np.bincount(weld)
    start = np.cumsum(count) - count
    corner = np.repeat(np.arange(len(weld)), count[weld])
    within = np.arange(len(corner)) - np.repeat(np.cumsum(count[weld]) - count[weld], count[weld])
    neighbour = order[start[weld[corner]] + within]
    unit = face / area[:, None]
    near = np.sum(unit[corner] * unit[neighbour], axis=-1) > elementary.cos(np.radians(crease_deg))
    corner, neighbour = corner[near], neighbour[near]
    sums = [np.bincount(corner, face[neighbour, axis], minlength=len(weld)) for axis in range(3)]
    total = np.stack(sums, axis=-1)
    return np.asarray(total / np.sqrt(np.sum(total * total, axis=-1, keepdims=True)))


@dataclass(frozen=True, slots=True)
class Look:
    """Material, semantic tag and tint of a part."""

    material: Material
    tag: Tag
    colour: Colour = WHITE
    """Linear tint 0–255."""

    def mesh(
        self,
        vertices_m: ArrayLike,
        triangles: ArrayLike,
        uv_m: ArrayLike | None = None,
        normals: ArrayLike | None = None,
    ) -> Mesh:
        """Mesh of this look; arguments as of `make_mesh`."""
        return make_mesh(
            vertices_m,
            triangles,
            material=self.material,
            tag=self.tag,
            uv_m=uv_m,
            normals=normals,
            colour=self.colour,
        )


def surface(
    look: Look,
    vertices_m: ArrayLike,
    triangles: ArrayLike,
    uv_m: ArrayLike | None = None,
    crease_deg: float = 35.0,
) -> Mesh:
    """Mesh of one look with normals that are smooth up to an edge angle [deg]."""
    vertices = np.asarray(vertices_m, dtype=np.float32)
    return crease(look.mesh(vertices, triangles, uv_m, np.zeros_like(vertices)), crease_deg)


def _box_tables() -> tuple[Array, NDArray[np.int64], NDArray[np.uint32], NDArray[np.float32]]:
    """Of the 24 corners of a box: signs, axes of the picture on their face, triangles, normals."""
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=np.float64)
    signs, uv, normals = np.zeros((6, 4, 3)), np.zeros((6, 4, 2), np.int64), np.zeros((6, 4, 3), np.float32)
    for face, (axis, side) in enumerate(itertools.product(range(3), (1.0, -1.0))):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        signs[face, :, axis], normals[face, :, axis] = side, side
        signs[face, :, a], signs[face, :, b] = square[:, 0] * side, square[:, 1]
        uv[face] = (a, b) if b == 2 else (b, a)
    triangles = np.arange(6, dtype=np.uint32)[:, None, None] * 4 + np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
    tables = signs.reshape(-1, 3), uv.reshape(-1, 2), triangles.reshape(-1, 3), normals.reshape(-1, 3)
    for table in tables:
        table.setflags(write=False)
    return tables


_BOX_SIGNS, _BOX_UV, _BOX_TRIANGLES, _BOX_NORMALS = _box_tables()


def box(look: Look, size_m: ArrayLike, centre_m: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """Axis-aligned box of 12 triangles with sharp edges."""
    half = 0.5 * np.asarray(size_m, dtype=np.float64)
    welded = _BOX_SIGNS * half
    # Pictures lie along each face: seen from a side upright, on top and bottom along x and y.
    uv = np.take_along_axis(welded + half, _BOX_UV, axis=1)
    return look.mesh(welded + np.asarray(centre_m, dtype=np.float64), _BOX_TRIANGLES, uv, _BOX_NORMALS)


def quad(look: Look, corners_m: ArrayLike, uv_m: ArrayLike | None = None) -> Mesh:
    """Flat quadrilateral, corners anticlockwise seen from the front, shape (4, 3)."""
    c = np.asarray(corners_m, dtype=np.float64)
    if uv_m is None:
        width, height = np.sqrt(np.sum((c[1] - c[0]) ** 2)), np.sqrt(np.sum((c[3] - c[0]) ** 2))
        uv_m = np.array([(0, 0), (width, 0), (width, height), (0, height)])
    return surface(look, c, [(0, 1, 2), (0, 2, 3)], uv_m, 10.0)


def panel(
    look: Look, corners_m: ArrayLike, uv_front: ArrayLike, thickness_m: float, back: Look
) -> list[Mesh]:
    """Flat board with a picture on its front and a plain back and rim.

    Args:
        look: Look of the front.
        corners_m: Front corners, anticlockwise seen from the front, shape (4, 3).
        uv_front: Texture coordinates of the front [m], shape (4, 2).
        thickness_m: Thickness [m].
        back: Look of back and rim.
    """
    c = np.asarray(corners_m, dtype=np.float64)
    normal = cross(c[1] - c[0], c[3] - c[0])
    normal = normal / np.sqrt(np.sum(normal * normal))
    rear = c - thickness_m * normal
    rim = [quad(back, [rear[i], rear[(i + 1) % 4], c[(i + 1) % 4], c[i]]) for i in range(4)]
    return [quad(look, c, uv_front), quad(back, rear[[1, 0, 3, 2]]), *rim]


def tube(
    look: Look,
    points_m: ArrayLike,
    radii_m: ArrayLike,
    sides: int,
    caps: bool = True,
    crease_deg: float = 50.0,
) -> Mesh:
    """Round bar along a polyline, shape (K, 3), with a radius [m] at each point."""
    p = np.asarray(points_m, dtype=np.float64)
    r = np.broadcast_to(np.asarray(radii_m, dtype=np.float64), (len(p),))
    across, other = _ring_axes(p)
    x, y = circle(sides).T
    offset = x[None, :, None] * across[:, None] + y[None, :, None] * other[:, None]
    return rings(look, p[:, None] + r[:, None, None] * offset, caps=caps, crease_deg=crease_deg)


def rings(look: Look, grid_m: ArrayLike, *, caps: bool = True, crease_deg: float = 50.0) -> Mesh:
    """Skin over closed rings of points, shape (K, N, 3).

    The rings run anticlockwise seen against the direction from the first ring to the last.
    """
    grid = np.asarray(grid_m, dtype=np.float64)
    count, sides = grid.shape[:2]
    wrapped = np.concatenate([grid, grid[:, :1]], axis=1)
    along = np.sqrt(np.sum(np.diff(wrapped, axis=1) ** 2, axis=-1)).mean(axis=0)
    up = np.sqrt(np.sum(np.diff(grid.mean(axis=1), axis=0) ** 2, axis=-1))
    u = np.broadcast_to(np.concatenate([[0.0], np.cumsum(along)]), (count, sides + 1))
    v = np.broadcast_to(np.concatenate([[0.0], np.cumsum(up)])[:, None], (count, sides + 1))
    vertices, uvs = [wrapped.reshape(-1, 3)], [np.stack([u, v], axis=-1).reshape(-1, 2)]
    triangles = [grid_triangles(count, sides + 1)]
    if caps:
        base = count * (sides + 1)
        for end, order in ((0, -1), (count - 1, 1)):
            ring = grid[end][::order]
            centre = ring.mean(axis=0)
            vertices.append(np.concatenate([ring, centre[None]]))
            uvs.append(np.concatenate([ring, centre[None]])[:, :2])
            triangles.append(base + fan(sides))
            base += sides + 1
    return surface(
        look, np.concatenate(vertices), np.concatenate(triangles), np.concatenate(uvs), crease_deg=crease_deg
    )


def lathe(look: Look, profile_m: ArrayLike, sides: int, centre_m: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """Body of revolution about the upright axis; profile of (radius, height) from the bottom up."""
    profile = np.asarray(profile_m, dtype=np.float64)
    grid = np.zeros((len(profile), sides, 3))
    grid[..., :2] = profile[:, :1, None] * circle(sides)
    grid[..., 2] = profile[:, 1:]
    return rings(look, grid + np.asarray(centre_m, dtype=np.float64), crease_deg=40.0)


def ellipsoid(look: Look, centre_m: ArrayLike, radii_m: ArrayLike, ring_count: int, sides: int) -> Mesh:
    """Ellipsoid with axes along x, y, z."""
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ring_count + 1)
    x, y = circle(sides).T
    level = elementary.cos(latitude)[:, None]
    height = np.broadcast_to(elementary.sin(latitude)[:, None], (ring_count + 1, sides))
    grid = np.stack([level * x, level * y, height], axis=-1)
    shaped = grid * np.asarray(radii_m, dtype=np.float64) + np.asarray(centre_m, dtype=np.float64)
    return rings(look, shaped, caps=False, crease_deg=80.0)


def extrude(look: Look, outline_m: ArrayLike, height_m: float) -> Mesh:
    """Upright prism on a convex outline in the ground plane, anticlockwise, shape (N, 2)."""
    outline = np.asarray(outline_m, dtype=np.float64)
    low = np.concatenate([outline, np.zeros((len(outline), 1))], axis=-1)
    high = low + np.array([0.0, 0.0, height_m])
    return rings(look, np.stack([low, high]), crease_deg=20.0)


def disc(look: Look, radius_m: float, sides: int, x_m: float) -> Mesh:
    """Round plate at x = `x_m` that faces along +x."""
    ring = np.insert(radius_m * circle(sides), 0, x_m, axis=1)
    vertices = np.concatenate([ring, [[x_m, 0.0, 0.0]]])
    return surface(look, vertices, fan(sides), vertices[:, 1:] + radius_m)


def circle(sides: int, first: float = 0.0) -> Array:
    """Corners on the unit circle, anticlockwise from `first` steps after the x axis, shape (N, 2)."""
    angle = 2 * np.pi * (np.arange(sides) + first) / sides
    return np.stack([elementary.cos(angle), elementary.sin(angle)], axis=-1)


def fan(sides: int) -> NDArray[np.int64]:
    """Triangles between the corners of a polygon and a point that follows them, shape (N, 3)."""
    k = np.arange(sides)
    return np.stack([k, (k + 1) % sides, np.full(sides, sides)], axis=-1)


def grid_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Two triangles per cell of a grid of points stored row by row, shape (T, 3)."""
    r, c = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a = (r * columns + c).ravel()
    return np.concatenate(
        [np.stack([a, a + 1, a + columns + 1], -1), np.stack([a, a + columns + 1, a + columns], -1)]
    )


def placed(
    mesh: Mesh, position_m: ArrayLike = (0.0, 0.0, 0.0), yaw_rad: float = 0.0, pitch_rad: float = 0.0
) -> Mesh:
    """The mesh pitched (nose up positive), turned, then shifted [m]."""
    T = pose(position_m, yaw_rad, pitch_rad)
    turn = T.copy()
    turn[:3, 3] = 0.0
    return replace_geometry(mesh, apply(T, mesh.vertices_m), apply(turn, mesh.normals))


def pose(position_m: ArrayLike = (0.0, 0.0, 0.0), yaw_rad: float = 0.0, pitch_rad: float = 0.0) -> Array:
    """Transform (4, 4): pitched (nose up positive), turned, then shifted [m]."""
    c, s, cp, sp = (f(angle) for angle in (yaw_rad, pitch_rad) for f in (elementary.cos, elementary.sin))
    T = np.eye(4)
    T[:3, :3] = [(c * cp, -s, -c * sp), (s * cp, c, -s * sp), (sp, 0.0, cp)]
    T[:3, 3] = position_m
    return T


def mirrored(mesh: Mesh) -> Mesh:
    """The mesh mirrored from left to right (y → −y), still outward-facing."""
    flip = np.array([1.0, -1.0, 1.0])
    out = replace_geometry(mesh, mesh.vertices_m * flip, mesh.normals * flip)
    return replace(out, triangles=out.triangles[:, ::-1].copy())


def replace_geometry(mesh: Mesh, vertices_m: ArrayLike, normals: ArrayLike) -> Mesh:
    """The mesh with other corner positions and normals."""
    place, normal = (np.asarray(values, dtype=np.float32) for values in (vertices_m, normals))
    return replace(mesh, vertices_m=place, normals=normal)


def _ring_axes(p: Array) -> tuple[Array, Array]:
    """Two unit axes across a polyline at each point; (across, other, tangent) is right-handed."""
    step = np.diff(p, axis=0)
    step = step / np.maximum(np.sqrt(np.sum(step * step, axis=-1, keepdims=True)), 1e-9)
    tangent = np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]])
    tangent = tangent / np.maximum(np.sqrt(np.sum(tangent**2, axis=-1, keepdims=True)), 1e-9)
    mean = np.abs(tangent).mean(axis=0)
    helper = np.zeros(3)
    helper[int(np.argmin(mean))] = 1.0
    across = helper - np.sum(tangent * helper, axis=-1, keepdims=True) * tangent
    across = across / np.sqrt(np.sum(across * across, axis=-1, keepdims=True))
    return across, cross(tangent, across)
