"""Narrow bends: where bodies swing into the next lane, the ego gives way to oncoming vehicles."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_SIZE_M
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.routing.route import RoutePose
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame

_RANGE_M = 45.0
"""Distance within which bends are looked for [m]."""
ONCOMING_RAD = 2.2
"""Vehicles at a greater angle to the route are oncoming [rad]."""
STANDING_MPS = 0.7
"""Slower vehicles stand [m/s]."""
_CORNER_M = 1.2
"""Bends count in which the front's outer corner is farther from the route [m]: a radius of 25 m at most."""
_SIDE_M = 0.1
"""Room between both vehicles [m]."""
_CUT_M = 0.35
"""How far inside of its line the ego may be in the other bends [m]."""
_TAIL = 0.087
"""A vehicle of length L, axles 0.55 L apart on an arc of radius R, swings its corners out by 0.087 L²/R."""
_PACE_MPS = (3.0, 5.0)
"""Speeds at which the ego drives through such bends, the least and the greatest [m/s]."""


def narrow_bend_m(
    path: RoutePose, ahead_m: Array, speed_mps: float, actors: ActorFrame, catalog: ActorCatalog
) -> float:
    """Way to the first bend in which the ego would touch an oncoming vehicle [m]; infinite if there is none.

    The ego's rear axle follows the route, and its outer front corner runs wider; so do the corners of long
    vehicles. Oncoming ones are taken to keep their speed and their distance from the route; one that
    stands beside the bend is let out of it, unless the ego stands, too: it may wait for the ego. A bend that
    the ego is in already is left.

    Args:
        path: The ego's route ahead at P places.
        ahead_m: Their distances from `base_link` [m], (P,).
        speed_mps: The ego's speed [m/s].
        actors: State of all N actors now.
        catalog: Their catalogue.
    """
    if len(ahead_m) < 3:
        return np.inf
    bend = np.gradient(np.unwrap(path.heading_rad), ahead_m)
    side = 1.0 / np.maximum(np.abs(bend), 1e-4) + 0.5 * EGO_SIZE_M[1]
    corner_m = np.sqrt(side * side + EGO_FRONT_M * EGO_FRONT_M) - side + 0.5 * EGO_SIZE_M[1]
    sharp = (corner_m > _CORNER_M) & (ahead_m < _RANGE_M)
    if not sharp.any():
        return np.inf
    index, closest, left_m = _oncoming(path, ahead_m, actors)
    half = 0.5 * catalog.size_m[index].astype(np.float64)
    # Towards the inside of a bend it is the other vehicle that swings out.
    inward = bend * left_m[:, None]
    tail_m = _TAIL * (2.0 * half[:, :1]) ** 2 * np.abs(bend) / np.maximum(1.0 - inward, 0.1)
    reach_m = np.where(inward < 0.0, corner_m, 0.5 * EGO_SIZE_M[1] + _CUT_M + tail_m)
    tight = sharp & (reach_m + half[:, 1:2] + _SIDE_M > np.abs(left_m[:, None]))
    first = np.argmax(tight, axis=1)
    last = np.argmin(tight | (np.arange(len(ahead_m)) < first[:, None]), axis=1) - 1
    # Times at which the ego's front is in the bend, and ways of the other vehicle to its two ends.
    pace = min(max(speed_mps, _PACE_MPS[0]), _PACE_MPS[1])
    enters_s, leaves_s = ahead_m[first] / pace, (ahead_m[last] + EGO_SIZE_M[0]) / pace
    apart_m = ahead_m[closest] - EGO_FRONT_M
    comes_m, goes_m = apart_m - half[:, 0] - ahead_m[last], apart_m + half[:, 0] - ahead_m[first]
    speed = actors.speed_mps[index]
    goes = (speed > STANDING_MPS) | (speed_mps > STANDING_MPS)
    meets = goes & (first > 0) & (goes_m > speed * enters_s) & (comes_m < speed * leaves_s)
    distance_m = ahead_m[first] - np.where(inward[np.arange(len(first)), first] < 0.0, 0.0, EGO_FRONT_M)
    return float(np.min(distance_m[meets & (distance_m > 0.0)], initial=np.inf))


def _oncoming(
    path: RoutePose, ahead_m: Array, actors: ActorFrame
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Oncoming road users: their rows, the nearest place of the path, and how far left of it they are [m]."""
    away = actors.position_m[:, :2].astype(np.float64) - path.position_m[0, :2]
    index = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) < ahead_m[-1])
    delta = actors.position_m[index, None].astype(np.float64) - path.position_m
    closest = np.argmin(delta[..., 0] ** 2 + delta[..., 1] ** 2, axis=1)
    delta, heading = delta[np.arange(len(index)), closest], path.heading_rad[closest]
    left_m = delta[:, 1] * elementary.cos(heading) - delta[:, 0] * elementary.sin(heading)
    angle = wrap_angle(actors.heading_rad[index].astype(np.float64) - heading)
    oncoming = (np.abs(angle) > ONCOMING_RAD) & (np.abs(delta[:, 2]) < 3.0)
    oncoming &= (closest > 0) & (closest < len(ahead_m) - 1)
    return index[oncoming], closest[oncoming], left_m[oncoming]
