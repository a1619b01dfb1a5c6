"""Points drawn evenly over the surfaces of a town, each with its normal and its class.

Files of maps: meshes and labelled clouds that are written, clouds of any origin that are read.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core.array_types import F32, U8, Array, Index, Mask
from carlaloc_env.core.clock import stream
from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.raycast.surface import import_open3d
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import colourise
from recorder.writers.formats.ply import ply_bytes

_BLOCK = 1 << 20
"""Points that are drawn at a time; each block has numbers of its own."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceCloud:
    """Labelled points of surfaces."""

    points_xyz_m: F32
    """Points [m], world, shape (N, 3)."""
    normals: F32
    """Unit normals of their triangles, outward, shape (N, 3)."""
    tag: U8
    """Semantic `Tag` of their triangles, shape (N,)."""

    def __len__(self) -> int:
        return len(self.tag)


class Region:
    """Region within a distance of some places, seen from above.

    Args:
        centres_m: Places [m], world, of which x and y count, shape (K, 2) or (K, 3).
        reach_m: Horizontal distance [m].
    """

    def __init__(self, centres_m: Array, reach_m: float) -> None:
        if not len(centres_m) or not reach_m > 0:
            raise ConfigError("a region needs places and a reach above 0 m")
        self._tree, self.reach_m = cKDTree(centres_m[:, :2]), reach_m

    def contains(self, points_m: Array | F32) -> Mask:
        """Mask of the points in the region, shape (N,)."""
        return np.isfinite(self._tree.query(points_m[:, :2], distance_upper_bound=self.reach_m)[0])

    def pieces(self, corners_m: Array, row: Index) -> tuple[Array, Index]:
        """Triangles that reach into it, large ones cut into four and again, so that little lies outside.

        Args:
            corners_m: Corners [m], world, shape (T, 3, 3).
            row: A number of each that its pieces inherit, shape (T,).
        """
        done, limit_m = [], 0.25 * self.reach_m
        while len(row):
            centre = corners_m.mean(axis=1)
            around = np.sqrt(np.sum((corners_m - centre[:, None])[:, :, :2] ** 2, axis=2)).max(axis=1)
            near = self._tree.query(centre[:, :2])[0] <= self.reach_m + around
            small = near & (around <= limit_m)
            done.append((corners_m[small], row[small]))
            left, row = corners_m[near & ~small], np.repeat(row[near & ~small], 4)
            middle = 0.5 * (left + np.roll(left, -1, axis=1))  # of a and b, b and c, c and a
            (a, b, c), (ab, bc, ca) = (values.swapaxes(0, 1) for values in (left, middle))
            fours = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
            corners_m = np.stack([np.stack(three, axis=1) for three in fours], axis=1).reshape(-1, 3, 3)
        return np.concatenate([part[0] for part in done]), np.concatenate([part[1] for part in done])


def sample_surface(
    mesh: Mesh, *, points_per_m2: float, seed: int = 0, region: Region | None = None
) -> SurfaceCloud:
    """Points evenly over the area of triangles.

    The area is cut into N equal parts along the list of triangles, and one point drawn in each. In a
    triangle, points are even by Osada et al., "Shape distributions", ACM TOG 21 (2002), equation 1.

    Args:
        mesh: The surfaces.
        points_per_m2: Points per area [1/m²].
        seed: Seed of the points.
        region: Where points are wanted; None: everywhere.

    Raises:
        ConfigError: the density is not above 0.
    """
    if not points_per_m2 > 0:
        raise ConfigError(f"{points_per_m2:g} points per m²; give a number above 0")
    corners, row = mesh.vertices_m[mesh.triangles].astype(np.float64), np.arange(len(mesh.triangles))
    if region is not None:
        corners, row = region.pieces(corners, row)
    tag = mesh.tag[mesh.triangles[row, 0]]
    parts = list(_blocks(corners, tag, points_per_m2, seed, region))
    return SurfaceCloud(
        points_xyz_m=np.concatenate([part.points_xyz_m for part in parts]),
        normals=np.concatenate([part.normals for part in parts]),
        tag=np.concatenate([part.tag for part in parts]),
    )


def _blocks(
    corners_m: Array, tag: U8, points_per_m2: float, seed: int, region: Region | None
) -> Iterator[SurfaceCloud]:
    a, b, c = corners_m.swapaxes(0, 1)
    across = np.cross(b - a, c - a)
    twice_area = np.sqrt(np.sum(across**2, axis=1))
    until = np.cumsum(0.5 * twice_area)
    total_m2 = float(until[-1]) if len(until) else 0.0
    count = round(total_m2 * points_per_m2)
    for block, first in enumerate(range(0, max(count, 1), _BLOCK)):
        number = np.arange(first, min(first + _BLOCK, count))
        draw = stream(seed, "map/surface", index=block).random((len(number), 3))
        place = np.searchsorted(until, (number + draw[:, 0]) * (total_m2 / max(count, 1)), side="right")
        k = np.minimum(place, max(len(tag) - 1, 0))
        root, along = np.sqrt(draw[:, 1])[:, None], draw[:, 2][:, None]
        points = (1.0 - root) * a[k] + root * (1.0 - along) * b[k] + root * along * c[k]
        kept = np.ones(len(k), np.bool_) if region is None else region.contains(points)
        yield SurfaceCloud(
            points_xyz_m=points[kept].astype(np.float32),
            normals=(across[k[kept]] / twice_area[k[kept], None]).astype(np.float32),
            tag=tag[k[kept]],
        )


CLOUD_SUFFIXES = (".ply", ".pcd", ".xyz")
"""Kinds of files that clouds are read from."""


def write_mesh(mesh: Mesh, path: Path) -> Path:
    """Write triangles whose corners have normals and the colour of their class in CARLA's palette.

    A PLY has the world's axes (east, north, up). In glTF up is +y: x is east and z is south.

    Args:
        mesh: The triangles, world.
        path: File, ``.ply`` or ``.gltf``; hardly any reader takes the .glb of Open3D.

    Raises:
        OutputError: it cannot be written.
    """
    colours = colourise(mesh.tag)
    if path.suffix.lower() == ".ply":
        columns = _columns("x y z nx ny nz", "<f8", np.hstack([mesh.vertices_m, mesh.normals]))
        columns += _columns("red green blue", "|u1", colours)
        with atomic_write(path) as part:
            part.write_bytes(ply_bytes(columns, mesh.triangles))
        return path
    o3d = import_open3d()
    vector = o3d.utility.Vector3dVector
    corners, normals = (
        values.astype(np.float64)[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
        for values in (mesh.vertices_m, mesh.normals)
    )
    open3d_mesh = o3d.geometry.TriangleMesh(
        vector(corners), o3d.utility.Vector3iVector(mesh.triangles.astype(np.int32))
    )
    open3d_mesh.vertex_normals = vector(normals)
    open3d_mesh.vertex_colors = vector(colours / 255.0)
    # Open3D looks at the end of names alone, cuts files on a full disk, and reports success.
    with atomic_write(path) as part, TemporaryDirectory(dir=part.parent, prefix=".") as folder:
        named = Path(folder, "mesh.gltf")
        o3d.io.write_triangle_mesh(str(named), open3d_mesh)
        with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
            count = len(o3d.io.read_triangle_mesh(str(named)).triangles)
        if count != len(mesh.triangles):
            raise OSError(f"{count:,} of {len(mesh.triangles):,} triangles were written")
        named.replace(part)
    return path


def _columns(names: str, kind: str, values: NDArray[Any]) -> list[tuple[str, str, NDArray[Any]]]:
    return [(name, kind, column) for name, column in zip(names.split(), values.T, strict=True)]


def write_cloud(cloud: SurfaceCloud, path: Path) -> Path:
    """Write a binary PLY: x, y, z, nx, ny, nz in single precision, and the class as ``label``.

    Raises:
        OutputError: it cannot be written.
    """
    columns = _columns("x y z nx ny nz", "<f4", np.hstack([cloud.points_xyz_m, cloud.normals]))
    columns.append(("label", "|u1", cloud.tag))
    with atomic_write(path) as part:
        part.write_bytes(ply_bytes(columns))
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
