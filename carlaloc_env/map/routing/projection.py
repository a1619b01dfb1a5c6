"""Projection of a point on a route: where along it, and how far to its left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.core.jit import compiled

_ROUNDS = 3
"""Steps of Newton's method from the nearest sample."""


class Line(NamedTuple):
    """A route for compiled functions; fields as of `Route`."""

    position_m: NDArray[np.float64]
    heading_rad: Array
    curvature_radpm: Array
    step_m: float
    closed: bool


@compiled
def project_on(
    line: Line, x_m: float, y_m: float, low: int, count: int, length_m: float
) -> tuple[float, float]:
    """Distance from the start and offset to the left [m] of a point.

    Args:
        line: The route.
        x_m: East [m].
        y_m: North [m].
        low: First sample to look at; may be below 0 or beyond the last on a closed route.
        count: How many are looked at.
        length_m: Length of the route [m].
    """
    number = len(line.heading_rad)
    nearest, least = 0, np.inf
    for k in range(low, low + count):
        row = k % number
        dx, dy = x_m - line.position_m[row, 0], y_m - line.position_m[row, 1]
        if dx * dx + dy * dy < least:
            nearest, least = row, dx * dx + dy * dy
    s, offset = nearest * line.step_m, 0.0
    for _ in range(_ROUNDS):
        px, py, heading, curvature = _pose(line, s, length_m)
        w, c = sin_cos(heading)
        ex, ey = x_m - px, y_m - py
        offset = c * ey - w * ex
        bend = max(1.0 - curvature * offset, 0.3)
        s += min(max((c * ex + w * ey) / bend, -1.0), 1.0)
        s = s % length_m if line.closed else min(max(s, 0.0), length_m)
    return s, offset


@compiled
def _pose(line: Line, s_m: float, length_m: float) -> tuple[float, float, float, float]:
    """East, north [m], heading [rad] and curvature [1/m] at a distance from the start [m]: as `Route.at`."""
    number, h = len(line.heading_rad), line.step_m
    if line.closed:
        at = s_m % length_m / h
        row = min(int(at), number - 1)
        after = (row + 1) % number
    else:
        at = min(max(s_m / h, 0.0), number - 1.0)
        row = min(int(at), number - 2)
        after = row + 1
    f = at - row
    g = 1.0 - f
    w = f * f * (3.0 - 2.0 * f)
    m0, m1 = h * f * g * g, h * f * f * g
    begin, end = line.heading_rad[row], line.heading_rad[after]
    (north_0, east_0), (north_1, east_1) = sin_cos(begin), sin_cos(end)
    a, b = line.position_m[row], line.position_m[after]
    x = a[0] * (1.0 - w) + b[0] * w + east_0 * m0 - east_1 * m1
    y = a[1] * (1.0 - w) + b[1] * w + north_0 * m0 - north_1 * m1
    turn = (end - begin + np.pi) % (2.0 * np.pi) - np.pi
    curvature = line.curvature_radpm[row] * g + line.curvature_radpm[after] * f
    return x, y, begin + f * turn, curvature
