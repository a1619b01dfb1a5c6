"""Newton's method for the few unknowns of a curve, from what it misses."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root


class PlanError(ValueError):
    """A town plan asks for geometry that does not exist."""


def solve(miss: Callable[[Sequence[float]], list[float]], guess: Sequence[float]) -> list[float]:
    """Solves for the unknowns at which nothing is missed.

    Raises:
        PlanError: no solution was reached.
    """

    def missed(unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array(miss(unknowns.tolist()))

    solution: list[float] = root(missed, guess, tol=1e-13).x.tolist()
    if max(abs(value) for value in miss(solution)) > 1e-9:
        raise PlanError(f"the curve has no solution near {list(guess)}")
    return solution
