"""Finds the order of quaternions, x y z w or w x y z, by the motion of the body.

Most bodies move forward in their own frame through every bend, which the wrong order hides. Angles between
poses are the same in both orders.
"""

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array

XYZW, WXYZ = "xyzw", "wxyz"
_PLACES = {XYZW: [0, 1, 2, 3], WXYZ: [1, 2, 3, 0]}
_STEPS = 400
_SPREAD_MAX, _BEND_MIN, _MARGIN = 0.1, 0.02, 4.0


def as_xyzw(quat: Array, order: str) -> Array:
    """Quaternions of an order, shape (N, 4), as x y z w."""
    return quat[:, _PLACES[order]]


def order_by_motion(position_m: Array, quat: Array) -> str | None:
    """The order in which a body keeps one direction of motion in its own frame.

    Args:
        position_m: Positions [m], shape (N, 3).
        quat: Quaternions as they stand, shape (N, 4).

    Returns:
        None: both orders, or none, show such a direction: the path is straight, or the body moves freely.
    """
    finite = np.isfinite(position_m).all(axis=1) & np.isfinite(quat).all(axis=1)
    position_m, quat = position_m[finite], quat[finite]
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position_m, axis=0), axis=1)))
    if not 0.0 < length[-1] < np.inf:
        return None
    knots = np.unique(np.searchsorted(length, np.linspace(0.0, length[-1], _STEPS + 1)))
    step = np.diff(position_m[knots], axis=0)
    size = np.linalg.norm(step, axis=1)
    way = step[size > 0] / size[size > 0, None]
    middle = ((knots[1:] + knots[:-1]) // 2)[size > 0]
    if _spread(way) < _BEND_MIN:
        return None
    spread = {
        order: _spread(transforms.quat_rotate(transforms.quat_conjugate(as_xyzw(quat[middle], order)), way))
        for order in _PLACES
    }
    better, worse = sorted(spread, key=lambda order: spread[order])
    clear = spread[better] < _SPREAD_MAX and spread[worse] > max(_MARGIN * spread[better], _BEND_MIN)
    return better if clear else None


def _spread(directions: Array) -> float:
    """0 for directions that are all the same, 1 for such that point anywhere."""
    return 1.0 - float(np.linalg.norm(directions.mean(axis=0))) if len(directions) else 0.0
