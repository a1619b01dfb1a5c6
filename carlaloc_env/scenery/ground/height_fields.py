"""Heights of the ground at any point: near road edges, inside junctions, and far from roads."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import densify
from carlaloc_env.map.opendrive.road_surface import RoadSurface
from carlaloc_env.scenery.ground.lane_strips import Strip

_GRAIN_M = 2.0**-20
"""Step of solved heights [m]."""
LAND_GAP_M = 10.0
"""The land counts so far from roads [m]: they may lie in cuts or on banks."""
NO_LAND: Array = np.zeros((0, 3))
"""Points of a land of which nothing is known."""
HeightOf = Callable[[Array], Array]
"""Height of the ground [m] at points (N, 2) of the world [m]."""


class EdgeField:
    """Height of the nearest of many lines."""

    def __init__(self, lines_m: Sequence[Array], step_m: float = 0.25) -> None:
        """Lines are (N, 3); they are sampled every `step_m`."""
        points = [densify(line, step_m) for line in lines_m if len(line) > 1]
        self.points_m = np.concatenate(points) if points else np.zeros((0, 3))
        self._tree = cKDTree(self.points_m[:, :2]) if len(self.points_m) else None

    def nearest(self, xy_m: Array) -> tuple[Array, Array]:
        """Height of the nearest line [m] and distance to it [m], shapes (M,)."""
        if self._tree is None:
            return np.zeros(len(xy_m)), np.full(len(xy_m), np.inf)
        neighbours = self._tree.query(xy_m[:, :2], k=2)
        distance, index = np.asarray(neighbours[0]), np.asarray(neighbours[1])
        index = np.minimum(index, len(self.points_m) - 1)
        weight = 1.0 / (distance + 1e-6)
        weight[~np.isfinite(weight)] = 0.0
        z = np.sum(self.points_m[index, 2] * weight, axis=1) / np.sum(weight, axis=1)
        return z, distance[:, 0]


class JunctionField:
    """Height of the common surface of a junction's overlapping connecting roads."""

    FADE_M = 1.0
    """Distance over which a road's say fades outside it [m]."""
    CENTRE_M = 0.25
    """Distance from a lane's middle over which its say fades inside [m]: where crossing roads disagree, each
    is right along its own middle, on which its traffic drives."""

    def __init__(self, strips: Sequence[Strip], surface: RoadSurface) -> None:
        self._surface = surface
        self._roads = []
        for strip in strips:
            span = strip.span(("roadway",))
            if span is None:
                continue
            s = np.linspace(strip.s_m[0], strip.s_m[-1], max(3, int(np.ptp(strip.s_m) / 0.25) + 1))
            pose = surface.plan_view.evaluate(np.full(len(s), strip.road), s)
            t_left = np.interp(s, strip.s_m, strip.t_m[span[0]])
            t_right = np.interp(s, strip.s_m, strip.t_m[span[1]])
            middles = [
                np.interp(s, strip.s_m, 0.5 * (strip.t_m[lane] + strip.t_m[lane + 1]))
                for lane in range(*span)
                if strip.lanes[lane].type == "driving"
            ]
            line = cKDTree(np.stack([pose.x_m, pose.y_m], axis=-1))
            self._roads.append((strip.road, s, pose, line, t_left, t_right, middles))

    def height(self, xy_m: Array) -> Array:
        """Height of the surface [m], shape (M,); roads that hold the point count, others fade."""
        total, weight = np.zeros(len(xy_m)), np.zeros(len(xy_m))
        for road, s, pose, line, t_left, t_right, middles in self._roads:
            _, row = line.query(xy_m[:, :2])
            cos, sin = elementary.cos(pose.heading_rad[row]), elementary.sin(pose.heading_rad[row])
            dx, dy = xy_m[:, 0] - pose.x_m[row], xy_m[:, 1] - pose.y_m[row]
            along, t = cos * dx + sin * dy, cos * dy - sin * dx
            stretch = np.maximum(1.0 - pose.curvature_radpm[row] * t, 0.2)
            at = s[row] + along / stretch
            over = np.maximum(0.0, np.maximum(s[0] - at, at - s[-1]))
            aside = np.maximum(0.0, np.maximum(t - t_left[row], t_right[row] - t))
            w = elementary.exp(-((over**2 + aside**2) / self.FADE_M**2))
            off = np.min([np.abs(t - middle[row]) for middle in middles], axis=0) if middles else aside + 1.5
            w = w / (self.CENTRE_M**2 + off**2) ** 2 + 1e-12
            inside = np.clip(at, s[0], s[-1])
            z = self._surface.position(np.full(len(xy_m), road), inside, t)[:, 2]
            total += w * z
            weight += w
        result: Array = total / weight
        return result


class GroundGrid:
    """Smooth height between roads: the membrane through their heights (Laplace's equation) on a grid."""

    CELL_M = 5.0

    def __init__(self, points_m: Array, low_m: Array, high_m: Array) -> None:
        """Known points (K, 3) in the box from `low_m` to `high_m` [m], each (2,)."""
        self._low = np.floor(low_m / self.CELL_M) * self.CELL_M
        self._shape = tuple(int(n) for n in np.ceil((high_m - self._low) / self.CELL_M).astype(int) + 2)
        total_m = np.zeros(self._shape)
        count = np.zeros(self._shape)
        cell = np.round((points_m[:, :2] - self._low) / self.CELL_M).astype(int)
        inside = np.all((cell >= 0) & (cell < np.array(self._shape)), axis=1)
        np.add.at(total_m, tuple(cell[inside].T), points_m[inside, 2])
        np.add.at(count, tuple(cell[inside].T), 1.0)
        self._z = _membrane(np.where(count > 0, total_m / np.maximum(count, 1), 0.0), count > 0)

    def height(self, xy_m: Array) -> Array:
        """Height [m] at points (M, 2), bilinear; the border's height outside the grid."""
        g = (xy_m[:, :2] - self._low) / self.CELL_M
        g = np.clip(g, 0.0, np.array(self._shape) - 1.001)
        i, f = g.astype(int), g - np.floor(g)
        z, (a, b) = self._z, i.T
        u, v = f.T
        result: Array = (z[a, b] * (1 - u) + z[a + 1, b] * u) * (1 - v) + (
            z[a, b + 1] * (1 - u) + z[a + 1, b + 1] * u
        ) * v
        return result


def land_beside(land_m: Array, roads_m: Array) -> Array:
    """Points of the land (K, 3) that lie off roads, given as points (N, 3) [m]."""
    if not len(land_m) or not len(roads_m):
        return land_m
    return land_m[cKDTree(roads_m[:, :2]).query(land_m[:, :2])[0] > LAND_GAP_M]


def _membrane(height_m: Array, fixed: NDArray[np.bool_]) -> Array:
    if not fixed.any():
        return height_m
    rows, columns = height_m.shape
    index = np.arange(height_m.size).reshape(height_m.shape)
    links = np.concatenate(
        [
            np.stack([index[:-1].ravel(), index[1:].ravel()]),
            np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()]),
        ],
        axis=1,
    )
    a, b = np.concatenate([links, links[::-1]], axis=1)
    free = ~fixed.ravel()
    use = free[a]
    a, b = a[use], b[use]
    degree = np.bincount(a, minlength=height_m.size).astype(np.float64)
    diagonal = np.where(free, degree, 1.0)
    matrix = coo_matrix(
        (
            np.concatenate([diagonal, -np.ones(len(a))]),
            (np.concatenate([index.ravel(), a]), np.concatenate([index.ravel(), b])),
        ),
        shape=(height_m.size, height_m.size),
    ).tocsc()
    right = np.where(free, 0.0, height_m.ravel())
    # Rounded to a micrometre, since the last bits of a solver depend on the processor.
    result: Array = np.round(spsolve(matrix, right) / _GRAIN_M) * _GRAIN_M
    return result.reshape(rows, columns)
