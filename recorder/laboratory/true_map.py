"""The town as a map: how far points lie from its surfaces, and which of them a drive's LiDAR ever saw.

Content of a frame: the field of a camera or LiDAR, and the share of one frame that another one sees.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import U8, Array, Index, Mask
from carlaloc_env.raycast.scene import RayScene
from carlaloc_env.raycast.surface import import_open3d
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.timeline.actors import empty_catalog
from carlaloc_env.timeline.timeline import Timeline

REACHED_M = 0.05
"""A ray that ends so near a point has reached it [m]: paint and covers lie millimetres above their road."""
CAMERA_RANGE_M = 200.0
"""Surfaces farther from a camera count as sky [m]."""
_PATTERN_ROWS = 32
"""Rows of directions that stand for a pattern."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Directions in which a sensor looks, and its range."""

    range_max_m: float
    """Farthest surface that counts [m]."""
    directions: Callable[[int], Array]
    """Unit vectors spread evenly over pixels or beams, sensor frame, about as many as asked for, (N, 3)."""
    holds: Callable[[Array], Mask]
    """Which points of the sensor frame, (N, 3), lie in the field, whatever is before them, shape (N,)."""


def field_of(config: CameraConfig | LidarConfig) -> Field:
    """The field of a LiDAR, or that of a camera by its pinhole alone: distortion of a lens is left out."""
    return _lidar_field(config) if isinstance(config, LidarConfig) else _camera_field(config)


def _camera_field(config: CameraConfig) -> Field:
    lens = config.pinhole
    sizes = np.array([lens.width_px, lens.height_px])

    def directions(rays: int) -> Array:
        counts = np.maximum(np.round(sizes / max(np.sqrt(sizes.prod() / rays), 1.0)), 1.0)
        u, v = ((np.arange(n) + 0.5) * size / n - 0.5 for n, size in zip(counts, sizes, strict=True))
        x, y = np.meshgrid((u - lens.cx_px) / lens.fx_px, (v - lens.cy_px) / lens.fy_px)
        away = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=-1)
        return np.asarray(away / np.sqrt(np.sum(away**2, axis=1))[:, None])

    def holds(points_m: Array) -> Mask:
        # NaN, behind the camera, lies in no image.
        inside = (np.abs(lens.project(points_m) + 0.5 - 0.5 * sizes) <= 0.5 * sizes).all(axis=1)
        return np.asarray(inside & (np.sum(points_m**2, axis=1) <= CAMERA_RANGE_M**2))

    return Field(range_max_m=CAMERA_RANGE_M, directions=directions, holds=holds)


def _lidar_field(config: LidarConfig) -> Field:
    low_rad, high_rad = np.radians(np.array(config.field_deg))
    half_rad = 0.5 * np.radians(config.width_deg)
    up_rad = np.radians(np.array(config.elevations_deg) + config.elevation_offset_deg)
    if config.pattern is not None:
        up_rad = np.linspace(low_rad, high_rad, _PATTERN_ROWS)
    near_m = config.near_m if config.ego_returns else config.range_min_m

    def directions(rays: int) -> Array:
        columns = max(rays // len(up_rad), 1)
        around = np.arange(columns) * (2.0 * half_rad / columns)
        if half_rad < np.pi:
            around -= half_rad
        a, e = (v.ravel() for v in np.meshgrid(around, up_rad))
        return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)

    def holds(points_m: Array) -> Mask:
        distance = np.sqrt(np.sum(points_m**2, axis=1))
        up = np.arcsin(np.clip(points_m[:, 2] / np.maximum(distance, 1e-9), -1.0, 1.0))
        # Rounding must not put a ray along the outermost beam outside.
        inside = (up >= low_rad - 1e-6) & (up <= high_rad + 1e-6)
        inside &= np.abs(np.arctan2(points_m[:, 1], points_m[:, 0])) <= half_rad + 1e-6
        return np.asarray(inside & (distance >= near_m) & (distance <= config.range_max_m))

    return Field(range_max_m=config.range_max_m, directions=directions, holds=holds)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """Surfaces of the town that a frame shows, on a grid of its pixels or beams."""

    T_world_sensor: Array
    """Pose, maps the sensor frame to the world, shape (4, 4)."""
    points_m: Array
    """First surfaces along its rays, without sky, world, shape (N, 3)."""


def look(rays: RayScene, field: Field, T_world_sensor: Array, count: int) -> View:
    """Surfaces that a sensor sees from a pose; movers and the ego's own body are left out.

    Args:
        rays: The town.
        field: Field of the sensor.
        T_world_sensor: Pose, shape (4, 4).
        count: About how many rays are cast.
    """
    turned = transforms.apply(transforms.from_rotation(T_world_sensor[:3, :3]), field.directions(count))
    range_m = _ranges(rays, T_world_sensor[:3, 3], turned, field.range_max_m)
    met = np.isfinite(range_m)
    points = T_world_sensor[:3, 3] + turned[met] * range_m[met, None]
    seen = field.holds(transforms.apply(transforms.invert(T_world_sensor), points))
    return View(T_world_sensor=T_world_sensor, points_m=points[seen])


def seen_shares(rays: RayScene, field: Field, eye: View, others: Sequence[View]) -> Array:
    """Share of what each of some views shows that one more view sees, 0–1, shape (len(others),).

    A point is seen if it lies in the field, and a ray to it meets nothing of the town before. A view of the
    sky alone shows nothing, of which 0 is seen.
    """
    counts = np.array([len(other.points_m) for other in others])
    points = np.concatenate([other.points_m for other in others])
    whose: Index = np.repeat(np.arange(len(others)), counts)
    inside = field.holds(transforms.apply(transforms.invert(eye.T_world_sensor), points))
    away = points[inside] - eye.T_world_sensor[:3, 3]
    distance = np.sqrt(np.sum(away**2, axis=1))
    met = _ranges(rays, eye.T_world_sensor[:3, 3], away / distance[:, None], field.range_max_m + 1.0)
    seen = np.bincount(whose[inside][met >= distance - REACHED_M], minlength=len(others))
    return np.asarray(seen / np.maximum(counts, 1))


def _ranges(rays: RayScene, eye_m: Array, directions: Array, range_max_m: float) -> Array:
    nobody = Timeline(empty_catalog())
    origins = np.broadcast_to(eye_m, directions.shape)
    stamps = np.zeros(len(directions), np.int64)
    hits = rays.cast(origins, directions, stamps, nobody, range_max_m, ego=False)
    return np.asarray(hits.range_m, np.float64)


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
        closest = self._scene.compute_closest_points(self._tensor(query))
        away = closest["points"].numpy().astype(np.float64) - query
        tag: U8 = self.mesh.tag[self.mesh.triangles[closest["primitive_ids"].numpy(), 0]]
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
    """Mask of the surface points that a LiDAR saw at one stamp or more, shape (N,).

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
