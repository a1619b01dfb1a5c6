"""Ghosts: points of a map that movers have left where nothing stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.raycast.scene import into_actor_frame
from carlaloc_env.timeline.timeline import Timeline


@dataclass(frozen=True, slots=True, kw_only=True)
class GhostRule:
    """When a point is a ghost."""

    surface_m: float = 0.3
    """Least distance from every static surface [m]; noise and small errors of poses stay below it."""
    margin_m: float = 0.2
    """Width by which movers' boxes are grown on all sides but the ground's [m]."""

    def __post_init__(self) -> None:
        if not (self.surface_m > 0 and self.margin_m >= 0):
            raise ConfigError("a ghost's distance from surfaces must be above 0 m, its margin not below")


def find_ghosts(
    points_m: Array,
    surface_distance_m: Array,
    timeline: Timeline,
    span_ns: tuple[int, int],
    rule: GhostRule = GhostRule(),
) -> Mask:
    """Which points lie off all static surfaces, and in a mover's box at a stamp of the drive, shape (N,).

    Boxes are taken every 50 ms. At less than their length in that time their union is the swept volume.

    Args:
        points_m: Points of a map, world, shape (N, 3).
        surface_distance_m: Distance of each from the nearest static surface [m], shape (N,).
        timeline: The drive, with the actors that may have left ghosts.
        span_ns: First and last stamp of the map [ns].
        rule: When a point is a ghost.
    """
    ghost = np.zeros(len(points_m), np.bool_)
    far = np.flatnonzero(surface_distance_m > rule.surface_m)
    if not len(far) or not len(timeline.catalog):
        return ghost
    points = points_m[far]
    tree = cKDTree(points)
    low, high = points.min(axis=0), points.max(axis=0)
    size_m = timeline.catalog.size_m.astype(np.float64)
    around = 0.5 * np.sqrt(np.sum(size_m**2, axis=1)) + 2.0 * rule.margin_m
    found = np.zeros(len(far), np.bool_)
    before: NDArray[np.float64] | None = None
    first, last = (min(max(ns, timeline.start_ns), timeline.end_ns) for ns in span_ns)
    for stamp in np.unique([*range(first, last, STEP_NS), last]).tolist():
        frame = timeline.actors_at(stamp)
        pose = np.column_stack([frame.position_m, frame.heading_rad, frame.pitch_rad, frame.roll_rad]).astype(
            np.float64
        )
        centre = pose[:, :3] + [0.0, 0.0, 0.5] * size_m
        near = np.all((centre > low - around[:, None]) & (centre < high + around[:, None]), axis=1)
        if before is not None:
            near &= np.any(pose != before, axis=1)  # who stands still covers nothing new
        before = pose
        actors = np.flatnonzero(near)
        if not len(actors):
            continue
        lists = tree.query_ball_point(centre[actors], around[actors])
        actor = np.repeat(actors, [len(rows) for rows in lists])
        point = np.concatenate([np.asarray(rows, np.intp) for rows in lists])
        found[point[_in_boxes(points[point], pose[actor], size_m[actor], rule.margin_m)]] = True
    ghost[far[found]] = True
    return ghost


def _in_boxes(points_m: Array, pose: Array, size_m: Array, margin_m: float) -> Mask:
    """Whether points lie in boxes, row by row; poses are x, y, z on the ground, heading, pitch, roll."""
    offset_m = points_m - pose[:, :3]
    forward, left, up = into_actor_frame(offset_m, offset_m, pose[:, 3], pose[:, 4], pose[:, 5])[:, :3].T
    half = 0.5 * size_m + margin_m
    inside: Mask = (
        (np.abs(forward) <= half[:, 0])
        & (np.abs(left) <= half[:, 1])
        & (up >= 0.0)
        & (up <= size_m[:, 2] + margin_m)
    )
    return inside
