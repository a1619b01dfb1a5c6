"""Elevation along a road: straight grades joined by parabolic vertical curves."""

from collections.abc import Sequence

Cubic = tuple[float, float, float, float]
"""a, b, c, d of a + b·ds + c·ds² + d·ds³."""
Record = tuple[float, float, float, float, float]
"""s, a, b, c, d of z = a + b·ds + c·ds² + d·ds³."""


def level(z: float) -> list[Record]:
    """Constant height."""
    return [(0.0, z, 0.0, 0.0, 0.0)]


def height_at(records: Sequence[Record], s: float) -> tuple[float, float]:
    """Height [m] and grade at `s`."""
    start, a, b, c, d = next(r for r in reversed(records) if r[0] <= s + 1e-9 or r is records[0])
    return moved_cubic((a, b, c, d), s - start)[:2]


def moved_cubic(cubic: Cubic, u: float) -> Cubic:
    """Coefficients of the same cubic counted from `u` on: its value, slope and so on there."""
    a, b, c, d = cubic
    return a + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * d * u), c + 3 * d * u, d


def hermite(z0: float, grade0: float, z1: float, grade1: float, length: float) -> list[Record]:
    """One cubic between two heights with their grades (driving.md 2.3 of the sources: cubic Hermite)."""
    rise, slopes = z1 - z0, (grade0 + grade1) * length
    c = (3 * rise - (2 * grade0 + grade1) * length) / length**2
    return [(0.0, z0, grade0, c, (slopes - 2 * rise) / length**3)]
