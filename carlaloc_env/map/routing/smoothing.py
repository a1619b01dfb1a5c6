"""From a path over lanes to one smooth line of points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.shortest_paths import LaneSpan

SAMPLE_M = 0.25
"""Spacing of the points."""
BLEND_M = 35.0
"""Length of a lane change; shorter where the lane is."""
_CLOSE_M = 0.1
_ASTRAY_RAD = 0.5


class RouteLine(NamedTuple):
    """Points along a route, each field (P, …)."""

    position_m: NDArray[np.float64]
    heading_rad: Array
    slope: Array
    """Rise per metre."""
    lane: Index
    station_m: Array

    def taking(self, rows: Index | slice) -> RouteLine:
        """Some of the points, in their new order."""
        return RouteLine._make(values[rows] for values in self)


def joined(parts: Sequence[RouteLine]) -> RouteLine:
    """One line of several, in their order."""
    return RouteLine._make(np.concatenate(values) for values in zip(*parts, strict=True))


class _Swerve(NamedTuple):
    """A lane change that may run on over neighbouring sections of its road."""

    pieces: list[_Piece]

    def room_m(self) -> float:
        """Length of way that it owns."""
        return sum(abs(p.to_s_m - p.from_s_m) for p in self.pieces)


class _Piece(NamedTuple):
    old: int
    new: int
    from_s_m: float
    to_s_m: float


def trace(network: LaneNetwork, spans: Sequence[LaneSpan]) -> RouteLine:
    """Points of all spans; where two spans meet, one point stands for both."""
    parts = [
        _trace_swerve(network, part) if isinstance(part, _Swerve) else _trace_span(network, part)
        for part in _with_room(network, spans)
    ]
    whole = joined(parts)
    line = whole.taking(_spaced(whole.position_m))
    return line._replace(heading_rad=_believable(line.position_m, line.heading_rad))


def _believable(position_m: NDArray[np.float64], heading_rad: Array) -> Array:
    """The lanes' headings, or where the line goes: very short lanes may halt and turn on the spot."""
    if len(position_m) < 3:
        return heading_rad
    step = np.gradient(position_m[:, :2], axis=0)
    course = elementary.arctan2(step[:, 1], step[:, 0])
    result: Array = np.where(np.abs(wrap_angle(course - heading_rad)) < _ASTRAY_RAD, heading_rad, course)
    return result


def _with_room(network: LaneNetwork, spans: Sequence[LaneSpan]) -> list[LaneSpan | _Swerve]:
    """Lets lane changes on short lanes begin in the section before, or end in the one after."""
    parts: list[LaneSpan | _Swerve] = []
    todo = list(spans)
    while todo:
        span = todo.pop(0)
        if len(span.lanes) != 2:
            parts.append(span)
            continue
        old, new = span.lanes
        begin, end = _s_at(network, old, span.from_fraction), _s_at(network, new, span.to_fraction)
        swerve = _Swerve([_Piece(old, new, begin, end)])
        while todo and swerve.room_m() < BLEND_M and (longer := _after(network, swerve, todo[0])):
            swerve.pieces.append(longer)
            todo[:1] = _rest(network, todo[0], longer, after=True)
        while parts and swerve.room_m() < BLEND_M and (longer := _before(network, swerve, parts[-1])):
            swerve.pieces.insert(0, longer)
            last = parts.pop()
            assert isinstance(last, LaneSpan)
            parts += _rest(network, last, longer, after=False)
        parts.append(swerve)
    return parts


def _after(network: LaneNetwork, swerve: _Swerve, span: LaneSpan) -> _Piece | None:
    """The start of the next span, beside the lane that follows the old one."""
    last, new = swerve.pieces[-1], span.lanes[0]
    record = network.lanes[new]
    beside = [n for n in network.lanes[last.old].successors if _alike(network, n, new)]
    if len(span.lanes) != 1 or not beside or new not in network.lanes[last.new].successors:
        return None
    begin, end = _s_at(network, new, span.from_fraction), _s_at(network, new, span.to_fraction)
    reach = min(BLEND_M - swerve.room_m(), abs(end - begin))
    end = begin + (reach if record.forward else -reach)
    return _Piece(beside[0], new, begin, end) if reach > 0.0 else None


def _before(network: LaneNetwork, swerve: _Swerve, span: LaneSpan | _Swerve) -> _Piece | None:
    """The end of the span before, beside the lane that leads to the new one."""
    if isinstance(span, _Swerve) or len(span.lanes) != 1:
        return None
    first, old = swerve.pieces[0], span.lanes[0]
    beside = [n for n in network.lanes[first.new].predecessors if _alike(network, n, old)]
    if not beside or old not in network.lanes[first.old].predecessors:
        return None
    begin, end = _s_at(network, old, span.from_fraction), _s_at(network, old, span.to_fraction)
    reach = min(BLEND_M - swerve.room_m(), abs(end - begin))
    forward = network.lanes[old].forward
    return _Piece(old, beside[0], end - (reach if forward else -reach), end) if reach > 0.0 else None


def _alike(network: LaneNetwork, a: int, b: int) -> bool:
    """True for two lanes of one lane section with the same travel direction."""
    p, q = network.lanes[a], network.lanes[b]
    return (p.road_id, p.section, p.forward) == (q.road_id, q.section, q.forward)


def _rest(network: LaneNetwork, span: LaneSpan, piece: _Piece, *, after: bool) -> list[LaneSpan]:
    """The rest of a span that a swerve grew into."""
    lane = span.lanes[0]
    cut = network.station_at(lane, piece.to_s_m if after else piece.from_s_m)
    fraction = cut / max(network.lanes[lane].length_m, 1e-9)
    low, high = (fraction, span.to_fraction) if after else (span.from_fraction, fraction)
    return [LaneSpan(span.lanes, low, high)] if high - low > 1e-9 else []


def _s_at(network: LaneNetwork, lane: int, fraction: float) -> float:
    return float(network.s_m([lane], [fraction * network.lanes[lane].length_m])[0])


def _spaced(position_m: NDArray[np.float64]) -> Index:
    """Rows that lie at least 0.1 m after the one kept before; the last row always stays."""
    keep = [0]
    for n in range(1, len(position_m)):
        dx, dy = position_m[n, :2] - position_m[keep[-1], :2]
        if dx * dx + dy * dy >= _CLOSE_M * _CLOSE_M:
            keep.append(n)
    if keep[-1] != len(position_m) - 1:
        if len(keep) > 1:
            keep.pop()
        keep.append(len(position_m) - 1)
    return np.array(keep, dtype=np.int64)


def _trace_span(network: LaneNetwork, span: LaneSpan) -> RouteLine:
    first, last = span.lanes[0], span.lanes[-1]
    begin = span.from_fraction * network.lanes[first].length_m
    end = span.to_fraction * network.lanes[last].length_m
    if len(span.lanes) == 1:
        count = max(2, int(np.ceil((end - begin) / SAMPLE_M)) + 1)
        lane = np.full(count, first)
        station = np.linspace(begin, end, count)
        return _lane_points(network, lane, network.s_m(lane, station), station)
    s0, s1 = network.s_m([first], [begin])[0], network.s_m([last], [end])[0]
    count = max(2, int(np.ceil(abs(s1 - s0) / SAMPLE_M)) + 1)
    s = np.linspace(s0, s1, count)
    changes = len(span.lanes) - 1
    # Each change owns an equal part of the way and sits in the middle of it.
    room = abs(s1 - s0) / changes
    half = 0.5 * min(BLEND_M, room) / room
    progress = np.linspace(0.0, float(changes), count)
    number = np.minimum(progress.astype(np.int64), changes - 1)
    tau = np.clip((progress - number - 0.5 + half) / (2.0 * half), 0.0, 1.0)
    lanes = np.array(span.lanes)
    return _blend(network, lanes[number], lanes[number + 1], s, tau, 2.0 * half * room)


def _trace_swerve(network: LaneNetwork, swerve: _Swerve) -> RouteLine:
    """One lane change over all of its pieces, in the middle of its way."""
    room = max(swerve.room_m(), 1e-6)
    old, new, s, driven_m = [], [], [], []
    done = 0.0
    for piece in swerve.pieces:
        length_of_piece = abs(piece.to_s_m - piece.from_s_m)
        count = max(2, int(np.ceil(length_of_piece / SAMPLE_M)) + 1)
        s.append(np.linspace(piece.from_s_m, piece.to_s_m, count))
        driven_m.append(np.linspace(done, done + length_of_piece, count))
        old.append(np.full(count, piece.old))
        new.append(np.full(count, piece.new))
        done += length_of_piece
    length = min(BLEND_M, room)
    tau = np.clip((np.concatenate(driven_m) - 0.5 * (room - length)) / length, 0.0, 1.0)
    return _blend(network, np.concatenate(old), np.concatenate(new), np.concatenate(s), tau, length)


def _lane_points(network: LaneNetwork, lane: Index, s: Array, station: Array) -> RouteLine:
    curve = network.surface.lane_centre(lane, s)
    back = np.where(network.forward[lane], 1.0, -1.0)
    heading = curve.heading_rad + np.where(network.forward[lane], 0.0, np.pi)
    return RouteLine(curve.position_m, heading, curve.slope * back, lane, station)


def _blend(network: LaneNetwork, old: Index, new: Index, s: Array, tau: Array, length_m: float) -> RouteLine:
    """From one lane to its neighbour by 10τ³ − 15τ⁴ + 6τ⁵, which starts and ends without a jerk."""
    a, b = network.surface.lane_centre(old, s), network.surface.lane_centre(new, s)
    fraction = tau * tau * tau * (10.0 - tau * (15.0 - 6.0 * tau))
    rate = 30.0 * tau * tau * (1.0 - tau) * (1.0 - tau) / length_m
    sign = np.where(network.forward[old], 1.0, -1.0)
    gap = b.position_m - a.position_m
    position = a.position_m + fraction[:, None] * gap
    from_a, to_b = (1.0 - fraction) * a.stretch, fraction * b.stretch
    x, y = (
        sign * (from_a * turn(a.heading_rad) + to_b * turn(b.heading_rad)) + rate * gap[:, k]
        for k, turn in enumerate((elementary.cos, elementary.sin))
    )
    climb = sign * (from_a * a.slope + to_b * b.slope) + rate * gap[:, 2]
    slope = climb / np.maximum(np.hypot(x, y), 1e-9)
    lane = np.where(fraction < 0.5, old, new)
    return RouteLine(position, elementary.arctan2(y, x), slope, lane, network.station_m(lane, s))
