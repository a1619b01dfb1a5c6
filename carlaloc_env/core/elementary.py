"""Elementary functions of arrays with the same bits on every processor; named and called as NumPy's.

Everything that shapes a town, its traffic or a sample of truth, IMU, GNSS, LiDAR or radar goes through these
instead of NumPy's or a C library's, which choose code by the processor. + − × ÷, √ and `np.hypot` do not
differ. Single precision is computed in double and rounded.
"""

import functools
import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array


def sin(x: Any) -> Any:
    """Sine of angles [rad]."""
    return _apply("sin", x)


def cos(x: Any) -> Any:
    """Cosine of angles [rad]."""
    return _apply("cos", x)


def tan(x: Any) -> Any:
    """Tangent of angles [rad]."""
    return _apply("tan", x)


def arcsin(x: Any) -> Any:
    """Angles of sines [rad]; nan beyond ±1."""
    return _apply("arcsin", x)


def arccos(x: Any) -> Any:
    """Angles of cosines [rad]; nan beyond ±1."""
    return _apply("arccos", x)


def arctan(x: Any) -> Any:
    """Angles of tangents [rad]."""
    return _apply("arctan", x)


def arctan2(y: Any, x: Any) -> Any:
    """Angles of points (x, y) [rad], −π to π."""
    return _apply("arctan2", y, x)


def exp(x: Any) -> Any:
    """e to the power x."""
    return _apply("exp", x)


def log(x: Any) -> Any:
    """Natural logarithm."""
    return _apply("log", x)


def log10(x: Any) -> Any:
    """Logarithm to the base 10."""
    return _apply("log10", x)


def power(x: Any, y: Any) -> Any:
    """Numbers from 0 up to a power."""
    return _apply("power", x, y)


def sinc(x: Any) -> Any:
    """sin(πx)/(πx), 1 at 0."""
    along = np.pi * np.where(np.asarray(x) == 0.0, 1e-20, x)
    return _as_given(sin(along) / along, x)


def convolve(values: Any, weights: Any, mode: str = "full") -> Any:
    """Convolution of a row of values with a shorter one of weights, as `np.convolve`, without BLAS."""
    row, kernel = np.asarray(values, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    if len(row) < len(kernel):
        row, kernel = kernel, row
    full = np.zeros(len(row) + len(kernel) - 1)
    for k, weight in enumerate(kernel):
        full[k : k + len(row)] += weight * row
    first = {"full": 0, "same": (len(kernel) - 1) // 2, "valid": len(kernel) - 1}[mode]
    return full[first : first + {"full": len(full), "same": len(row)}.get(mode, len(row) - len(kernel) + 1)]


def matrix_product(a: Any, b: Any) -> Any:
    """Product of matrices (..., I, K) and (K, J) as `a @ b`, its terms added in their order, without BLAS."""
    left, right = np.asarray(a), np.asarray(b)
    total = left[..., :1] * right[0]
    for k in range(1, len(right)):
        total = total + left[..., k, None] * right[k]
    return total


def _apply(name: str, *given: Any) -> Any:
    """A kernel over arrays."""
    if len(given) == 1:
        values = np.array(given[0], dtype=np.float64, order="C")
        flat = values.reshape(-1)
        _fill(name)(flat, flat)
        return _as_given(values[()], *given)
    shape = np.broadcast(*given).shape
    both = [np.empty(shape) for _ in given]
    for room, value in zip(both, given, strict=True):
        room[...] = value
    _fill(name)(both[0].reshape(-1), both[1].reshape(-1))
    return _as_given(both[0][()], *given)


def _as_given(result: Any, *given: Any) -> Any:
    """In single precision where no argument is in double."""
    kinds = {getattr(x, "dtype", None) for x in given}
    return (
        np.float32(result) if np.dtype(np.float32) in kinds and np.dtype(np.float64) not in kinds else result
    )


@functools.cache
def _fill(name: str) -> Callable[[Array, Array], None]:
    # Here, since numba takes half a second to import, and much is read without computing anything.
    kernels = importlib.import_module("carlaloc_env.core.elementary_kernels")
    return functools.partial(kernels.fill, kernels.FUNCTIONS.index(name))
