"""Turns tighter than a car can drive along the lane's middle: lines on which all of it stays off the kerbs.

Where a lane bends tighter than a car's rear axle can follow, or a wheel would climb a kerb, drivers swing
out before the turn, use the room of the junction, and come back to the middle behind it. Of a family of such
lines, cubic curves between two places aside of the lane's middle, the one is taken that suits the car best.
"""

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import distance_along, interpolated
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.driving_line import inside_line
from carlaloc_env.map.routing.smoothing import SAMPLE_M, RouteLine, joined
from carlaloc_env.scenery.kerbs.swept_path import cost_of, kerb_room, room_about

TIGHT_M = 6.2
"""Turns of a smaller radius, as a mean over `WINDOW_M`, are looked at [m]."""
KINK_M = 5.5
"""So are kinks of a smaller radius as a mean over half of it [m]."""
WINDOW_M = 4.0
"""Length over which a bend is measured [m]."""
STEEP_M = 4.6
"""Turns of a smaller radius are fitted even where there is no kerb [m]."""
LEAST_ROOM_M = 0.12
"""So are those in which wheels would come closer to a kerb [m]."""
LEAD_M = 12.0
"""How far before and behind a turn the line may leave the lane's middle [m]."""
_BEGINS_M = (-1.0, 1.0, 3.0, 5.0)
_LATERALS_M = (-0.3, 0.0, 0.4, 1.0)
_HANDLES = (0.36, 0.46)
_MERGE_M = 4.0
"""Turns closer together than this are driven as one [m]."""
_REFINED = 4
_TRIALS = 150

_Shape = tuple[float, float, float, float, float, float]
"""How far before and behind the turn a cubic reaches, how far aside its ends lie [m], their handles."""


class _Turn(NamedTuple):
    """Rows of a line: where it may leave the middle, where the turn begins and ends, where it is back."""

    start: int
    first: int
    last: int
    end: int


def fit_turns(network: LaneNetwork, line: RouteLine) -> tuple[RouteLine, NDArray[np.bool_]]:
    """The line with its tight turns fitted to a car, and which of its points (P,) were."""
    parts: list[RouteLine] = []
    fitted: list[NDArray[np.bool_]] = []
    done = 0
    for turn in _tight_turns(line):
        piece = _fit(network, line, turn)
        if piece is None:
            continue
        parts += [line.taking(slice(done, turn.start)), piece]
        fitted += [np.zeros(turn.start - done, dtype=bool), np.ones(len(piece.lane), dtype=bool)]
        done = turn.end + 1
    parts.append(line.taking(slice(done, None)))
    fitted.append(np.zeros(len(line.lane) - done, dtype=bool))
    return joined(parts), np.concatenate(fitted)


def _tight_turns(line: RouteLine) -> list[_Turn]:
    """Turns that may be too tight, none of them reaching into its neighbours."""
    s = distance_along(line.position_m)
    heading = np.unwrap(line.heading_rad)
    sharp = (_bend(s, heading, WINDOW_M) > 1.0 / TIGHT_M) | (_bend(s, heading, 0.5 * WINDOW_M) > 1.0 / KINK_M)
    tight = np.flatnonzero(sharp)
    if not len(tight):
        return []
    apart = np.flatnonzero(np.diff(s[tight]) > _MERGE_M)
    runs = [(int(run[0]), int(run[-1])) for run in np.split(tight, apart + 1)]
    turns = []
    for k, (first, last) in enumerate(runs):
        low = 0.5 * (s[runs[k - 1][1]] + s[first]) if k else s[0]
        high = 0.5 * (s[last] + s[runs[k + 1][0]]) if k + 1 < len(runs) else s[-1]
        start = int(np.searchsorted(s, max(low, s[first] - LEAD_M)))
        end = int(np.searchsorted(s, min(high, s[last] + LEAD_M))) - 1
        if start < first and last < end:
            turns.append(_Turn(start, first, last, end))
    return turns


def _bend(s: Array, heading: Array, window_m: float) -> Array:
    """Curvature as a mean over a window [1/m], without its sign."""
    ahead, behind = (np.interp(s + side * window_m, s, heading) for side in (0.5, -0.5))
    result: Array = np.abs(ahead - behind) / window_m
    return result


def _fit(network: LaneNetwork, line: RouteLine, turn: _Turn) -> RouteLine | None:
    """The best line through a turn, None where the driver's own way needs no better."""
    piece = line.taking(slice(turn.start, turn.end + 1))
    xy, heading = piece.position_m[:, :2], np.unwrap(piece.heading_rad)
    s = distance_along(xy)
    room = room_about(network, piece)
    _, used_m, used_rad = inside_line(s, xy, heading)
    steep = _bend(s, heading, WINDOW_M).max() > 1.0 / STEEP_M
    if not steep and kerb_room(used_m, used_rad, room)[0].min() > LEAST_ROOM_M:
        return None
    begins, ends = s[turn.first - turn.start], s[turn.last - turn.start]
    outward = -float(np.sign(heading[-1] - heading[0]))

    def path(shape: _Shape) -> tuple[Array, Array] | None:
        a, b = begins - shape[0], ends + shape[1]
        if a < 0.2 or b > s[-1] - 0.2 or b - a < 2.0 or min(shape[4:]) < 0.2 or max(shape[4:]) > 0.8:
            return None
        aside = (outward * shape[2], outward * shape[3])
        return _candidate(s, xy, heading, (a, b), aside, (shape[4], shape[5]))

    def cost(shape: _Shape) -> float:
        candidate = path(shape)
        return (
            1e3 if candidate is None else cost_of(*candidate, room) + 0.02 * (abs(shape[2]) + abs(shape[3]))
        )

    grid = itertools.product(_BEGINS_M, _BEGINS_M, _LATERALS_M, _HANDLES)
    shapes: list[_Shape] = [(before, behind, x, x, handle, handle) for before, behind, x, handle in grid]
    shapes = sorted(shapes, key=cost)[:_REFINED]
    best = min((_refined(cost, shape) for shape in shapes), key=cost)
    candidate = path(best)
    if candidate is None or cost(best) >= cost_of(used_m, used_rad, room):
        return None
    return _as_line(piece, *candidate)


def _refined(cost: Callable[[_Shape], float], shape: _Shape) -> _Shape:
    """A shape near by that costs less: Nelder and Mead's search."""
    # Here, since scipy.optimize takes a tenth of a second to import, and most routes have no tight turn.
    from scipy.optimize import minimize

    steps = np.vstack([np.zeros(6), np.diag([1.0, 1.0, 0.3, 0.3, 0.06, 0.06])])
    options: Any = {"maxfev": _TRIALS, "initial_simplex": np.array(shape) + steps}

    def at(x: Array) -> float:
        return cost((x[0], x[1], x[2], x[3], x[4], x[5]))

    result = minimize(at, np.array(shape), method="Nelder-Mead", options=options)
    a, b, c, d, e, f = (float(value) for value in result.x)
    return a, b, c, d, e, f


def _candidate(
    s: Array,
    xy: Array,
    heading: Array,
    span: tuple[float, float],
    lateral_m: tuple[float, float],
    handles: tuple[float, float],
) -> tuple[Array, Array]:
    """Points (N, 2) and headings of one line: aside of the middle up to the turn, a cubic, and back."""
    a, b = span
    count = max(2, round(a / SAMPLE_M))
    lead, into = _beside(s, xy, heading, np.linspace(0.0, a, count + 1), lateral_m[0], rising=True)
    count = max(2, round((s[-1] - b) / SAMPLE_M))
    tail, out = _beside(s, xy, heading, np.linspace(b, s[-1], count + 1), lateral_m[1], rising=False)
    reach = float(np.hypot(*(tail[0] - lead[-1])))
    p1 = lead[-1] + handles[0] * reach * np.array([elementary.cos(into), elementary.sin(into)])
    p2 = tail[0] - handles[1] * reach * np.array([elementary.cos(out), elementary.sin(out)])
    f = np.linspace(0.0, 1.0, max(4, round((b - a) / SAMPLE_M)) + 1)[:, None]
    g = 1.0 - f
    curve = g * g * g * lead[-1] + 3 * g * g * f * p1 + 3 * g * f * f * p2 + f * f * f * tail[0]
    path = np.concatenate([lead[:-1], curve, tail[1:]])
    step = np.gradient(path, axis=0)
    turned = np.unwrap(elementary.arctan2(step[:, 1], step[:, 0]))
    turned += 2 * np.pi * np.round((heading[0] - turned[0]) / (2 * np.pi))
    turned[0], turned[-1] = heading[0], heading[-1]
    return path, turned


def _beside(
    s: Array, xy: Array, heading: Array, at: Array, lateral_m: float, *, rising: bool
) -> tuple[Array, float]:
    """Points up to `lateral_m` to the left of the middle, and the middle's heading where it is all."""
    share = (at - at[0]) / (at[-1] - at[0])
    share = share if rising else 1.0 - share
    off = lateral_m * share * share * share * (10.0 - share * (15.0 - 6.0 * share))
    h = np.interp(at, s, heading)
    points = interpolated(at, s, xy)
    points += off[:, None] * np.stack([-elementary.sin(h), elementary.cos(h)], axis=-1)
    return points, float(h[-1] if rising else h[0])


def _as_line(middle: RouteLine, xy: Array, heading: Array) -> RouteLine:
    """Points of a fitted line with heights, lanes and stations of the middle beside them."""
    nearest = np.asarray(cKDTree(middle.position_m[:, :2]).query(xy)[1])
    nearest[0], nearest[-1] = 0, len(middle.lane) - 1
    row = np.maximum.accumulate(nearest)
    position = np.column_stack([xy, middle.position_m[row, 2]])
    return RouteLine(position, heading, middle.slope[row], middle.lane[row], middle.station_m[row])
