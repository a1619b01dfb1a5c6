"""The route as a driver sees it: where the lane runs, how it bends, how fast it may be driven."""

from math import floor, pi

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.routing.driving_line import EASE_M, wanted_inside
from carlaloc_env.map.routing.route import Route

SPACING_M = 0.5
_CURVE_WINDOW_M = 4.0
_SLOWEST_MPS = 2.5
_CAREFUL_MPS2 = 1.3
_TURN_FROM_RADPM, _TURN_FULL_RADPM = 1.0 / 45.0, 1.0 / 25.0
_TURN_REACH_M = 7.0
_DOUBLE_RADPM, _DOUBLE_REACH_M = 1.0 / 13.0, 9.0


class DriverRoute:
    """Evenly sampled route with answers at any distance; distances of a closed route never wrap.

    Args:
        route: The route.
        limit_fraction: Speed on a straight as a fraction of the limit.
    """

    def __init__(self, route: Route, limit_fraction: float) -> None:
        self.length_m = float(route.length_m)
        self.closed = bool(route.closed)
        steps = max(2, round(self.length_m / SPACING_M))
        self._step_m = self.length_m / steps
        count = steps if self.closed else steps + 1
        at = route.at(np.arange(count) * self._step_m)
        position = np.asarray(at.position_m, dtype=np.float64)
        heading = np.unwrap(np.asarray(at.heading_rad, dtype=np.float64))
        self._turn_rad = 0.0
        if self.closed:
            last = float(wrap_angle(heading[0] - heading[-1]))
            self._turn_rad = round((heading[-1] + last - heading[0]) / (2 * pi)) * 2 * pi
        self._count = count
        free = ~route.is_fitted(np.arange(count) * self._step_m)
        inside = self._inside(self._windowed_curvature(heading, _CURVE_WINDOW_M) * free)
        position[:, 0] -= inside * elementary.sin(heading)
        position[:, 1] += inside * elementary.cos(heading)
        heading = heading + elementary.arctan(
            (self._shifted(inside, 1) - self._shifted(inside, -1)) / (2.0 * self._step_m)
        )
        self._x: list[float] = position[:, 0].tolist()
        self._y: list[float] = position[:, 1].tolist()
        self._heading: list[float] = heading.tolist()
        curvature = self._windowed_curvature(heading, _CURVE_WINDOW_M)
        self._speed = _speeds(curvature, np.asarray(at.speed_limit_mps, dtype=np.float64) * limit_fraction)
        # Where the path was fitted there is little room: a body that leans far touches kerbs. Between two
        # bends the hands turn the wheel from one side to the other, and a car that is fast leaves its lane.
        reach = round(_DOUBLE_REACH_M / self._step_m)
        double = np.minimum(self._widest(curvature, reach), self._widest(-curvature, reach))
        careful = np.sqrt(_CAREFUL_MPS2 / np.maximum(np.abs(curvature), 1e-4))
        hasty = free & (double < _DOUBLE_RADPM)
        self._speed = np.where(hasty, self._speed, np.minimum(self._speed, careful))
        reach = round(_TURN_REACH_M / self._step_m)
        turn = (np.abs(curvature) - _TURN_FROM_RADPM) / (_TURN_FULL_RADPM - _TURN_FROM_RADPM)
        self._speed = -self._widest(-self._speed, round(3.0 / self._step_m))
        self._turning: list[float] = np.clip(self._widest(turn, reach), 0.0, 1.0).tolist()
        span = round(3.0 / self._step_m)
        rise = self._shifted(position[:, 2], span) - self._shifted(position[:, 2], -span)
        self._grade: list[float] = (rise / (2 * span * self._step_m)).tolist()

    def locate(self, x_m: float, y_m: float, near_s_m: float) -> tuple[float, float]:
        """Distance along the route and offset to its left [m] of a point near a known distance."""
        s = near_s_m
        for _ in range(2):
            px, py, heading = self._sample(s)
            dx, dy = x_m - px, y_m - py
            n, c = sin_cos(heading)
            s += dx * c + dy * n
        px, py, heading = self._sample(s)
        n, c = sin_cos(heading)
        return s, (y_m - py) * c - (x_m - px) * n

    def heading(self, s_m: float) -> float:
        """Heading of the lane [rad], continuous along the route."""
        return self._sample(s_m)[2]

    def curvature(self, s_m: float, half_window_m: float) -> float:
        """Mean curvature over a window around a distance [1/m]."""
        return (self.heading(s_m + half_window_m) - self.heading(s_m - half_window_m)) / (2 * half_window_m)

    def turning(self, s_m: float) -> float:
        """0 on roads, 1 in turns as tight as those of junctions."""
        return self._turning[self._index(s_m)]

    def grade(self, s_m: float) -> float:
        """Slope along the route, rising > 0."""
        return self._grade[self._index(s_m)]

    def speeds_ahead(self, s_m: float, reach_m: float, every_m: float) -> tuple[Array, Array]:
        """Distances ahead [m] and the speeds that bends and limits allow there [m/s]."""
        ahead = np.arange(0.0, reach_m, every_m)
        index = np.round((s_m + ahead) / self._step_m).astype(np.int64)
        index = index % self._count if self.closed else np.clip(index, 0, self._count - 1)
        return ahead, self._speed[index]

    def _index(self, s_m: float) -> int:
        k = round(s_m / self._step_m)
        return k % self._count if self.closed else min(max(k, 0), self._count - 1)

    def _sample(self, s_m: float) -> tuple[float, float, float]:
        q = s_m / self._step_m
        k = floor(q)
        f = q - k
        turns, after = 0, k + 1
        if self.closed:
            turns, k = divmod(k, self._count)
            after = k + 1 if k + 1 < self._count else 0
        else:
            k = min(max(k, 0), self._count - 2)
            f = q - k
            after = k + 1
        h0, h1 = self._heading[k], self._heading[after]
        if after == 0:
            h1 += self._turn_rad
        x = self._x[k] + f * (self._x[after] - self._x[k])
        y = self._y[k] + f * (self._y[after] - self._y[k])
        blend = min(max(f, 0.0), 1.0)
        return x, y, h0 + blend * (h1 - h0) + turns * self._turn_rad

    def _shifted(self, values: Array, by: int) -> Array:
        index = np.arange(self._count) + by
        return values[index % self._count] if self.closed else values[np.clip(index, 0, self._count - 1)]

    def _windowed_curvature(self, heading: Array, window_m: float) -> Array:
        half = max(1, round(0.5 * window_m / self._step_m))
        difference = self._shifted(heading, half) - self._shifted(heading, -half)
        turn: Array = wrap_angle(difference)
        return turn / (2 * half * self._step_m)

    def _inside(self, curvature: Array) -> Array:
        """How far left of the lane's centre to drive [m]."""
        wanted = wanted_inside(curvature)
        # Two running means: neither the path nor its direction jumps.
        half = round(EASE_M / self._step_m)
        for _ in range(2):
            wanted = np.mean([self._shifted(wanted, k) for k in range(-half, half + 1)], axis=0)
        return wanted

    def _widest(self, values: Array, reach: int) -> Array:
        widest: Array = np.max(np.stack([self._shifted(values, k) for k in range(-reach, reach + 1)]), axis=0)
        return widest


def _speeds(curvature: Array, limit_mps: Array) -> Array:
    """Speeds [m/s] for bends: lateral acceleration that people accept falls with speed."""
    bend = np.maximum(np.abs(curvature), 1e-4)
    speed = np.sqrt(2.4 / bend)
    for _ in range(3):
        speed = np.sqrt(np.interp(speed, (6.0, 14.0, 22.0, 30.0), (2.4, 2.1, 1.7, 1.3)) / bend)
    return np.maximum(np.minimum(speed, limit_mps), np.minimum(_SLOWEST_MPS, limit_mps))
