"""Rays against one rigid set of triangles: an Embree tree, with material, tag and instance of each triangle.

Embree finds the triangle that a ray meets. Distance and angle are computed here from its corners, since
Embree's arithmetic, in single precision, differs with the processor.
"""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.errors import RaycastError
from carlaloc_env.core.files.shared_arrays import in_shared_memory, read_only
from carlaloc_env.core.jit import compiled
from carlaloc_env.core.transforms import cross
from carlaloc_env.raycast.foliage import GAP_M, leaf_depths
from carlaloc_env.raycast.hits import Hits
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.mottle import BEAM_RAD, mottle_table, tone_at

_BLOCK = 512
"""Rays whose patterns are worked out together."""
_AHEAD_M = np.float32(0.005)
"""Rays that have met a leaf go on from so far behind it [m]."""
_LAYERS = 3
"""Leaves behind one another up to which a ray is followed."""
KEPT_FILES = 14
"""Cached files kept: a town has two, with and without parked cars."""


class Surface:
    """Triangles in one frame: an Embree tree, and material, tag and instance of every triangle."""

    def __init__(
        self, o3d: ModuleType, mesh: Mesh, *, origin_m: Array | None = None, shared: bool = False
    ) -> None:
        """Build the tree.

        Args:
            o3d: Open3D.
            mesh: The triangles.
            origin_m: Where the frame's origin lies in the pattern of reflectances [m], (3,); 0 if left out.
            shared: Whether what is read of them lies in a file of the cache, which processes share.
        """
        self._origin_m = np.zeros(3) if origin_m is None else np.array(origin_m, np.float64)
        self._mottle = mottle_table()
        self._tensor = o3d.core.Tensor.from_numpy
        self._scene: Any = o3d.t.geometry.RaycastingScene() if len(mesh.triangles) else None
        corner = mesh.triangles[:, 0]
        triangles = np.ascontiguousarray(mesh.triangles, dtype=np.uint32)
        vertices_m = np.ascontiguousarray(mesh.vertices_m, dtype=np.float32)
        if self._scene is not None:
            # Embree has copies of its own.
            self._scene.add_triangles(self._tensor(vertices_m), self._tensor(triangles))
        arrays = read_only(
            {
                "triangles": triangles,
                "vertices_m": vertices_m,
                "tag": mesh.tag[corner],
                "instance": mesh.instance[corner],
                "material": mesh.material[corner],
            }
        )
        if shared:
            arrays = in_shared_memory(arrays, "ray-triangles", "rays", module=__name__, kept_files=KEPT_FILES)
        self._corners = arrays["triangles"], arrays["vertices_m"]
        self._labels = arrays["tag"], arrays["instance"], arrays["material"]

    def trace(self, rays: F32, range_max_m: float) -> Hits:
        """First hits of rays given as origins [m] and directions in the triangles' frame, shape (N, 6).

        Leaves are met behind the outside of their crown, unless something solid is nearer.
        """
        hits = self._outsides(rays, range_max_m)
        rows = np.flatnonzero(hits.material == Material.LEAF)
        if len(rows):
            self._enter_foliage(rows, rays[rows], hits)
        return hits

    def _enter_foliage(self, rows: Index, rays: F32, hits: Hits) -> None:
        """Put what rays of some rows, shape (M, 6), meet in the foliage whose outside they have met.

        A ray ends between two surfaces of one crown, at the last one where it leaves it, or at what is solid.
        """
        entered_m = hits.range_m[rows]
        depth_m, entry_m = np.empty(len(rows)), rays[:, :3] + rays[:, 3:] * entered_m[:, None]
        leaf_depths(entry_m, self._origin_m, depth_m)
        end_m = (entered_m + depth_m).astype(np.float32)
        last_m, left = entered_m.copy(), np.arange(len(rows))
        for _ in range(_LAYERS):
            onward = rays[left].copy()
            onward[:, :3] += onward[:, 3:] * (last_m[left, None] + _AHEAD_M)
            onward_hits = self._outsides(onward, GAP_M)
            onward_hits.range_m[:] += last_m[left] + _AHEAD_M
            inside, nearer = np.isfinite(onward_hits.range_m), onward_hits.range_m < end_m[left]
            solid = nearer & (onward_hits.material != Material.LEAF)
            hits.put(rows[left[solid]], onward_hits.take(solid))
            within = left[inside & ~nearer]
            hits.range_m[rows[within]] = end_m[within]
            more = nearer & ~solid
            last_m[left[more]] = onward_hits.range_m[more]
            ends = left[more | ~inside]
            hits.range_m[rows[ends]] = last_m[ends]
            left = left[more]
            if not len(left):
                return

    def _outsides(self, rays: F32, range_max_m: float) -> Hits:
        return self._hits(self._first(rays), rays, range_max_m)

    def _first(self, rays: F32) -> NDArray[np.uint32]:
        """The triangle that each ray meets first, a number beyond all where there is none, shape (N,)."""
        if self._scene is None or len(rays) == 0:
            return np.full(len(rays), 0xFFFFFFFF, np.uint32)
        first: NDArray[np.uint32] = self._scene.cast_rays(self._tensor(rays))["primitive_ids"].numpy()
        return first

    def _hits(self, triangle: NDArray[np.uint32], rays: F32, range_max_m: float) -> Hits:
        hits = Hits.none(len(rays))
        _read(
            triangle,
            self._corners,
            rays,
            np.float32(range_max_m),
            self._labels,
            (self._origin_m, self._mottle, np.empty((9, _BLOCK))),
            (hits.range_m, hits.tag, hits.instance, hits.material, hits.cos_incidence, hits.tone),
        )
        return hits

    def facing(self, rays: F32, range_max_m: float) -> tuple[Hits, Array]:
        """First triangles that rays, shape (N, 6), meet, and their unit normals, zeros for none, (N, 3)."""
        triangle, normals = self._first(rays), np.zeros((len(rays), 3))
        corners, vertices_m = self._corners
        met = np.flatnonzero(triangle < len(corners))
        a, b, c = vertices_m[corners[triangle[met]]].astype(np.float64).swapaxes(0, 1)
        across = cross(b - a, c - a)
        normals[met] = across / np.sqrt(np.sum(across * across, axis=-1))[:, None]
        return self._hits(triangle, rays, range_max_m), normals


@compiled
def _read(
    triangle: NDArray[np.uint32],
    mesh: tuple[NDArray[np.uint32], F32],
    rays: F32,
    range_max_m: np.float32,
    labels: tuple[NDArray[np.uint8], NDArray[np.uint32], NDArray[np.uint8]],
    pattern: tuple[Array, F32, Array],
    out: tuple[F32, NDArray[np.uint8], NDArray[np.uint32], NDArray[np.uint8], F32, F32],
) -> None:
    """Put hits of N rays by the triangle of each into the arrays of `Hits.none`.

    Block by block: in a loop of its own, which processors run over several rays at once, the pattern takes a
    third of the time.
    """
    corners, vertices_m = mesh
    tag, instance, material = labels
    origin_m, mottle, at = pattern
    out_range, out_tag, out_instance, out_material, out_cosine, out_tone = out
    for first in range(0, len(triangle), _BLOCK):
        count = min(len(triangle) - first, _BLOCK)
        for k in range(count):
            i = first + k
            t = triangle[i]
            distance_m, cosine, nx, ny, nz = np.float32(np.inf), 0.0, 0.0, 0.0, 0.0
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
                    size = math.sqrt(nx * nx + ny * ny + nz * nz)
                    cosine, nx, ny, nz = abs(facing) / size, nx / size, ny / size, nz / size
            if distance_m <= range_max_m:
                away = float(distance_m)
                for axis in range(3):
                    at[axis, k] = origin_m[axis] + rays[i, axis] + away * rays[i, axis + 3]
                at[3, k], at[4, k], at[5, k], at[6, k] = nx, ny, nz, BEAM_RAD * away
                at[7, k], at[8, k] = mottle[material[t], 0], mottle[material[t], 1]
                out_range[i], out_cosine[i] = distance_m, min(cosine, 1.0)
                out_tag[i], out_instance[i], out_material[i] = tag[t], instance[t], material[t]
            else:
                at[:, k] = 0.0
        for k in range(count):
            normal = at[3, k], at[4, k], at[5, k]
            out_tone[first + k] = tone_at(at[0, k], at[1, k], at[2, k], normal, at[6, k], at[7, k], at[8, k])


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
