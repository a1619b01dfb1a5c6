"""Records of numbers, names and small arrays as bytes of JSON, for files of arrays."""

import json
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


def to_bytes(records: Sequence[Any]) -> NDArray[np.uint8]:
    """Records of one dataclass as bytes, (B,).

    Their fields are numbers, names, None, arrays of floating-point numbers, and tuples of these. All come
    back with the same bits: JSON holds as many digits as that takes.
    """
    rows = [[getattr(record, field.name) for field in fields(record)] for record in records]
    return np.frombuffer(json.dumps(rows, default=_of_array).encode(), dtype=np.uint8)


def from_bytes(kind: type[T], content: NDArray[np.uint8]) -> tuple[T, ...]:
    """The records again.

    Args:
        kind: Their dataclass.
        content: What `to_bytes` made of them.

    Raises:
        ValueError: These bytes hold no such records.
    """
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    rows = json.loads(content.tobytes(), object_hook=_to_array)
    return tuple(
        kind(**{name: _frozen(value) for name, value in zip(names, row, strict=True)}) for row in rows
    )


def _of_array(value: NDArray[np.float64]) -> dict[str, Any]:
    if value.dtype != np.float64:
        raise TypeError(f"arrays of {value.dtype} are not kept in records")
    return {"values": value.ravel().tolist(), "shape": value.shape}


def _to_array(document: dict[str, Any]) -> NDArray[np.float64]:
    return np.array(document["values"], dtype=np.float64).reshape(document["shape"])


def _frozen(value: Any) -> Any:
    """Tuples in place of lists."""
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
