"""The town as a map: how far points lie from its surfaces, and which of them a drive's LiDAR ever saw."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import U8, Array, Mask
from carlaloc_env.raycast.scene import RayScene
from carlaloc_env.raycast.surface import import_open3d
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.sensors.lidar.scan_pattern import LidarConfig
from carlaloc_env.timeline.timeline import Timeline
from recorder.map_truth.views import REACHED_M, field_of

Progress: TypeAlias = Callable[[float, float], None]
"""Called with what is done and what there is to do."""


class TrueMap:
    """Surfaces of a town, ready for the nearest point on them.

    Args:
        mesh: Triangles, world.

    Raises:
        RaycastError: Open3D is missing on this machine.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._o3d = import_open3d()
        self.mesh = mesh
        # Embree computes in single precision: metres counted from the middle keep far corners exact.
        self._middle_m = np.round(mesh.bounds_m.mean(axis=0, dtype=np.float64))
        self._scene = self._o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor(mesh.vertices_m - self._middle_m), self._o3d.core.Tensor(mesh.triangles)
        )

    def nearest(self, points_m: Array) -> tuple[Array, U8]:
        """Distance to the nearest surface [m], and the class of that surface, shapes (N,).

        Args:
            points_m: Points, world, shape (N, 3).
        """
        query = (points_m - self._middle_m).astype(np.float32)
        found = self._scene.compute_closest_points(self._tensor(query))
        away = found["points"].numpy().astype(np.float64) - query
        tag: U8 = self.mesh.tag[self.mesh.triangles[found["primitive_ids"].numpy(), 0]]
        return np.sqrt(np.sum(away**2, axis=1)), tag

    def _tensor(self, values: NDArray[np.generic]) -> object:
        return self._o3d.core.Tensor(np.ascontiguousarray(values, dtype=np.float32))


def ever_visible(
    points_m: Array,
    rays: RayScene,
    timeline: Timeline,
    lidar: LidarConfig,
    stamps_ns: NDArray[np.int64],
    report: Progress = lambda *_: None,
) -> Mask:
    """Which points of surfaces a LiDAR has had in sight at one of some stamps, shape (N,).

    A point is in sight if it lies within the range and between the lowest and the highest beam, and a ray to
    it meets nothing before: neither the town, nor a mover at that stamp, nor the ego's own body.

    Args:
        points_m: Points on surfaces, world, shape (N, 3).
        rays: The town and its models.
        timeline: The drive; its actors hide what is behind them.
        lidar: The LiDAR.
        stamps_ns: When it looks [ns].
        report: Called at each stamp.
    """
    seen, field = np.zeros(len(points_m), np.bool_), field_of(lidar)
    T_world_base = timeline.ego_motion(stamps_ns).T_world_frame
    for number, stamp in enumerate(stamps_ns.tolist()):
        T_world_lidar = T_world_base[number] @ lidar.mount.T_base_sensor
        inside = field.holds(transforms.apply(transforms.invert(T_world_lidar), points_m))
        rows = np.flatnonzero(~seen & inside)
        away = points_m[rows] - T_world_lidar[:3, 3]
        distance = np.sqrt(np.sum(away**2, axis=1))
        hits = rays.cast(
            np.broadcast_to(T_world_lidar[:3, 3], away.shape),
            away / distance[:, None],
            np.full(len(rows), stamp, np.int64),
            timeline,
            lidar.range_max_m + REACHED_M,
        )
        seen[rows[hits.range_m >= distance - REACHED_M]] = True
        report(number + 1, len(stamps_ns))
    return seen
