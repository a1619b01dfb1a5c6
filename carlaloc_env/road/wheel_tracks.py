"""Where wheels clear snow: a map of the distance to the nearest lane's middle, from straight above.

Where lanes cross, wheels of one clear what those of the other leave. So between its tracks the distance is
that of a lone lane whose track is as near as the nearest track of any lane.
"""

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
STEP_MAX_M = 1.0
"""Longest distance between two samples of a lane [m]; the next lane begins farther away."""
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
        above = _uppermost(middles_m)
        top_m, left = middles_m[above], _leftwards(middles_m)[above]
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
        within = lanes[row, column, 0] < TRACK_M
        own_m = _from_tracks_m(top_m[:, :2], left, cells_m[within])
        lanes[row[within], column[within], 0] = TRACK_M - own_m
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


def _leftwards(middles_m: Array) -> Array:
    """Unit vectors to the left of lanes whose samples follow each other, shape (N, 2)."""
    step = np.diff(middles_m[:, :2], axis=0, append=middles_m[-1:, :2])
    length_m = np.linalg.norm(step, axis=1)
    # The last sample of a lane has the direction of the one before.
    along = (length_m > 1e-3) & (length_m < STEP_MAX_M)
    of = np.maximum.accumulate(np.where(along, np.arange(len(step)), 0))
    forwards = step[of] / np.maximum(length_m[of, None], 1e-3)
    return np.stack([-forwards[:, 1], forwards[:, 0]], axis=1)


def _from_tracks_m(middles_m: Array, left: Array, cells_m: Array) -> Array:
    """Distance of places (M, 2) from the nearest wheel's track of any lane [m], shape (M,)."""
    tracks_m = np.concatenate([middles_m + side * TRACK_M * left for side in (-1.0, 1.0)])
    _, nearest = point_tree(tracks_m).query(cells_m)
    offset_m, across = cells_m - tracks_m[nearest], np.tile(left, (2, 1))[nearest]
    lateral_m = np.abs(np.sum(offset_m * across, axis=1))
    along_m = np.abs(offset_m[:, 0] * across[:, 1] - offset_m[:, 1] * across[:, 0])
    distance_m: Array = np.hypot(lateral_m, np.maximum(along_m - 0.5 * STEP_MAX_M, 0.0))
    return distance_m
