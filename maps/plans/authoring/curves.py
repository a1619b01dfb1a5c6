"""Curves of plans, and operations on finished paths: cut, trim, shift aside, run backwards, turn round."""

import itertools
import math
from collections.abc import Sequence

from carlaloc_env.authoring.geometry.newton import PlanError, solve
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Piece, Pose, corner, tidy, wrap


def fillet(points: Sequence[tuple[float, float]], corners: Sequence[tuple[float, float]]) -> Path:
    """Polyline whose inner corners are rounded: `corners` holds (radius, clothoid length) [m] of each."""
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in itertools.pairwise(points)]
    reach = [0.0]
    bends: list[list[Piece]] = []
    for i, (radius, spiral) in enumerate(corners):
        delta = wrap(headings[i + 1] - headings[i])
        fraction = spiral / (2 * radius * abs(delta))
        unit = corner(delta, 1.0, fraction)
        scale = radius * abs(unit[1].k0)
        bends.append([Piece(p.length * scale, p.k0 / scale, p.k1 / scale) for p in unit])
        reach.append(scale)
    reach.append(0.0)
    pieces: list[Piece] = []
    for i, (a, b) in enumerate(itertools.pairwise(points)):
        straight = math.hypot(b[0] - a[0], b[1] - a[1]) - reach[i] - reach[i + 1]
        if straight < -1e-9:
            raise PlanError(f"the bends beside ({b[0]:.0f}, {b[1]:.0f}) overlap by {-straight:.1f} m")
        pieces.append(Piece(straight))
        pieces.extend(bends[i] if i < len(bends) else [])
    return Path(Pose(points[0][0], points[0][1], headings[0]), tidy(pieces))


def ring_entry(start: Pose, end: Pose, end_curvature: float, first_m: float, last_m: float) -> Path:
    """Straight, clothoid, right-hand arc, clothoid onto a ring that bends the other way."""

    def chain(unknown: Sequence[float]) -> list[Piece]:
        straight, k, arc = unknown
        return [
            Piece(straight),
            Piece(first_m, 0.0, -k),
            Piece(arc, -k, -k),
            Piece(last_m, -k, end_curvature),
        ]

    def miss(unknown: Sequence[float]) -> list[float]:
        tip = Path(start, tuple(chain(unknown))).end
        return [tip.x - end.x, tip.y - end.y, wrap(tip.h - end.h)]

    roots = solve(miss, [5.0, 0.05, 10.0])
    if min(roots) <= 0:
        raise PlanError(
            f"no ring entry: straight {roots[0]:.1f} m, curvature {roots[1]:.3f}, arc {roots[2]:.1f} m"
        )
    return Path(start, tuple(chain(roots)))


def trimmed(path: Path, first_m: float, last_m: float) -> Path:
    """Path without the first and last metres, which must lie on straights."""
    pieces = list(path.pieces)
    for index, cut_m in ((0, first_m), (-1, last_m)):
        if cut_m == 0.0:
            continue
        if pieces[index].kind != "line" or pieces[index].length < cut_m - 1e-9:
            raise PlanError(
                f"road near ({path.start.x:.0f}, {path.start.y:.0f}) has no {cut_m:.1f} m of straight "
                "at its end: move the node or take a smaller curve"
            )
        pieces[index] = Piece(pieces[index].length - cut_m)
    return Path(path.start.ahead(first_m), tidy(pieces))


def cut(path: Path, first_m: float, last_m: float, *, closed: bool = False) -> Path:
    """Part of a path between two stations; a closed path may be cut across its start.

    Args:
        path: Lines, arcs and clothoids.
        first_m: Where the part begins [m].
        last_m: Where it ends [m]; beyond the length of a closed path it goes round.
        closed: Whether the path ends where it begins.
    """
    length = path.length
    if closed and first_m >= length - 1e-6:
        return cut(path, first_m - length, last_m - length, closed=True)
    if closed and last_m > length + 1e-6:
        head, tail = cut(path, first_m, length), cut(path, 0.0, last_m - length)
        return Path(head.start, _joined(head.pieces, tail.pieces))
    if not -1e-6 <= first_m < last_m <= length + 1e-6:
        raise PlanError(f"a path of {length:.1f} m cannot be cut from {first_m:.1f} to {last_m:.1f} m")
    pieces: list[Piece] = []
    at = 0.0
    for piece in path.pieces:
        a, b = max(first_m - at, 0.0), min(last_m - at, piece.length)
        at += piece.length
        if b - a < 1e-6:
            continue
        if piece.cubic is not None:
            raise PlanError("a cubic cannot be cut; end the road elsewhere")
        rate = (piece.k1 - piece.k0) / piece.length
        pieces.append(Piece(b - a, piece.k0 + rate * a, piece.k0 + rate * b))
    return Path(path.at(max(first_m, 0.0)), tuple(pieces))


def _joined(head: tuple[Piece, ...], tail: tuple[Piece, ...]) -> tuple[Piece, ...]:
    """Both in a row; a straight or an arc that was cut in two is one again."""
    a, b = head[-1], tail[0]
    whole = a.kind == b.kind and a.kind in ("line", "arc") and abs(a.k1 - b.k0) < 1e-12
    return (*head[:-1], Piece(a.length + b.length, a.k0, b.k1), *tail[1:]) if whole else (*head, *tail)


def shifted(path: Path, right_m: float) -> Path:
    """Parallel path `right_m` metres to the right, of lines and arcs.

    Raises:
        PlanError: The path has clothoids, whose parallels are no clothoids.
    """
    if abs(right_m) < 1e-9:
        return path
    pieces = []
    for piece in path.pieces:
        if piece.kind not in ("line", "arc"):
            raise PlanError("only straights and arcs have parallels: move the gore off the transition curve")
        stretch = 1 + piece.k0 * right_m
        pieces.append(Piece(piece.length * stretch, piece.k0 / stretch, piece.k0 / stretch))
    return Path(path.start.ahead(0.0, -right_m), tuple(pieces))


def backwards(path: Path) -> Path:
    """The same path run from its end to its start."""
    pieces = (Piece(p.length, -p.k1, -p.k0) for p in reversed(path.pieces))
    return Path(path.end.turned(), tuple(pieces))


def u_turn(start: Pose, lateral_m: float, fraction: float = 0.1) -> Path:
    """Left-hand half circle with clothoids, which ends `lateral_m` metres to the left of its start."""
    spiral, arc = 2 * fraction * math.pi, (1 - 2 * fraction) * math.pi
    unit = (Piece(spiral, 0.0, 1.0), Piece(arc, 1.0, 1.0), Piece(spiral, 1.0, 0.0))
    radius = lateral_m / Path(Pose(0.0, 0.0, 0.0), unit).end.y
    pieces = (Piece(p.length * radius, p.k0 / radius, p.k1 / radius) for p in unit)
    return Path(start, tuple(pieces))


def meeting(a: Pose, b: Pose) -> tuple[float, float]:
    """Distances ahead of pose `a` and behind pose `b` at which their straight lines meet [m]."""
    delta = wrap(b.h - a.h)
    if abs(math.sin(delta)) < 1e-6:
        raise PlanError("two parallel straights do not meet: give the bend a distance")
    dx, dy = b.x - a.x, b.y - a.y
    u = dx * math.cos(a.h) + dy * math.sin(a.h)
    v = -dx * math.sin(a.h) + dy * math.cos(a.h)
    behind = v / math.sin(delta)
    return u - behind * math.cos(delta), behind


def mirrored(path: Path, axis: Pose) -> Path:
    """Path reflected in an axis and run the other way: an entry becomes the exit beside it."""
    end = path.end
    c, s = math.cos(2 * axis.h), math.sin(2 * axis.h)
    dx, dy = end.x - axis.x, end.y - axis.y
    start = Pose(axis.x + c * dx + s * dy, axis.y + s * dx - c * dy, wrap(2 * axis.h - end.h + math.pi))
    return Path(start, tuple(Piece(p.length, p.k1, p.k0) for p in reversed(path.pieces)))
