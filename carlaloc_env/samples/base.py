"""What all samples have in common, and how they check themselves."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray


def check(sample: object, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]) -> None:
    """Refuse a sample whose array has another dtype or shape; None stands for any length.

    Raises:
        ValueError: It has.
    """
    array: NDArray[Any] = getattr(sample, name)
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if array.dtype != np.dtype(dtype) or not fits:
        raise ValueError(
            f"{type(sample).__name__}.{name} is {array.dtype}{list(array.shape)}, "
            f"not {np.dtype(dtype)}{[n if n is not None else 'N' for n in shape]}"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """Common part of all samples."""

    sensor: str
    """Name of the stream, e.g. ``rgb_left``; also the observation key."""
    frame_id: str
    """Coordinate frame of the data, e.g. ``camera_left``."""
    stamp_ns: int
    """Time of measurement since the drive began [ns]."""

    def __eq__(self, other: object) -> bool:
        """Whether kind, names, stamp and every number are the same."""
        if type(self) is not type(other):
            return NotImplemented
        return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    __hash__ = None  # type: ignore[assignment]


def _same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(a == b)
