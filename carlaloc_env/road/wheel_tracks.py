"""Where wheels clear snow: a map of the distance to the nearest lane's middle, from straight above."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.point_tree import point_tree

CELL_MIN_M, MOST_CELLS = 0.4, 2048
"""Smallest edge of a cell [m], and most cells along an edge of the map; large towns have larger ones."""
MARGIN_M = 100.0
"""Width of the map beyond the lanes [m]."""
REACH_M = 4.0
"""Distance from a lane's middle beyond which the map tells none apart [m]."""
CLEARANCE_M = 3.0
"""A lane that lies so far below another is under a bridge [m]: no snow falls there."""
TRACK_M, TRACK_HALF_M = 0.8, 0.28
"""Distance of a wheel's track from its lane's middle, and half of its width [m]."""
_NOWHERE_M = -1e4
"""Height of a lane where there is none [m]."""


class WheelTracks(NamedTuple):
    """Lanes of a town from above; row = north, column = east."""

    low_m: Array
    """South-west corner [m], shape (2,)."""
    cell_m: float
    """Edge of a cell [m]."""
    lanes: F32
    """Distance from the nearest lane's middle, `REACH_M` at most, and its height [m], shape (R, C, 2)."""

    @classmethod
    def of(cls, middles_m: Array) -> WheelTracks:
        """Map of the middles of all driven lanes, sampled at least once a metre [m], shape (N, 3)."""
        if not len(middles_m):
            return no_tracks()
        low_m = middles_m[:, :2].min(axis=0) - MARGIN_M
        extent_m = middles_m[:, :2].max(axis=0) + MARGIN_M - low_m
        cell_m = max(CELL_MIN_M, float(extent_m.max()) / MOST_CELLS)
        columns, rows = np.ceil(extent_m / cell_m).astype(int)
        lanes = np.empty((rows, columns, 2), np.float32)
        lanes[...] = REACH_M, _NOWHERE_M
        top_m = middles_m[_uppermost(middles_m)]
        steps = np.arange(-REACH_M, REACH_M + cell_m, cell_m)
        near = np.zeros((rows, columns), bool)
        at = ((top_m[:, :2] - low_m) / cell_m).astype(int)
        for east in np.unique((steps / cell_m).astype(int)):
            for north in np.unique((steps / cell_m).astype(int)):
                near[at[:, 1] + north, at[:, 0] + east] = True
        row, column = np.nonzero(near)
        cells_m = low_m + (np.stack([column, row], axis=1) + 0.5) * cell_m
        away_m, nearest = point_tree(top_m[:, :2]).query(cells_m)
        lanes[row, column, 0] = np.minimum(away_m, REACH_M)
        lanes[row, column, 1] = top_m[nearest, 2]
        return cls(low_m=low_m, cell_m=cell_m, lanes=lanes)

    def at(self, points_m: Array) -> tuple[F32, F32]:
        """Distance from the nearest lane's middle and height above it [m] of points (N, 3), (N,) each."""
        rows, columns, _ = self.lanes.shape
        column, row = ((points_m[:, :2] - self.low_m) / self.cell_m).astype(int).T
        away_m, height_m = self.lanes[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)].T
        return away_m, (points_m[:, 2] - height_m).astype(np.float32)


def no_tracks() -> WheelTracks:
    """Map of a world without lanes."""
    lanes = np.array([REACH_M, _NOWHERE_M], np.float32).reshape(1, 1, 2)
    return WheelTracks(low_m=np.zeros(2), cell_m=1.0, lanes=lanes)


def _uppermost(middles_m: Array) -> Index:
    """Rows of middles that no other lane crosses above, shape (M,)."""
    cell = np.floor(middles_m[:, :2] / 2.0).astype(np.int64)
    _, of = np.unique(cell, axis=0, return_inverse=True)
    of = of.reshape(-1)
    highest = np.full(of.max() + 1, -np.inf)
    np.maximum.at(highest, of, middles_m[:, 2])
    return np.flatnonzero(middles_m[:, 2] > highest[of] - CLEARANCE_M)
