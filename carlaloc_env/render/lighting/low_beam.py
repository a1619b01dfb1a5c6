"""The pattern of a low beam."""

from __future__ import annotations

from carlaloc_env.core.jit import inlined


@inlined
def _bell(x: float, y: float) -> float:
    """(1 - x²/32)^16: a normal curve of height 1 but for its end."""
    share = max(1.0 - (x * x + y * y) / 32.0, 0.0)
    share *= share
    share *= share
    share *= share
    return share * share


@inlined
def low_beam(ahead: float, left: float, up: float) -> float:
    """Intensity of a low beam [cd], as in ``shade.frag``; components of a direction from the lamp.

    Without branches, so that loops over it work on several directions at once.
    """
    per_ahead = 57.29578 / max(ahead, 0.05)
    h, v = -left * per_ahead, up * per_ahead
    cut = min(-0.57 + max(h, 0.0) * 0.268, 1.0)
    below = min(max(1.5 * (cut - v) + 0.5, 0.0), 1.0)
    below *= below * (3.0 - 2.0 * below)
    narrow = 26000.0 * _bell((h - 1.5) / 2.3, (v + 1.0) / 0.9)
    wide = 8000.0 * _bell(h / 9.0, (v + 1.8) / 1.8)
    floor = 4200.0 * _bell(h / 20.0, (v + 4.5) / 3.5)
    result: float = below * (narrow + wide + floor) + 180.0 * _bell(h / 25.0, v / 12.0)
    return result if ahead > 0.05 else 0.0
