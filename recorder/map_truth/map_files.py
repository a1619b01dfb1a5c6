"""Files of maps: meshes and labelled clouds that are written, clouds of any origin that are read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError, OutputError
from carlaloc_env.core.files.output_paths import atomic_write
from carlaloc_env.raycast.surface import import_open3d
from carlaloc_env.scene.materials import colourise
from carlaloc_env.scene.mesh import Mesh
from recorder.map_truth.surface_cloud import SurfaceCloud

MESH_SUFFIXES = (".ply", ".gltf")
"""Kinds of files that meshes are written to; hardly any reader takes the .glb of Open3D."""
CLOUD_SUFFIXES = (".ply", ".pcd", ".xyz")
"""Kinds of files that clouds are read from."""


def write_mesh(mesh: Mesh, path: Path) -> Path:
    """Write triangles whose corners have normals and the colour of their class in CARLA's palette.

    A PLY has the world's axes (east, north, up). In glTF up is +y: x is east and z is south.

    Args:
        mesh: The triangles, world.
        path: File of one of `MESH_SUFFIXES`.

    Raises:
        OutputError: it cannot be written.
    """
    o3d = import_open3d()
    vector = o3d.utility.Vector3dVector
    corners, normals = (values.astype(np.float64) for values in (mesh.vertices_m, mesh.normals))
    if path.suffix.lower() != ".ply":
        corners, normals = (values[:, [0, 2, 1]] * [1.0, 1.0, -1.0] for values in (corners, normals))
    found = o3d.geometry.TriangleMesh(
        vector(corners), o3d.utility.Vector3iVector(mesh.triangles.astype(np.int32))
    )
    found.vertex_normals = vector(normals)
    found.vertex_colors = vector(colourise(mesh.tag) / 255.0)
    with _named_part(path) as part:
        _check_written(o3d.io.write_triangle_mesh(str(part), found), path)
    return path


def write_cloud(cloud: SurfaceCloud, path: Path) -> Path:
    """Write a binary PLY: x, y, z, nx, ny, nz in single precision, and the class as ``label``.

    Raises:
        OutputError: it cannot be written.
    """
    o3d = import_open3d()
    found = o3d.t.geometry.PointCloud(np.ascontiguousarray(cloud.points_xyz_m))
    found.point.normals = np.ascontiguousarray(cloud.normals)
    found.point.label = np.ascontiguousarray(cloud.tag[:, None])
    with _named_part(path) as part:
        _check_written(o3d.t.io.write_point_cloud(str(part), found), path)
    return path


def read_map(path: Path) -> Array:
    """Points of a map [m] in its own frame, shape (N, 3); points that are not finite are left out.

    Args:
        path: A cloud, PLY, PCD or XYZ; of a mesh the corners are read.

    Raises:
        EvaluationError: there is no such file, or no point in it.
    """
    if path.suffix.lower() not in CLOUD_SUFFIXES:
        raise EvaluationError(f"{path} is no map that is read here; give {', '.join(CLOUD_SUFFIXES)}")
    if not path.is_file():
        raise EvaluationError(f"{path}: no such file; give the cloud of a map")
    o3d = import_open3d()
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        cloud = o3d.t.io.read_point_cloud(str(path))
    points: Array = (
        cloud.point.positions.numpy().astype(np.float64) if "positions" in cloud.point else np.zeros((0, 3))
    )
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise EvaluationError(f"{path} has no points; give the cloud of a map")
    return points


@contextmanager
def _named_part(path: Path) -> Iterator[Path]:
    """A temporary file that ends as its kind does, since Open3D looks at the end of names alone."""
    with atomic_write(path) as part:
        named = part.with_name(part.name + path.suffix.lower())
        try:
            yield named
            named.replace(part)
        finally:
            named.unlink(missing_ok=True)


def _check_written(done: Any, path: Path) -> None:
    if not done:
        raise OutputError(f"cannot write {path}; choose another place")
