"""Base class of samples, checks of their arrays, and lists of samples."""

from collections import Counter
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray


def check_arrays(sample: object, dtype: type[np.generic], shape: tuple[int | None, ...], *names: str) -> None:
    """Refuse a sample if one of these arrays has another dtype or shape.

    Args:
        sample: The sample.
        dtype: Type of the numbers.
        shape: Shape; None stands for any length.
        names: Fields that hold the arrays; fields of the value None are left out.

    Raises:
        ValueError: An array does not fit.
    """
    for name in names:
        array: NDArray[Any] | None = getattr(sample, name)
        if array is None:
            continue
        fits = array.ndim == len(shape) and all(
            want is None or have == want for have, want in zip(array.shape, shape, strict=True)
        )
        if array.dtype != np.dtype(dtype) or not fits:
            raise ValueError(
                f"{type(sample).__name__}.{name} is {array.dtype}{list(array.shape)}, "
                f"not {np.dtype(dtype)}{[n if n is not None else 'N' for n in shape]}"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
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

    def __repr__(self) -> str:
        """One line: arrays of more than four numbers by type and shape."""
        values = (f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self))
        return f"{type(self).__name__}({', '.join(values)})"


class SampleList(list[Sample]):
    """Samples in the order of their stamps; a list that prints as one line."""

    def __repr__(self) -> str:
        """Number of samples of each stream."""
        counts = Counter(sample.sensor for sample in self)
        streams = ", ".join(name if count == 1 else f"{count} {name}" for name, count in counts.items())
        return f"<{len(self)} samples: {streams}>"


def _short(value: object) -> str:
    if not isinstance(value, np.ndarray):
        return repr(value)
    if value.ndim <= 1 and value.size <= 4:
        return np.array2string(value, precision=6, separator=", ")
    return f"{value.dtype}{list(value.shape)}"


def _same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(a == b)
