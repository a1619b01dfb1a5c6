"""Roughness of a town's roads: their classes of ISO 8608 by type, limit and zone, as levels on a grid."""

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.ndimage import correlate1d
from scipy.spatial import cKDTree

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.centre_lines import POSITION_LIMIT_M
from carlaloc_env.map.lanes.speed_limits import road_limit_mps
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.map.opendrive.reference_line import PlanView
from carlaloc_env.road.road_profile import LevelGrid
from carlaloc_env.road.rough_surface import class_level

MOTORWAY_CLASS, TOWN_CLASS, COUNTRY_CLASS = "A", "B", "C"
"""Classes of motorways and other fast roads, of streets, and of roads between fields."""
FAST_MPS = 80.0 / 3.6 - 0.1
"""Limit from which a road is as even as a motorway [m/s]."""
CELL_M = 5.0
"""Distance of the grid's points [m], more on maps that are kilometres wide."""
MOST_CELLS = 1_000_000
"""Points of the grid at most, about."""
BLEND_M = 10.0
"""Standard deviation of the distance over which one class goes over into another [m]."""
_STEP_M = 5.0


def road_levels(roads: Sequence[Road], config: TownConfig) -> LevelGrid | None:
    """Levels of all roads by place; None where `road_roughness` is 0.

    Every place takes the class of the nearest road, also where one road crosses above another.
    """
    points, fast = _samples(roads)
    if config.road_roughness == 0.0 or not len(points):
        return None
    level = elementary.log([class_level(name) for name in _classes(points, fast, config)])
    cell = max(CELL_M, float(np.sqrt(np.prod(np.ptp(points, axis=0)) / MOST_CELLS)))
    low = np.floor(points.min(axis=0) / cell - 4.0) * cell
    shape = np.ceil((points.max(axis=0) - low) / cell + 4.0).astype(int)
    i, j = np.indices(shape).reshape(2, -1)
    _, nearest = cKDTree(points).query(low + np.stack([i, j], axis=-1) * cell)
    grid = _blend(level[nearest].reshape(shape), BLEND_M / cell)
    return LevelGrid((float(low[0]), float(low[1])), cell, config.road_roughness * elementary.exp(grid))


def is_even(road: Road) -> bool:
    """Whether a road is laid as evenly as a motorway."""
    return road.type == "motorway" or road_limit_mps(road) >= FAST_MPS


def _blend(grid: Array, sigma: float) -> Array:
    """A Gaussian filter, sigma in cells; the weights of SciPy's own differ by processor, as `np.exp` does."""
    reach = int(4.0 * sigma + 0.5)
    weights = elementary.exp(-0.5 / (sigma * sigma) * np.arange(-reach, reach + 1) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        grid = correlate1d(grid, weights, axis, mode="nearest")
    return grid


def _samples(roads: Sequence[Road]) -> tuple[Array, Array]:
    """Points on the reference lines of all roads (N, 2), and whether each road is even (N,)."""
    points, fast = [np.zeros((0, 2))], [np.zeros(0, dtype=bool)]
    plan = PlanView(roads)
    for number, road in enumerate(roads):
        s = np.linspace(0.0, road.length_m, int(road.length_m / _STEP_M) + 2)
        with np.errstate(all="ignore"):
            pose = plan.evaluate(np.full(len(s), number), s)
        points.append(np.stack([pose.x_m, pose.y_m], axis=-1))
        fast.append(np.full(len(s), is_even(road)))
    every, even = np.concatenate(points), np.concatenate(fast)
    usable = np.isfinite(every).all(axis=1) & (np.abs(every) < POSITION_LIMIT_M).all(axis=1)
    return every[usable], even[usable]


def _classes(points: Array, fast: Array, config: TownConfig) -> list[str]:
    country = np.full(len(points), config.default_zone == "rural")
    stated = np.full(len(points), "")
    for zone in config.zones:
        area = shapely.make_valid(shapely.Polygon(zone.polygon))
        inside = shapely.intersects_xy(area, points[:, 0], points[:, 1])
        country[inside] = zone.kind == "rural"
        stated[inside] = zone.road_class
    usual = np.where(fast, MOTORWAY_CLASS, np.where(country, COUNTRY_CLASS, TOWN_CLASS))
    return [str(name) for name in np.where(stated == "", usual, stated)]
