"""Vehicles about to come into the ego's path (roundabouts, crossing, merging), or standing in it."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.driving.narrow_bends import ONCOMING_RAD, STANDING_MPS
from carlaloc_env.map.routing.route import Route, RoutePose
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame

_RANGE_M = 45.0
"""Distance along the route within which crossing vehicles are looked for [m]."""
_AHEAD_S = np.array([0.4, 0.8, 1.2, 1.6, 2.0, 2.5, 3.0, 3.5])
"""Times ahead at which their positions are predicted [s], (T,)."""
_OTHERS_WHEELBASE_M = 2.8
"""Wheelbase that the ego takes every other vehicle to have [m]: that of a saloon."""
_SLOW_MPS, _FASTER_MPS, _ASIDE_RAD = 5.0, 5.0, 0.6
"""A slower ego [m/s] waits for vehicles that merge so much faster [m/s], from such an angle or more [rad]."""
_SIDE_M = 0.35
"""Room beside both vehicles [m]."""
LEADER_SIDE_M = 0.25
"""Room beside the ego within which a vehicle ahead is in its path [m]."""
_DEEPER_M = 0.05
"""How much farther the ego would drive into a vehicle within a metre that is in its way already [m]."""
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
    near &= (actors.speed_mps > STANDING_MPS) & (np.abs(position_m[:, 2] - here[2]) < 3.0)
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
    meets &= (np.abs(angle) < ONCOMING_RAD) & (gap > 0.3) & (closest < len(path.heading_rad) - 1)
    meets &= (arrives_s > _AHEAD_S - _CLEAR_BEFORE_S) & (arrives_s < _AHEAD_S + _CLEAR_AFTER_S)
    if not meets.any():
        return None
    first = np.unravel_index(int(np.argmin(np.where(meets, gap, np.inf))), gap.shape)
    other = index[first[0]]
    speed = float(actors.speed_mps[other]) * float(cos[first])
    aside = abs(float(wrap_angle(actors.heading_rad[other] - path.heading_rad[0]))) > _ASIDE_RAD
    if aside and speed_mps < _SLOW_MPS and speed > speed_mps + _FASTER_MPS:
        # It would run into an ego that starts before it: the ego waits where they meet.
        speed = 0.0
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


def standing_gap_m(path: RoutePose, ahead_m: Array, actors: ActorFrame, catalog: ActorCatalog) -> float:
    """Way that the ego can drive before its body would touch a vehicle that stands [m]; infinite if none.

    In bends the ego's front swings out farther than the width of its path: the boxes are compared.

    Args:
        path: The ego's route ahead at P places.
        ahead_m: Their distances from `base_link` [m], (P,).
        actors: State of all N actors now.
        catalog: Their catalogue.
    """
    position_m = actors.position_m.astype(np.float64)
    reach_m = ahead_m[-1] + 10.0
    away = position_m - path.position_m[0]
    index = np.flatnonzero((actors.speed_mps <= STANDING_MPS) & (np.hypot(away[:, 0], away[:, 1]) < reach_m))
    if len(index) == 0:
        return np.inf
    heading = path.heading_rad
    east, north = elementary.cos(heading), elementary.sin(heading)
    centre_m = 0.5 * (EGO_FRONT_M + EGO_REAR_M)
    delta = position_m[index, None, :] - path.position_m
    dx, dy = delta[..., 0] - centre_m * east, delta[..., 1] - centre_m * north
    theirs = actors.heading_rad[index].astype(np.float64)[:, None]
    their_east, their_north = elementary.cos(theirs), elementary.sin(theirs)
    half = 0.5 * catalog.size_m[index].astype(np.float64)
    length, width = half[:, :1], half[:, 1:2]
    ego_length, ego_width = 0.5 * EGO_SIZE_M[0], 0.5 * EGO_SIZE_M[1] + LEADER_SIDE_M
    cos = np.abs(east * their_east + north * their_north)
    sin = np.abs(east * their_north - north * their_east)
    # Boxes are apart where one of their four axes separates them.
    apart = np.maximum.reduce(
        [
            np.abs(dx * east + dy * north) - ego_length - length * cos - width * sin,
            np.abs(dy * east - dx * north) - ego_width - length * sin - width * cos,
            np.abs(dx * their_east + dy * their_north) - length - ego_length * cos - ego_width * sin,
            np.abs(dy * their_east - dx * their_north) - width - ego_length * sin - ego_width * cos,
        ]
    )
    apart = np.where(np.abs(delta[..., 2]) < 3.0, apart, reach_m)
    meets = apart <= 0.0
    # Vehicles beside the ego are passed, those into which it would drive farther are not.
    if (meets[:, 0] & (apart[:, 1:2].min(axis=1, initial=np.inf) < apart[:, 0] - _DEEPER_M)).any():
        return 0.0
    row = np.argmax(meets & ~meets[:, :1], axis=1)
    meeting = np.flatnonzero(row)
    if len(meeting) == 0:
        return np.inf
    row = row[meeting]
    before, after = apart[meeting, row - 1], apart[meeting, row]
    share = before / (before - after)
    return float(np.min(ahead_m[row - 1] + share * (ahead_m[row] - ahead_m[row - 1])))
