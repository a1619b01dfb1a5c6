"""Newton's method for the few unknowns of a curve."""

from __future__ import annotations

from collections.abc import Callable, Sequence


class PlanError(ValueError):
    """A town plan asks for geometry that does not exist."""


def solve(miss: Callable[[Sequence[float]], list[float]], guess: Sequence[float]) -> list[float]:
    """Newton's method with a numerical Jacobian for two or three unknowns.

    Raises:
        PlanError: no solution was reached.
    """
    x = list(guess)
    n = len(x)
    for _ in range(60):
        f = miss(x)
        if max(abs(v) for v in f) < 1e-12:
            return x
        rows = [[0.0] * n + [-f[i]] for i in range(n)]
        for j in range(n):
            h = 1e-6 * max(1e-2, abs(x[j]))
            up, down = list(x), list(x)
            up[j] += h
            down[j] -= h
            f_up, f_down = miss(up), miss(down)
            for i in range(n):
                rows[i][j] = (f_up[i] - f_down[i]) / (2 * h)
        step = _eliminate(rows)
        damp = min(
            1.0, min(0.5 * max(abs(v), 0.05) / abs(d) if d else 1.0 for v, d in zip(x, step, strict=True))
        )
        x = [v + damp * d for v, d in zip(x, step, strict=True)]
    if max(abs(v) for v in miss(x)) < 1e-9:
        return x
    raise PlanError(f"the curve has no solution near {list(guess)}")


def _eliminate(rows: list[list[float]]) -> list[float]:
    n = len(rows)
    for i in range(n):
        pivot = max(range(i, n), key=lambda r: abs(rows[r][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        if abs(rows[i][i]) < 1e-14:
            raise PlanError("the curve's equations are singular")
        for r in range(n):
            if r != i:
                factor = rows[r][i] / rows[i][i]
                rows[r] = [a - factor * b for a, b in zip(rows[r], rows[i], strict=True)]
    return [rows[i][n] / rows[i][i] for i in range(n)]
