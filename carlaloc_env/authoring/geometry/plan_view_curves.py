"""Plan-view curves: lines, arcs, clothoids and cubics chained into paths of continuous heading."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from carlaloc_env.authoring.geometry.newton import solve

_NODES, _WEIGHTS = (tuple(float(v) for v in a) for a in np.polynomial.legendre.leggauss(16))
_SPIRAL_FRACTION = 0.18  # part of a corner's heading change that each of its two clothoids takes


@dataclass(frozen=True, slots=True)
class Pose:
    """A point of the plan [m] with a heading [rad, anticlockwise from east]."""

    x: float
    y: float
    h: float

    def ahead(self, u: float, v: float = 0.0) -> Pose:
        """Pose `u` metres further along the heading and `v` metres to the left, same heading."""
        c, s = math.cos(self.h), math.sin(self.h)
        return Pose(self.x + u * c - v * s, self.y + u * s + v * c, self.h)

    def turned(self) -> Pose:
        """The same place, looking back."""
        return Pose(self.x, self.y, wrap(self.h + math.pi))


@dataclass(frozen=True, slots=True)
class Piece:
    """One geometry record: curvature from `k0` to `k1` [1/m] over `length` [m], or a cubic."""

    length: float
    k0: float = 0.0
    k1: float = 0.0
    cubic: tuple[float, float, float, float, float, float] | None = None
    """bU, cU, dU, bV, cV, dV of a normalised parametric cubic."""

    @property
    def kind(self) -> str:
        """Element of OpenDRIVE that holds this piece."""
        if self.cubic is not None:
            return "paramPoly3"
        if abs(self.k1 - self.k0) > 1e-7:
            return "spiral"
        return "arc" if abs(self.k0) > 1e-7 else "line"

    def end(self, start: Pose) -> Pose:
        """Pose at the end of the piece."""
        return self.at(start, self.length)

    def at(self, start: Pose, s: float) -> Pose:
        """Pose `s` metres along a line, arc or clothoid (a cubic: at its end only)."""
        if self.cubic is not None:
            bu, cu, du, bv, cv, dv = self.cubic
            tip = start.ahead(bu + cu + du, bv + cv + dv)
            return Pose(tip.x, tip.y, start.h + math.atan2(bv + 2 * cv + 3 * dv, bu + 2 * cu + 3 * du))
        rate = (self.k1 - self.k0) / self.length
        panels = 1 + int(abs(max(abs(self.k0), abs(self.k1)) * s) / 0.7)
        u = v = 0.0
        half = 0.5 * s / panels
        for panel in range(panels):
            for node, weight in zip(_NODES, _WEIGHTS, strict=True):
                a = (2 * panel + 1 + node) * half
                theta = a * (self.k0 + 0.5 * rate * a)
                u += weight * half * math.cos(theta)
                v += weight * half * math.sin(theta)
        tip = start.ahead(u, v)
        return Pose(tip.x, tip.y, start.h + s * (self.k0 + 0.5 * rate * s))


@dataclass(frozen=True, slots=True)
class Path:
    """A start pose and the pieces that follow it."""

    start: Pose
    pieces: tuple[Piece, ...]

    @property
    def length(self) -> float:
        """Length in the plan [m]."""
        return math.fsum(p.length for p in self.pieces)

    @property
    def end(self) -> Pose:
        """Pose at the end."""
        return self.starts()[-1]

    def starts(self) -> list[Pose]:
        """Start pose of every piece, and the end pose."""
        poses = [self.start]
        for piece in self.pieces:
            poses.append(piece.end(poses[-1]))
        return poses

    def at(self, s: float) -> Pose:
        """Pose at `s` metres."""
        pose, rest = self.start, s
        for piece in self.pieces:
            if rest <= piece.length:
                return piece.at(pose, rest)
            pose, rest = piece.end(pose), rest - piece.length
        return pose

    def settled(self) -> Path:
        """Path of rounded numbers, so that what is computed from its length is the same on all machines."""
        start = Pose(round(self.start.x, 10), round(self.start.y, 10), round(self.start.h, 12))
        pieces = (Piece(round(p.length, 10), round(p.k0, 14), round(p.k1, 14), p.cubic) for p in self.pieces)
        return Path(start, tuple(pieces))


def tidy(pieces: Iterable[Piece]) -> tuple[Piece, ...]:
    """Pieces that have a length."""
    return tuple(p for p in pieces if p.length > 1e-6)


def curvature(path: Path, s: float) -> float:
    """Curvature [1/m] of lines, arcs and clothoids at `s` metres."""
    rest = s
    for piece in path.pieces:
        if rest <= piece.length + 1e-9:
            return piece.k0 + (piece.k1 - piece.k0) * min(rest / piece.length, 1.0)
        rest -= piece.length
    return path.pieces[-1].k1


def wrap(angle: float) -> float:
    """Angle in (−π, π]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)


def corner(delta: float, tangent_m: float, fraction: float) -> list[Piece]:
    """Clothoid, arc, clothoid that turn by `delta` within `tangent_m` of the corner on both sides."""
    sign = math.copysign(1.0, delta)
    spiral, arc = 2 * fraction * abs(delta), (1 - 2 * fraction) * abs(delta)
    unit = [Piece(spiral, 0.0, sign), Piece(arc, sign, sign), Piece(spiral, sign, 0.0)]
    tip = Path(Pose(0.0, 0.0, 0.0), tuple(unit)).end
    radius = tangent_m * math.sin(delta) / tip.y
    return [Piece(p.length * radius, p.k0 / radius, p.k1 / radius) for p in unit]


def curve_between(start: Pose, end: Pose) -> Path:
    """Curvature-continuous path between two straight ends; a G1 cubic where no such path fits."""
    delta = wrap(end.h - start.h)
    dx, dy = end.x - start.x, end.y - start.y
    u = dx * math.cos(start.h) + dy * math.sin(start.h)
    v = -dx * math.sin(start.h) + dy * math.cos(start.h)
    if abs(delta) < 1e-6:
        if u > 0 and abs(v) < 1e-6:
            return Path(start, (Piece(u),))
        return _shift(start, u, v)
    second = v / math.sin(delta)
    first = u - second * math.cos(delta)
    tangent = min(first, second)
    if tangent < 1.0:
        return Path(start, (_hermite(u, v, delta),))
    pieces = [Piece(first - tangent), *corner(delta, tangent, _SPIRAL_FRACTION), Piece(second - tangent)]
    return Path(start, tidy(pieces))


def _shift(start: Pose, u: float, v: float) -> Path:
    """Two opposite clothoid pairs: `u` metres ahead, `v` metres aside, same heading."""

    def chain(unknown: Sequence[float]) -> list[Piece]:
        length, k = unknown
        return [Piece(length, 0.0, k), Piece(length, k, 0.0), Piece(length, 0.0, -k), Piece(length, -k, 0.0)]

    def miss(unknown: Sequence[float]) -> list[float]:
        tip = Path(Pose(0.0, 0.0, 0.0), tuple(chain(unknown))).end
        return [tip.x - u, tip.y - v]

    return Path(start, tuple(chain(solve(miss, [u / 4, 8 * v / (u * u)]))))


def _hermite(u: float, v: float, delta: float) -> Piece:
    """Cubic through (0, 0, 0) and (u, v, delta); its length is integrated."""
    m = math.hypot(u, v) * (1 + delta * delta / 12)
    tu, tv = m * math.cos(delta), m * math.sin(delta)
    cubic = (m, 3 * u - 2 * m - tu, m + tu - 2 * u, 0.0, 3 * v - tv, tv - 2 * v)
    bu, cu, du, bv, cv, dv = cubic
    length = 0.0
    for panel in range(64):
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            p = (panel + 0.5 + 0.5 * node) / 64
            speed = math.hypot(bu + p * (2 * cu + 3 * du * p), bv + p * (2 * cv + 3 * dv * p))
            length += 0.5 * weight * speed / 64
    return Piece(length, cubic=cubic)


def turning_bulb(start: Pose, radius: float, flare_radius: float, spiral_m: float) -> Path:
    """Loop of a cul-de-sac: right-hand flare, left-hand circle, right-hand flare, back beside the start."""
    flare, turn = 1 / flare_radius, 1 / radius

    def half(unknown: Sequence[float]) -> list[Piece]:
        right, left = unknown
        return [
            Piece(spiral_m, 0.0, -flare),
            Piece(right, -flare, -flare),
            Piece(2 * spiral_m, -flare, turn),
            Piece(left, turn, turn),
        ]

    def miss(unknown: Sequence[float]) -> list[float]:
        tip = Path(Pose(0.0, 0.0, 0.0), tuple(half(unknown))).end
        return [tip.y, tip.h - math.pi / 2]

    first = half(solve(miss, [3.0, 2.0 * radius]))
    return Path(start, (*first, *(Piece(p.length, p.k1, p.k0) for p in reversed(first))))
