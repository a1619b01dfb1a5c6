"""Reference lines of all roads: position, heading and curvature for arrays of (road, s)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.map.opendrive.cubic_table import last_at_or_before
from carlaloc_env.map.opendrive.records import GEOMETRY_KINDS, Geometry, Road


def _mirrored(*positive: tuple[float, float]) -> list[tuple[float, float]]:
    return [*((-node, weight) for node, weight in reversed(positive)), *positive]


# Written out: the last digit of NumPy's `leggauss` depends on its version and on the processor.
_QUADRATURE = _mirrored(
    (0.14887433898163122, 0.2955242247147528),
    (0.4333953941292472, 0.2692667193099965),
    (0.6794095682990244, 0.219086362515982),
    (0.8650633666889845, 0.1494513491505804),
    (0.9739065285171717, 0.06667134430868814),
)
"""Nodes in [−1, 1] and weights of Gauss and Legendre's rule of 10 points."""
_FEW_QUADRATURE = _mirrored(
    (0.18343464249564978, 0.36268378337836166),
    (0.525532409916329, 0.3137066458778869),
    (0.7966664774136267, 0.22238103445337443),
    (0.9602898564975362, 0.10122853629037706),
)
"""The same of 8 points."""


class LinePose(NamedTuple):
    """Points of reference lines in the world frame, each field (M,)."""

    x_m: Array
    y_m: Array
    heading_rad: Array
    """Anticlockwise from east; not wrapped."""
    curvature_radpm: Array
    curvature_slope: Array
    """Derivative of curvature by arc length [1/m²]."""
    rate: Array
    """Metres of arc per metre of s: 1 but for a paramPoly3 whose stated length is not its own."""

    def beside(self, t_m: Array) -> tuple[Array, Array]:
        """Points x, y to the left of these [m], each (M,)."""
        x = self.x_m - elementary.sin(self.heading_rad) * t_m
        return x, self.y_m + elementary.cos(self.heading_rad) * t_m


class PlanView:
    """The `<planView>` of all roads as one table."""

    def __init__(self, roads: Sequence[Road]) -> None:
        """Concatenates all geometries and tabulates the arc length of the polynomial ones."""
        pieces = [g for road in roads for g in road.geometry]
        counts = np.array([len(road.geometry) for road in roads], dtype=np.int64)
        self.first: Index = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
        self.count: Index = counts
        rows = np.array(
            [
                (
                    g.s_m,
                    g.x_m,
                    g.y_m,
                    g.heading_rad,
                    g.length_m,
                    g.curvature_start_radpm,
                    g.curvature_end_radpm,
                )
                for g in pieces
            ],
            dtype=np.float64,
        ).reshape(-1, 7)
        self._s, self._x, self._y, self._h, self._l, self._k0, self._k1 = np.ascontiguousarray(rows.T)
        self._kind: NDArray[np.int8] = np.array([GEOMETRY_KINDS.index(g.kind) for g in pieces], dtype=np.int8)
        self._curves = PolynomialCurves(pieces)

    def evaluate(self, road: Index, s_m: Array) -> LinePose:
        """Points of reference lines.

        Beyond the end of its piece a line goes straight on.

        Args:
            road: Road numbers, (M,).
            s_m: Arc length in the plane from each road's start [m], (M,).
        """
        row = last_at_or_before(self.first[road], self.count[road], self._s, s_m)
        ds = s_m - self._s[row]
        length = self._l[row]
        inside = np.clip(ds, 0.0, length)
        u, v, turn, k, slope = self._local(row, inside)
        rest = ds - inside
        u += rest * elementary.cos(turn)
        v += rest * elementary.sin(turn)
        rate = self._curves.rate(row)
        straight = rest != 0.0
        k[straight], slope[straight], rate[straight] = 0.0, 0.0, 1.0
        c, s = elementary.cos(self._h[row]), elementary.sin(self._h[row])
        x = self._x[row] + c * u - s * v
        y = self._y[row] + s * u + c * v
        return LinePose(x, y, self._h[row] + turn, k, slope, rate)

    def _local(self, row: Index, ds: Array) -> tuple[Array, Array, Array, Array, Array]:
        u, v, turn = ds.copy(), np.zeros(len(ds)), np.zeros(len(ds))
        k, slope = np.zeros(len(ds)), np.zeros(len(ds))
        kind = self._kind[row]
        arc = np.flatnonzero(kind == 1)
        if len(arc):
            curvature, l_arc = self._k0[row[arc]], ds[arc]
            half = 0.5 * curvature * l_arc
            # sin(x)/x keeps the arc exact as its curvature goes to zero.
            chord = l_arc * elementary.sinc(half / np.pi)
            u[arc], v[arc] = chord * elementary.cos(half), chord * elementary.sin(half)
            turn[arc], k[arc] = 2.0 * half, curvature
        spiral = np.flatnonzero(kind == 2)
        if len(spiral):
            r = row[spiral]
            rate = (self._k1[r] - self._k0[r]) / np.maximum(self._l[r], 1e-12)
            u[spiral], v[spiral], turn[spiral] = clothoid(self._k0[r], rate, ds[spiral])
            k[spiral], slope[spiral] = self._k0[r] + rate * ds[spiral], rate
        poly = np.flatnonzero(kind >= 3)
        if len(poly):
            u[poly], v[poly], turn[poly], k[poly], slope[poly] = self._curves.evaluate(row[poly], ds[poly])
        return u, v, turn, k, slope


def clothoid(curvature_radpm: Array, rate: Array, length_m: Array) -> tuple[Array, Array, Array]:
    """End point (u, v) [m] and turn [rad] of clothoids from their start, each (M,).

    Integrates (cos θ, sin θ), θ = κ₀l + c·l²/2, by Gauss–Legendre with 10 points per radian, which
    leaves less than 1e-15 of the length as error.

    Args:
        curvature_radpm: Curvature at the start κ₀ [1/m].
        rate: Change of curvature c [1/m²].
        length_m: Arc length l [m].
    """
    turn = length_m * (curvature_radpm + 0.5 * rate * length_m)
    top = np.maximum(np.abs(curvature_radpm), np.abs(curvature_radpm + rate * length_m))
    pieces = np.maximum(np.ceil(top * length_m), 1.0).astype(np.int64)
    u, v = np.zeros(len(length_m)), np.zeros(len(length_m))
    step = length_m / pieces
    for n in range(int(pieces.max(initial=0))):
        own = np.flatnonzero(pieces > n)
        k, c, h = curvature_radpm[own], rate[own], step[own]
        for node, weight in _QUADRATURE:
            at = (n + 0.5 * (node + 1.0)) * h
            theta = at * (k + 0.5 * c * at)
            u[own] += weight * elementary.cos(theta)
            v[own] += weight * elementary.sin(theta)
    half = 0.5 * step
    return u * half, v * half, turn


class PolynomialCurves:
    """poly3 and paramPoly3 pieces with p tabulated over arc length."""

    def __init__(self, pieces: Sequence[Geometry]) -> None:
        """Tabulates every polynomial piece of the map."""
        numbers = [n for n, g in enumerate(pieces) if g.kind in ("poly3", "paramPoly3")]
        self._slot = np.full(len(pieces), -1, dtype=np.int64)
        self._slot[numbers] = np.arange(len(numbers))
        curves = [pieces[n] for n in numbers]
        self._u = np.array([g.u_poly for g in curves], dtype=np.float64).reshape(-1, 4).T
        self._v = np.array([g.v_poly for g in curves], dtype=np.float64).reshape(-1, 4).T
        length = np.array([g.length_m for g in curves], dtype=np.float64)
        counts = np.array(
            [int(np.clip(16.0 + 2.0 * g.length_m, 16.0, 512.0)) for g in curves], dtype=np.int64
        )
        self._first = np.concatenate([[0], np.cumsum(counts + 1)[:-1]]).astype(np.int64)
        self._count = counts + 1
        owner = np.repeat(np.arange(len(curves)), counts + 1)
        fraction = (np.arange(len(owner)) - self._first[owner]) / counts[owner] if len(owner) else np.zeros(0)
        self._p: Array = fraction * np.array([g.p_max for g in curves], dtype=np.float64)[owner]
        step = np.diff(self._p, append=0.0)
        last = np.zeros(len(owner), dtype=bool)
        last[self._first + counts] = True
        grown = np.where(last, 0.0, self._arc(owner, self._p, np.where(last, 0.0, step)))
        total = np.cumsum(grown) - grown
        self._arc_m: Array = total - total[self._first[owner]] if len(owner) else total
        whole = self._arc_m[self._first + counts] if len(curves) else np.zeros(0)
        # paramPoly3 fills its stated length whatever its true one; poly3 runs by true arc length.
        scaled = np.array([g.kind == "paramPoly3" for g in curves], dtype=bool)
        self._scale = np.where(scaled & (length > 0.0), whole / np.where(length > 0.0, length, 1.0), 1.0)

    def rate(self, piece: Index) -> Array:
        """Metres of arc per metre of s on any pieces of the map, (M,)."""
        slot = self._slot[piece]
        if not len(self._scale):
            return np.ones(len(piece))
        return np.where(slot >= 0, self._scale[np.maximum(slot, 0)], 1.0)

    def evaluate(self, piece: Index, ds: Array) -> tuple[Array, Array, Array, Array, Array]:
        """u, v [m], turn [rad], curvature [1/m] and its derivative by arc at ds [m] from the start."""
        slot = self._slot[piece]
        arc = ds * self._scale[slot]
        count = np.maximum(self._count[slot] - 1, 1)
        row = last_at_or_before(self._first[slot], count, self._arc_m, arc)
        low, high = self._p[row], self._p[row + 1]
        p, missing = low.copy(), arc - self._arc_m[row]
        for _ in range(4):
            error = missing - self._arc(slot, low, p - low)
            speed = np.maximum(self._speed(slot, p), 1e-9)
            p = np.clip(p + error / speed, low, high)
        u, u1, u2, u3 = _derivatives(self._u[:, slot], p)
        v, v1, v2, v3 = _derivatives(self._v[:, slot], p)
        w2 = np.maximum(u1 * u1 + v1 * v1, 1e-18)
        w = np.sqrt(w2)
        k = (u1 * v2 - v1 * u2) / (w2 * w)
        slope = ((u1 * v3 - v1 * u3) / (w2 * w) - 3.0 * k * (u1 * u2 + v1 * v2) / w2) / w
        return u, v, elementary.arctan2(v1, u1), k, slope

    def _speed(self, slot: Index, p: Array) -> Array:
        _, u1, _, _ = _derivatives(self._u[:, slot], p)
        _, v1, _, _ = _derivatives(self._v[:, slot], p)
        return np.sqrt(u1 * u1 + v1 * v1)

    def _arc(self, slot: Index, low: Array, span: Array) -> Array:
        total = np.zeros(len(low))
        for node, weight in _FEW_QUADRATURE:
            total += weight * self._speed(slot, low + 0.5 * (node + 1.0) * span)
        return total * 0.5 * span


def _derivatives(coefficients: Array, p: Array) -> tuple[Array, Array, Array, Array]:
    a, b, c, d = coefficients
    value = a + p * (b + p * (c + p * d))
    return value, b + p * (2.0 * c + 3.0 * p * d), 2.0 * c + 6.0 * p * d, 6.0 * d
