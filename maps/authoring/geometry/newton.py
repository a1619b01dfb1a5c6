"""The few unknowns of a curve, found from what it misses."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from scipy.optimize import root


class PlanError(ValueError):
    """A town plan asks for geometry that does not exist."""


def solve(miss: Callable[[Sequence[float]], list[float]], guess: Sequence[float]) -> list[float]:
    """Unknowns at which nothing is missed.

    Raises:
        PlanError: no solution was reached.
    """
    found = root(miss, guess, tol=1e-13)
    if max(abs(value) for value in miss(found.x)) > 1e-9:
        raise PlanError(f"the curve has no solution near {list(guess)}")
    return [float(value) for value in found.x]
