"""Lines of points as roads: straights joined by clothoids and arcs of a least radius."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import shapely

from carlaloc_env.authoring.geometry.plan_view_curves import Path, Piece, Pose, corner, wrap
from carlaloc_env.core.array_types import Array

SPIRAL = 0.22
"""Part of a bend's turn that each of its two clothoids takes."""
CURVED = 1.0 - SPIRAL
"""About the least radius of such a bend in that of an arc with the same tangents."""
OFF_M = 0.9
"""How far a bend may leave its corner aside where its least radius does not ask for more [m]."""
_LEAST_TURN = 1e-7
_SHARES = (0.08, 0.16, 0.25, 0.35, 0.5)
"""Where the two corners of a path between two poses are tried, in parts of their distance."""


def fit(line: Array, least_radius_m: float, *, tolerance_m: float = 0.25, fixed: int = 1) -> Path:
    """Path along a line of points (N, 2): it begins and ends straight, along the first and last points.

    Corners that are too sharp for their surroundings are left out until the least radius is kept, but for
    the `fixed` points at both ends.
    """
    last = len(line) - fixed + 1
    simple = shapely.simplify(shapely.LineString(line[fixed - 1 : last]), tolerance_m)
    inner = _apart([(float(x), float(y)) for x, y in shapely.get_coordinates(simple)])
    points = [*map(tuple, line[: fixed - 1].tolist()), *inner, *map(tuple, line[last:].tolist())]
    while True:
        tangents, worst = _tangents(points, least_radius_m)
        near = [k for k in (worst - 1, worst, worst + 1) if fixed <= k < len(points) - fixed] if worst else []
        if not near:
            return rounded(points, tangents)
        points.pop(_dearest(points, near))


def rounded(points: Sequence[tuple[float, float]], tangents: Sequence[float]) -> Path:
    """Polyline whose inner corners are rounded within these tangents [m]."""
    headings = _headings(points)
    pieces: list[Piece] = []
    used = [0.0, *tangents, 0.0]
    for i in range(len(points) - 1):
        straight = math.dist(points[i], points[i + 1]) - used[i] - used[i + 1]
        if straight > 1e-6:
            pieces.append(Piece(straight))
        if i + 2 < len(points):
            turn = wrap(headings[i + 1] - headings[i])
            if abs(turn) > _LEAST_TURN:
                pieces += corner(turn, tangents[i], SPIRAL)
            elif tangents[i] > 0:
                pieces.append(Piece(2 * tangents[i]))
    return Path(Pose(*points[0], headings[0]), tuple(pieces))


def _headings(points: Sequence[tuple[float, float]]) -> list[float]:
    return [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in itertools.pairwise(points)]


def _apart(points: Sequence[tuple[float, float]], least_m: float = 1.0) -> list[tuple[float, float]]:
    kept = [points[0]]
    for point in points[1:-1]:
        if math.dist(point, kept[-1]) > least_m and math.dist(point, points[-1]) > least_m:
            kept.append(point)
    return [*kept, points[-1]]


def _tangents(points: Sequence[tuple[float, float]], least_radius_m: float) -> tuple[list[float], int | None]:
    """Tangent of every inner corner [m]; and the corner whose radius stays below the least by most."""
    headings, worst, gap = _headings(points), None, 0.0
    tangents = []
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    turns = [abs(wrap(b - a)) for a, b in itertools.pairwise(headings)]
    need = [least_radius_m / CURVED * math.tan(min(turn, 3.0) / 2) for turn in turns]
    for i, turn in enumerate(turns):
        before = lengths[i] - 0.5 if i == 0 else _share(lengths[i], need[i], need[i - 1])
        after = lengths[i + 1] - 0.5 if i + 1 == len(turns) else _share(lengths[i + 1], need[i], need[i + 1])
        room = min(before, after)
        if turn < _LEAST_TURN:
            tangents.append(0.0)
            continue
        # Wide bends are drawn by many corners: a bend that stays near its own is as wide as the street.
        wanted = max(need[i], OFF_M / math.tan(turn / 4))
        tangents.append(min(room, wanted))
        if need[i] - room > gap + 1e-9:
            worst, gap = i + 1, need[i] - room
    return tangents, worst


def _share(length: float, own: float, other: float) -> float:
    """Part of a straight between two corners that one of them may take [m]."""
    half = length / 2
    if own <= half and other <= half:
        return half
    spare = length - own - other
    return own + spare / 2 if spare > 0 else length * own / (own + other)


def _dearest(points: Sequence[tuple[float, float]], near: Sequence[int]) -> int:
    """The corner of some without which the line changes least."""

    def area(k: int) -> float:
        (x0, y0), (x1, y1), (x2, y2) = points[k - 1 : k + 2]
        return abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))

    return min(near, key=lambda k: (area(k), k))


def between(start: Pose, end: Pose, via: Array | None = None) -> Path:
    """The widest path from one pose to another, straight at both ends.

    Args:
        start: Where it begins.
        end: Where it ends.
        via: Points (N, 2) that it follows; None: as directly as it can.
    """
    first, last = (start.x, start.y), (end.x, end.y)
    if via is None:
        reach = math.dist(first, last)
        ahead = (end.x - start.x) * math.cos(start.h) + (end.y - start.y) * math.sin(start.h)
        if abs(wrap(end.h - start.h)) < 1e-9 and abs(_aside(start, end)) < 1e-9 and ahead > 0.0:
            return Path(start, (Piece(reach),))
        meeting = _meeting(start, end)
        corners = [[first, meeting, last]] if meeting is not None else []
        for a in _SHARES:
            for b in _SHARES:
                p, q = start.ahead(a * reach), end.ahead(-b * reach)
                if math.dist((p.x, p.y), (q.x, q.y)) > 0.2 * reach:
                    corners.append([first, (p.x, p.y), (q.x, q.y), last])
        return rounded(*max(map(_widest, corners), key=_goodness)[:2])
    options: list[tuple[float, Path]] = []
    for trim, lead in itertools.product((0.0, 6.0, 12.0), (2.0, 4.0, 7.0)):
        p, q = start.ahead(lead), end.ahead(-lead)
        far = np.minimum(np.hypot(*(via - first).T), np.hypot(*(via - last).T))
        line = np.array([first, (p.x, p.y), *via[far >= trim + lead], (q.x, q.y), last])
        path = fit(line, 9.0, tolerance_m=0.8, fixed=2)
        options.append((round(min(radius(path), 20.0), 3), path))
        if lead == 7.0 and max(wide for wide, _ in options) >= 8.5:
            break
    return max(options, key=lambda option: option[0])[1]


def _aside(start: Pose, end: Pose) -> float:
    return -(end.x - start.x) * math.sin(start.h) + (end.y - start.y) * math.cos(start.h)


def _meeting(start: Pose, end: Pose) -> tuple[float, float] | None:
    """Where the lines ahead of one pose and behind another meet, if they do."""
    turn = wrap(end.h - start.h)
    if abs(math.sin(turn)) < 1e-3:
        return None
    behind = _aside(start, end) / math.sin(turn)
    u = (end.x - start.x) * math.cos(start.h) + (end.y - start.y) * math.sin(start.h)
    ahead = u - behind * math.cos(turn)
    if min(ahead, behind) < 0.3:
        return None
    point = start.ahead(ahead)
    return point.x, point.y


def _widest(
    points: list[tuple[float, float]],
) -> tuple[list[tuple[float, float]], list[float], float]:
    """A line of three or four points, the longest tangents of its corners, and about their radius [m]."""
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    headings = _headings(points)
    tans = [math.tan(min(abs(wrap(b - a)), 3.1) / 2) + 1e-9 for a, b in itertools.pairwise(headings)]
    if len(tans) == 1:
        return points, [min(lengths)], min(lengths) / tans[0]
    # The middle straight is shared so that both bends have the same radius.
    scale = min(lengths[0] / tans[0], lengths[2] / tans[1], lengths[1] / sum(tans))
    return points, [scale * tan for tan in tans], scale


def _goodness(option: tuple[list[tuple[float, float]], list[float], float]) -> float:
    """Wide first, then short."""
    points, _, radius_m = option
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
    return round(min(radius_m, 60.0), 3) - 0.3 * length


def radius(path: Path) -> float:
    """Least radius of a path [m]."""
    return 1.0 / max(*curvatures(path), 1e-9)


def curvatures(path: Path) -> tuple[float, float]:
    """Largest curvature to the left and to the right [1/m], both positive."""
    ends = [k for piece in path.pieces for k in (piece.k0, piece.k1)]
    return max([0.0, *ends]), max([0.0, *(-k for k in ends)])


def sampled(path: Path, step_m: float) -> Array:
    """Points (N, 2) of a path [m]."""
    poses = []
    for pose, piece in zip(path.starts(), path.pieces, strict=False):
        count = max(1, math.ceil(piece.length / step_m)) if piece.kind != "line" else 1
        poses += [piece.at(pose, piece.length * k / count) for k in range(count)]
    poses.append(path.end)
    return np.array([(p.x, p.y) for p in poses])
