"""One rigid set of triangles: an Embree tree, and what each triangle is made of."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.errors import RaycastError
from carlaloc_env.core.jit import compiled
from carlaloc_env.raycast.hits import Hits
from carlaloc_env.scene.mesh import Mesh


class Surface:
    """Triangles in one frame: an Embree tree, and material, tag and instance of every triangle."""

    def __init__(self, o3d: ModuleType, mesh: Mesh) -> None:
        self._tensor = o3d.core.Tensor.from_numpy
        self._scene: Any = o3d.t.geometry.RaycastingScene() if len(mesh.triangles) else None
        corner = mesh.triangles[:, 0]
        self._material, self._tag = mesh.material[corner], mesh.tag[corner]
        self._instance = mesh.instance[corner]
        if self._scene is not None:
            triangles = np.ascontiguousarray(mesh.triangles, dtype=np.uint32)
            vertices = np.ascontiguousarray(mesh.vertices_m, dtype=np.float32)
            self._scene.add_triangles(self._tensor(vertices), self._tensor(triangles))

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
            answer["t_hit"].numpy(),
            answer["primitive_ids"].numpy(),
            answer["primitive_normals"].numpy(),
            rays,
            np.float32(range_max_m),
            (self._tag, self._instance, self._material),
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
    distance_m: F32,
    triangle: NDArray[np.uint32],
    normal: F32,
    rays: F32,
    range_max_m: np.float32,
    labels: tuple[NDArray[np.uint8], NDArray[np.uint32], NDArray[np.uint8]],
    out: tuple[F32, NDArray[np.uint8], NDArray[np.uint32], NDArray[np.uint8], F32],
) -> None:
    """Embree's answer to N rays as the arrays of `Hits`."""
    tag, instance, material = labels
    out_range, out_tag, out_instance, out_material, out_cosine = out
    for i in range(len(distance_m)):
        if not distance_m[i] <= range_max_m:
            out_range[i] = np.inf
            out_tag[i] = out_instance[i] = out_material[i] = 0
            out_cosine[i] = 0.0
            continue
        t = triangle[i]
        cosine = abs(normal[i, 0] * rays[i, 3] + normal[i, 1] * rays[i, 4] + normal[i, 2] * rays[i, 5])
        out_range[i] = distance_m[i]
        out_tag[i], out_instance[i], out_material[i] = tag[t], instance[t], material[t]
        out_cosine[i] = min(cosine, np.float32(1.0))


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
