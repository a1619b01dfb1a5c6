"""Operations on a finished path: cut it, shift it aside, run it backwards, turn round."""

import math

from carlaloc_env.authoring.geometry.newton import PlanError
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Piece, Pose, wrap


def curvature(path: Path, s: float) -> float:
    """Curvature [1/m] of lines, arcs and clothoids at `s` metres."""
    rest = s
    for piece in path.pieces:
        if rest <= piece.length + 1e-9:
            return piece.k0 + (piece.k1 - piece.k0) * min(rest / piece.length, 1.0)
        rest -= piece.length
    return path.pieces[-1].k1


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
