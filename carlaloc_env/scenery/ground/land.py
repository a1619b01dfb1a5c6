"""The land between the roads as a raster: what is taken, how far off it is, and which zone holds."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core.areas import Area, polygons_of
from carlaloc_env.core.array_types import Array
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.terrain import Terrain, Zones

LAND_CELL_M = 0.5
"""Side of the raster's cells [m]."""


class Raster:
    """Distance to the nearest of some areas, looked up on a grid."""

    def __init__(self, bounds: Area, shapes: Iterable[Area]) -> None:
        """Rasterise areas inside the bounding box of `bounds`."""
        x0, y0, x1, y1 = shapely.bounds(bounds)
        self._low = np.array([x0, y0])
        size = (int(np.ceil((y1 - y0) / LAND_CELL_M)) + 1, int(np.ceil((x1 - x0) / LAND_CELL_M)) + 1)
        mask = np.full(size, 1, dtype=np.uint8)
        for shape in shapes:
            fill(mask, shape, self._low, 0)
        # Outlines and points are moved to cells, each by half a diagonal at most; the true distance is
        # never less than what is left.
        distance = (cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) - 1.42) * LAND_CELL_M
        self._distance_m = np.where(mask == 0, -1.0, distance).astype(np.float32)

    def distance_m(self, xy_m: Array) -> Array:
        """Distance of points (N, 2) to the areas [m], negative inside them and outside the bounds, (N,)."""
        cell = np.rint((xy_m - self._low) / LAND_CELL_M).astype(np.int64)
        rows, columns = self._distance_m.shape
        within = (cell[:, 0] >= 0) & (cell[:, 0] < columns) & (cell[:, 1] >= 0) & (cell[:, 1] < rows)
        inside = np.clip(cell, 0, [columns - 1, rows - 1])
        distance = self._distance_m[inside[:, 1], inside[:, 0]].astype(np.float64)
        return np.where(within, distance, -1.0)


def fill(mask: NDArray[np.uint8], shape: Area, low_m: Array, value: int) -> None:
    """Set all cells of an area."""
    for part in polygons_of(shape):
        rings = [part.exterior, *part.interiors]
        lines = [np.rint((shapely.get_coordinates(r) - low_m) / LAND_CELL_M).astype(np.int32) for r in rings]
        cv2.fillPoly(mask, lines, value)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Land:
    """Everything that plants, fields and fences must know of a town."""

    bounds: Area
    """The near ground."""
    zones: Zones
    """Kinds of scenery with their areas."""
    ground: Terrain
    """Heights."""
    strips: Sequence[Strip]
    """All road strips."""
    roads: Raster
    """Distances to everything paved."""
    taken: Raster
    """Distances to everything paved, built or reserved."""
    route: cKDTree | None
    """The ego's route, None where there is none."""
    seed: int
    """Seed of the town."""

    def on_ground(self, xy_m: Array, rise_m: float = 0.0) -> Array:
        """The points (N, 2) on the ground, shape (N, 3)."""
        if not len(xy_m):
            return np.zeros((0, 3))
        return np.column_stack([xy_m, self.ground.height(xy_m) + rise_m])

    def near_route(self, xy_m: Array, distance_m: float) -> NDArray[np.bool_]:
        """Whether points (N, 2) lie within a distance of the ego's route; all do where there is none."""
        if self.route is None:
            return np.ones(len(xy_m), dtype=bool)
        return np.asarray(self.route.query(xy_m, distance_upper_bound=distance_m)[0] < distance_m)
