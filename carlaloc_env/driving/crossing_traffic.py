"""Crossing traffic: vehicles about to come into the ego's path, in roundabouts, crossing, merging."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_SIZE_M
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.timeline.timeline import ActorCatalog, ActorFrame
from carlaloc_env.town.routing.route import Route

_RANGE_M = 45.0
"""Distance along the route within which crossing vehicles are looked for [m]."""
_AHEAD_S = np.array([0.4, 0.8, 1.2, 1.6, 2.0, 2.5, 3.0, 3.5])
"""Times ahead at which their positions are predicted [s], (T,)."""
_OTHERS_WHEELBASE_M = 2.8
"""Wheelbase that the ego takes every other vehicle to have [m]: that of a saloon."""
_SLOWEST_MPS = 0.7
"""Slower vehicles stand [m/s]."""
_ONCOMING_RAD = 2.2
"""Vehicles that meet the route at a greater angle are oncoming [rad]."""
_SIDE_M = 0.35
"""Room beside both vehicles [m]."""
_CLEAR_BEFORE_S = 1.6
"""A vehicle counts when the ego arrives so much before it at most [s]."""
_CLEAR_AFTER_S = 2.4
"""A vehicle counts when the ego arrives so much after it at most [s]."""


def crossing_traffic(
    route: Route, s_m: float, speed_mps: float, actors: ActorFrame, catalog: ActorCatalog
) -> tuple[float, float] | None:
    """Gap [m] to where the first crossing vehicle meets the route, and its speed along it [m/s].

    Vehicles are predicted to go on along the arc that their front wheels show. One counts when the ego would
    come to the same point at about the same time, neither well before nor well after.

    Args:
        route: The ego's route.
        s_m: Where `base_link` is on it [m].
        speed_mps: The ego's speed [m/s].
        actors: State of all N actors now.
        catalog: Their catalogue.
    """
    path = route.at(s_m + np.arange(0.0, _RANGE_M, 1.0))
    here = path.position_m[0]
    position_m = actors.position_m.astype(np.float64)
    near = np.hypot(position_m[:, 0] - here[0], position_m[:, 1] - here[1]) < _RANGE_M + 10.0
    # A vehicle behind yields to the ego, not the ego to it.
    east, north = elementary.cos(path.heading_rad[0]), elementary.sin(path.heading_rad[0])
    near &= (position_m[:, 0] - here[0]) * east + (position_m[:, 1] - here[1]) * north > 0.5 * EGO_FRONT_M
    near &= (actors.speed_mps > _SLOWEST_MPS) & (np.abs(position_m[:, 2] - here[2]) < 3.0)
    index = np.flatnonzero(near)
    if len(index) == 0:
        return None
    x, y, heading = _future(actors, index)
    dx = x[..., None] - path.position_m[:, 0]
    dy = y[..., None] - path.position_m[:, 1]
    distance = dx * dx + dy * dy
    closest = np.argmin(distance, axis=-1)
    side = np.sqrt(np.take_along_axis(distance, closest[..., None], axis=-1)[..., 0])
    angle = wrap_angle(heading - path.heading_rad[closest])
    half = 0.5 * catalog.size_m[index].astype(np.float64)
    cos, sin = elementary.cos(angle), elementary.sin(angle)
    across = half[:, :1] * np.abs(sin) + half[:, 1:2] * np.abs(cos)
    along = half[:, :1] * np.abs(cos) + half[:, 1:2] * np.abs(sin)
    gap = closest - along - EGO_FRONT_M
    arrives_s = np.maximum(gap, 0.0) / max(speed_mps, 3.0)
    meets = side < across + 0.5 * EGO_SIZE_M[1] + _SIDE_M
    meets &= (np.abs(angle) < _ONCOMING_RAD) & (gap > 0.3) & (closest < len(path.heading_rad) - 1)
    meets &= (arrives_s > _AHEAD_S - _CLEAR_BEFORE_S) & (arrives_s < _AHEAD_S + _CLEAR_AFTER_S)
    if not meets.any():
        return None
    first = np.unravel_index(int(np.argmin(np.where(meets, gap, np.inf))), gap.shape)
    speed = float(actors.speed_mps[index[first[0]]]) * float(cos[first])
    return float(gap[first]), max(speed, 0.0)


def _future(actors: ActorFrame, index: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Positions x, y [m] and headings [rad] of actors at the times `_AHEAD_S`, each of shape (N, T)."""
    speed = actors.speed_mps[index].astype(np.float64)[:, None]
    heading = actors.heading_rad[index].astype(np.float64)[:, None]
    bend = elementary.tan(actors.steer_rad[index].astype(np.float64))[:, None] / _OTHERS_WHEELBASE_M
    distance = speed * _AHEAD_S
    half_turn = np.clip(0.5 * distance * bend, -0.8, 0.8)
    chord = distance * elementary.sinc(half_turn / np.pi)
    direction = heading + half_turn
    x = actors.position_m[index, 0].astype(np.float64)[:, None] + chord * elementary.cos(direction)
    y = actors.position_m[index, 1].astype(np.float64)[:, None] + chord * elementary.sin(direction)
    return x, y, heading + 2.0 * half_turn
