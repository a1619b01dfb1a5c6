"""Search for the lanes nearest to points, by a k-d tree over their samples."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.map.lanes.centre_lines import TABLE_STEP_M, LaneTables

_CANDIDATES = 8


class NearestLane(NamedTuple):
    """Where points lie on the lanes nearest to them, each field (M,)."""

    lane: Index
    station_m: Array
    offset_m: Array
    """To the left of the lane centre, in travel direction."""
    distance_m: Array
    """To the lane centre, in the dimensions of the points given."""


class LaneSearch:
    """A k-d tree over the samples of some lanes."""

    def __init__(self, tables: LaneTables, lanes: Index, dimensions: int) -> None:
        """Gathers the samples of `lanes` in the plane (2) or in space (3)."""
        self._tables = tables
        self._dimensions = dimensions
        owner = np.repeat(np.arange(len(tables.count)), tables.count)
        self._rows: Index = np.flatnonzero(np.isin(owner, lanes)).astype(np.int64)
        self._owner: Index = owner[self._rows]
        self._tree = point_tree(tables.position_m[self._rows, :dimensions])

    def nearest(self, points_m: NDArray[np.float64]) -> NearestLane:
        """Nearest lanes of points (M, 2 or 3); equal distances go to the lower lane number."""
        points = points_m[:, : self._dimensions]
        number = min(_CANDIDATES, len(self._rows))
        _, near = self._tree.query(points, k=np.arange(1, number + 1))
        lane, station, offset, distance = self._project(np.repeat(points, number, axis=0), near.reshape(-1))
        # A micrometre decides nothing: there the lane number does.
        keys = (lane.reshape(-1, number), np.round(distance, 6).reshape(-1, number))
        best = np.lexsort(keys, axis=-1)[:, 0] + np.arange(len(points)) * number
        return NearestLane(lane[best], station[best], offset[best], distance[best])

    def within(self, point_m: NDArray[np.float64], radius_m: float) -> NearestLane:
        """All lanes that come within a reach [m] of one point, the nearest first."""
        near = np.array(self._tree.query_ball_point(point_m, radius_m + TABLE_STEP_M), dtype=np.int64)
        points = np.repeat(point_m[None], len(near), axis=0)
        lane, station, offset, distance = self._project(points, near)
        order = np.lexsort((station, distance, lane))
        _, first = np.unique(lane[order], return_index=True)
        best = order[first]
        best = best[distance[best] <= radius_m]
        best = best[np.argsort(distance[best], kind="stable")]
        return NearestLane(lane[best], station[best], offset[best], distance[best])

    def _project(self, points: NDArray[np.float64], near: Index) -> tuple[Index, Array, Array, Array]:
        tables, lane = self._tables, self._owner[near]
        row = self._rows[near]
        station = (row - tables.first[lane]) * tables.step_m[lane]
        length = tables.length_m[lane]
        for _ in range(3):
            pose = tables.pose(lane, station)
            c, s = elementary.cos(pose.heading_rad), elementary.sin(pose.heading_rad)
            dx, dy = points[:, 0] - pose.position_m[:, 0], points[:, 1] - pose.position_m[:, 1]
            ahead, left = c * dx + s * dy, c * dy - s * dx
            # Newton on the foot point; 1 − κ·offset is kept positive inside the curve's centre.
            move = ahead / np.maximum(1.0 - pose.curvature_radpm * left, 0.2)
            station = np.clip(station + np.clip(move, -1.0, 1.0), 0.0, length)
        pose = tables.pose(lane, station)
        delta = points - pose.position_m[:, : self._dimensions]
        c, s = elementary.cos(pose.heading_rad), elementary.sin(pose.heading_rad)
        offset = c * delta[:, 1] - s * delta[:, 0]
        return lane, station, offset, np.sqrt(np.sum(delta * delta, axis=1))
