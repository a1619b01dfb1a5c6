"""Rays against one rigid surface, and what they meet first.

One rigid set of triangles: an Embree tree, and what each triangle is made of.

Embree finds which triangle a ray meets. How far away that is and at which angle is computed here from its
corners: Embree's arithmetic, in single precision, differs with the processor.

First hits of rays, as parallel arrays.

Which rays may meet which upright cylinder, without asking every pair.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.errors import RaycastError
from carlaloc_env.core.files.array_cache import in_shared_memory, read_only
from carlaloc_env.core.jit import compiled
from carlaloc_env.scene.mesh import Mesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hits:
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
        )

    def put(self, rows: NDArray[np.intp] | slice, other: Hits) -> None:
        """Overwrite some rows, shape (M,), by the hits of M other rays."""
        for name in self.__slots__:
            getattr(self, name)[rows] = getattr(other, name)

    def take(self, rows: NDArray[Any]) -> Hits:
        """Hits of some of the rays, by index or mask."""
        return Hits(**{name: getattr(self, name)[rows] for name in self.__slots__})


KEPT_FILES = 14
"""Cached files kept: a town has two, with and without parked cars."""


class Surface:
    """Triangles in one frame: an Embree tree, and material, tag and instance of every triangle."""

    def __init__(self, o3d: ModuleType, mesh: Mesh, *, shared: bool = False) -> None:
        """Build the tree.

        Args:
            o3d: Open3D.
            mesh: The triangles.
            shared: Whether what is read of them lies in a file of the cache, which processes share.
        """
        self._tensor = o3d.core.Tensor.from_numpy
        self._scene: Any = o3d.t.geometry.RaycastingScene() if len(mesh.triangles) else None
        corner = mesh.triangles[:, 0]
        triangles = np.ascontiguousarray(mesh.triangles, dtype=np.uint32)
        vertices_m = np.ascontiguousarray(mesh.vertices_m, dtype=np.float32)
        if self._scene is not None:
            # Embree has copies of its own.
            self._scene.add_triangles(self._tensor(vertices_m), self._tensor(triangles))
        found = read_only(
            {
                "triangles": triangles,
                "vertices_m": vertices_m,
                "tag": mesh.tag[corner],
                "instance": mesh.instance[corner],
                "material": mesh.material[corner],
            }
        )
        if shared:
            found = in_shared_memory(found, "ray-triangles", "rays", module=__name__, kept_files=KEPT_FILES)
        self._corners = found["triangles"], found["vertices_m"]
        self._labels = found["tag"], found["instance"], found["material"]

    def trace(self, rays: F32, range_max_m: float) -> Hits:
        """First hits of rays given as origins [m] and directions in the triangles' frame, shape (N, 6)."""
        if self._scene is None or len(rays) == 0:
            return Hits.none(len(rays))
        answer = self._scene.cast_rays(self._tensor(rays))
        count = len(rays)
        hits = Hits(
            range_m=np.empty(count, np.float32),
            tag=np.empty(count, np.uint8),
            instance=np.empty(count, np.uint32),
            material=np.empty(count, np.uint8),
            cos_incidence=np.empty(count, np.float32),
        )
        _read(
            answer["primitive_ids"].numpy(),
            self._corners,
            rays,
            np.float32(range_max_m),
            self._labels,
            (hits.range_m, hits.tag, hits.instance, hits.material, hits.cos_incidence),
        )
        return hits

    def normals(self, rays: F32) -> F32:
        """Unit normals of the triangles that rays meet first, zeros where there is none, shape (N, 3)."""
        if self._scene is None or len(rays) == 0:
            return np.zeros((len(rays), 3), np.float32)
        found: F32 = self._scene.cast_rays(self._tensor(rays))["primitive_normals"].numpy()
        return found


@compiled
def _read(
    triangle: NDArray[np.uint32],
    mesh: tuple[NDArray[np.uint32], F32],
    rays: F32,
    range_max_m: np.float32,
    labels: tuple[NDArray[np.uint8], NDArray[np.uint32], NDArray[np.uint8]],
    out: tuple[F32, NDArray[np.uint8], NDArray[np.uint32], NDArray[np.uint8], F32],
) -> None:
    """Hits of N rays by the triangle of each, as the arrays of `Hits`."""
    corners, vertices_m = mesh
    tag, instance, material = labels
    out_range, out_tag, out_instance, out_material, out_cosine = out
    for i in range(len(triangle)):
        t = triangle[i]
        distance_m, cosine = np.float32(np.inf), 0.0
        if t < len(corners):
            a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
            x, y, z = float(vertices_m[a, 0]), float(vertices_m[a, 1]), float(vertices_m[a, 2])
            bx, by, bz = vertices_m[b, 0] - x, vertices_m[b, 1] - y, vertices_m[b, 2] - z
            cx, cy, cz = vertices_m[c, 0] - x, vertices_m[c, 1] - y, vertices_m[c, 2] - z
            nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
            facing = nx * rays[i, 3] + ny * rays[i, 4] + nz * rays[i, 5]
            height = nx * (x - rays[i, 0]) + ny * (y - rays[i, 1]) + nz * (z - rays[i, 2])
            if facing != 0.0:
                distance_m = np.float32(height / facing)
                cosine = abs(facing) / math.sqrt(nx * nx + ny * ny + nz * nz)
        if distance_m <= range_max_m:
            out_range[i], out_cosine[i] = distance_m, min(cosine, 1.0)
            out_tag[i], out_instance[i], out_material[i] = tag[t], instance[t], material[t]
        else:
            out_range[i], out_cosine[i] = np.inf, 0.0
            out_tag[i] = out_instance[i] = out_material[i] = 0


def import_open3d() -> ModuleType:
    """Open3D, or what is missing for it.

    Raises:
        RaycastError: open3d cannot be imported on this machine.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise RaycastError(
            f"LiDAR needs open3d, which does not load ({error}); run: pip install open3d, "
            "and on Debian or Ubuntu: apt-get install libgomp1 libusb-1.0-0 libidn2-0"
        ) from error
    module: ModuleType = open3d
    return module


_SECTORS = 1024
"""Sectors of the horizon; each knows the cylinders that can be seen in it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cylinders:
    """Upright cylinders, parallel arrays of A."""

    centre_m: Array
    """Middles [m], shape (A, 3)."""
    radius_m: Array
    """Radii [m], shape (A,)."""
    half_height_m: Array
    """Half heights [m], shape (A,)."""


def candidates(
    origins_m: ArrayLike, directions: ArrayLike, limit_m: F32, cylinders: Cylinders
) -> tuple[Index, Index]:
    """All (ray, cylinder) pairs that may meet.

    The horizon, seen from where the rays start, is parted into sectors. A cylinder is listed in those
    that it covers; a ray then tests the cylinders of its own sector. Rays may start anywhere in a
    small volume, by which the cylinders are grown.

    Args:
        origins_m: Starts [m], shape (N, 3).
        directions: Unit directions, shape (N, 3).
        limit_m: Length of each ray [m], shape (N,).
        cylinders: Upright cylinders, one per actor.

    Returns:
        Ray indices (M,) and actor indices (M,), in the order of rays, then of actors.
    """
    starts, along = (np.asarray(part, dtype=np.float32) for part in (origins_m, directions))
    # Axis by axis: numpy takes ten times as long over rows of three.
    lowest, highest = (np.array([end(axis) for axis in starts.T], np.float64) for end in (np.min, np.max))
    eye, spread = 0.5 * (lowest + highest), 0.5 * (highest - lowest)
    away = cylinders.centre_m - eye
    radius_m = cylinders.radius_m + math.hypot(spread[0], spread[1]) + 0.01
    tall = cylinders.half_height_m + spread[2] + 0.01
    near = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) - radius_m < float(limit_m.max()))
    first, listed = _seen_in_sectors(away[near], radius_m[near])
    around = np.column_stack([away, radius_m, tall])[near].astype(np.float32)
    room = len(along)
    while True:
        rays, actors = np.empty(room, np.intp), np.empty(room, np.intp)
        count = _pairs(along, limit_m, first, listed, around, rays, actors)
        if count <= room:
            return rays[:count], near[actors[:count]]
        room = count


def _seen_in_sectors(away_m: Array, radius_m: Array) -> tuple[Index, Index]:
    """Where the list of each sector begins (sectors + 1,), and the cylinders of all lists, ascending."""
    flat = np.hypot(away_m[:, 0], away_m[:, 1])
    half = elementary.arcsin(np.minimum(radius_m / np.maximum(flat, 1e-9), 1.0))
    middle = elementary.arctan2(away_m[:, 1], away_m[:, 0])
    # A sector to either side covers the rounding of float32.
    low = np.floor(_on_square(middle - half) * (_SECTORS / 4)).astype(np.intp) - 1
    high = np.floor(_on_square(middle + half) * (_SECTORS / 4)).astype(np.intp) + 1
    count = np.where(flat > radius_m, np.minimum((high - low) % _SECTORS + 1, _SECTORS), _SECTORS)
    cylinder = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(cylinder)) - np.repeat(np.cumsum(count) - count, count)
    sector = (low[cylinder] + step) % _SECTORS
    first = np.concatenate([[0], np.cumsum(np.bincount(sector, minlength=_SECTORS))])
    return first.astype(np.intp), cylinder[np.argsort(sector, kind="stable")]


def _on_square(angle_rad: Array) -> Array:
    """Position on the outline of the square |x| + |y| = 1 of directions, 0–4 anticlockwise from east."""
    x, y = elementary.cos(angle_rad), elementary.sin(angle_rad)
    fraction = x / (np.abs(x) + np.abs(y))
    quadrant: Array = np.where(y >= 0, 1 - fraction, 3 + fraction)
    return quadrant


@compiled
def _pairs(
    directions: F32, limit_m: F32, first: Index, listed: Index, around: F32, rays: Index, actors: Index
) -> int:
    """Write the pairs that may meet, as many as there is room for, and count all.

    Args:
        directions: Unit directions, shape (N, 3).
        limit_m: Length of each ray [m], shape (N,).
        first: Where the list of each sector begins, shape (sectors + 1,).
        listed: Cylinders of all lists.
        around: Middle from the eye, radius, half height of each cylinder [m], shape (A, 5).
        rays: Receives the ray of each pair.
        actors: Receives the cylinder of each pair.
    """
    count = 0
    sectors = len(first) - 1
    for i in range(len(directions)):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        fraction = dx / max(abs(dx) + abs(dy), np.float32(1e-9))
        quadrant = np.float32(1) - fraction if dy >= 0 else np.float32(3) + fraction
        sector = min(int(quadrant * np.float32(sectors * 0.25)), sectors - 1)
        begin, end = first[sector], first[sector + 1]
        if begin == end:
            continue
        # All lengths below are in the plan and times `flat`, which spares divisions.
        flat = np.float32(max(math.sqrt(dx * dx + dy * dy), 1e-3))
        square, steep, far = flat * flat, abs(dz) * flat, limit_m[i] * flat * flat
        for k in range(begin, end):
            actor = listed[k]
            x, y, z = around[actor, 0], around[actor, 1], around[actor, 2]
            radius, tall = around[actor, 3], around[actor, 4]
            # Where the ray passes nearest to the axis, how far from it, and at which height.
            along, half_chord = x * dx + y * dy, radius * flat
            meets = abs(x * dy - y * dx) < half_chord and -half_chord < along < far + half_chord
            if meets and abs(dz * along - z * square) < tall * square + steep * radius:
                if count < len(rays):
                    rays[count], actors[count] = i, actor
                count += 1
    return count
