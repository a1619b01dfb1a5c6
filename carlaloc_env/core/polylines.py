"""Polylines: distances along them, points between their corners, and their right-hand sides."""

import numpy as np

from carlaloc_env.core.array_types import Array


def distance_along(line_m: Array) -> Array:
    """Distance of each point of a line (N, 2 or 3) from its first in plan [m], (N,)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line_m[:, :2], axis=0).T))])


def interpolated(s: Array, s_m: Array, rows: Array) -> Array:
    """Rows (N, K), given at rising stations (N,), at other stations (M,), shape (M, K)."""
    return np.stack([np.interp(s, s_m, rows[:, k]) for k in range(rows.shape[1])], axis=-1)


def densify(line_m: Array, step_m: float) -> Array:
    """Points at most `step_m` apart on a polyline (N, 3)."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line_m[:, :2], axis=0), axis=1))])
    if length[-1] < 1e-6:
        return line_m[:1]
    at = np.linspace(0.0, length[-1], int(np.ceil(length[-1] / step_m)) + 1)
    return interpolated(at, length, line_m)


def right_of(line: Array) -> Array:
    """Unit vectors (N, 2) to the right of a line in plan."""
    step = np.gradient(line[:, :2], axis=0)
    step /= np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)[:, None]
    return np.stack([step[:, 1], -step[:, 0]], axis=-1)
