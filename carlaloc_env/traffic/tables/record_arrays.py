"""Tables whose columns compiled functions read by name: structured arrays described by a class.

Uniform draws for compiled functions: a hash of what is decided, the same on every machine.
"""

from collections.abc import Sequence, Sized
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Index
from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.core.jit import compiled

Flags = NDArray[np.bool_]
"""Columns of truth values."""

T = TypeVar("T")


def columns(kind: type[T], rows: int) -> T:
    """A table of zeros with a column for every annotation of a class.

    Args:
        kind: Its annotations are `Array`, `Index` or `Flags`; with `Annotated`, the shape of one cell.
        rows: Number of rows.
    """
    fields: list[Any] = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        shape: tuple[int, ...] = ()
        if get_origin(hint) is Annotated:
            hint, *shape_parts = get_args(hint)
            shape = tuple(shape_parts)
        fields.append((name, _scalar(hint), shape))
    return cast(T, np.zeros(rows, np.dtype(fields, align=True)).view(np.recarray))


def _scalar(array_type: Any) -> Any:
    """Scalar type of an `NDArray[...]`: numpy 2.5 shows the alias, older ones `ndarray[..., dtype[...]]`."""
    last = get_args(array_type)[-1]
    return get_args(last)[0] if get_origin(last) is np.dtype else last


def fill(kind: type[T], rows: int, /, **values: Any) -> T:
    """A table with these values in its columns; every column must be given."""
    table = columns(kind, rows)
    for name in get_type_hints(kind):
        getattr(table, name)[...] = values.pop(name)
    if values:
        raise TypeError(f"{kind.__name__} has no columns {', '.join(values)}")
    return table


def packed(kind: type[T], rows: Sequence[Sequence[Any]]) -> tuple[Index, T]:
    """Where each of N rows of records begins (N + 1,), and a table of all records laid end to end.

    Args:
        kind: Class of the table; a record has its columns in their order.
        rows: Records of each row.
    """
    flat = [record for row in rows for record in row]
    values = {name: [record[k] for record in flat] for k, name in enumerate(get_type_hints(kind))}
    return starts(rows), fill(kind, len(flat), **values)


def starts(rows: Sequence[Sized]) -> Index:
    """Where each of N rows of different length begins when they are laid end to end, (N + 1,)."""
    first = np.zeros(len(rows) + 1, np.int64)
    first[1:] = np.cumsum([len(row) for row in rows])
    return first


def to_arrays(group: tuple[Any, ...], prefix: str = "") -> Arrays:
    """Arrays and columns of a NamedTuple of arrays, tables and other such groups, by name.

    Args:
        group: The group.
        prefix: Beginning of the names.
    """
    arrays: Arrays = {}
    for name, value in zip(type(group)._fields, group, strict=True):  # type: ignore[attr-defined]
        path = f"{prefix}{name}"
        if isinstance(value, tuple):
            arrays |= to_arrays(value, f"{path}/")
        elif value.dtype.names is not None:
            arrays |= {f"{path}/{column}": value[column] for column in value.dtype.names}
        else:
            arrays[path] = value
    return arrays


def from_arrays(kind: type[T], arrays: Arrays, prefix: str = "") -> T:
    """The group again.

    Args:
        kind: Its class.
        arrays: What `to_arrays` made of it; arrays are copied, so that they can be written to.
        prefix: Beginning of their names.

    Raises:
        KeyError: One is missing.
    """
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        path = f"{prefix}{name}"
        if path in arrays:
            values[name] = arrays[path].copy()
        elif hasattr(hint, "_fields"):
            values[name] = from_arrays(hint, arrays, f"{path}/")
        else:
            column = {column: arrays[f"{path}/{column}"] for column in get_type_hints(hint)}
            values[name] = fill(hint, len(next(iter(column.values()))), **column)
    return kind(**values)


_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
"""2⁶⁴ over the golden ratio: SplitMix64's increment."""
_MIX_A = np.uint64(0xBF58476D1CE4E5B9)
"""First multiplier of SplitMix64's finaliser."""
_MIX_B = np.uint64(0x94D049BB133111EB)
"""Second multiplier of SplitMix64's finaliser."""
_ONE_53 = 1.0 / 9007199254740992.0
"""2⁻⁵³: makes 53 random bits a number in [0, 1)."""


@compiled
def _mixed(x: np.uint64) -> np.uint64:
    """SplitMix64's finaliser of 64 bits."""
    x = (x ^ (x >> np.uint64(30))) * _MIX_A
    x = (x ^ (x >> np.uint64(27))) * _MIX_B
    return x ^ (x >> np.uint64(31))


@compiled
def hash_uniform(seed: int, purpose: int, entity: int, counter: int) -> float:
    """Uniform draw in [0, 1), the same for the same seed, purpose, entity and counter.

    SplitMix64's finaliser over the arguments (Steele, Lea & Flood, "Fast splittable pseudorandom
    number generators", OOPSLA 2014).
    """
    x = _mixed(np.uint64(seed) + _GOLDEN)
    x = _mixed(x ^ np.uint64(purpose) * _GOLDEN)
    x = _mixed(x ^ np.uint64(entity) * _GOLDEN)
    x = _mixed(x ^ np.uint64(counter) * _GOLDEN)
    return float(x >> np.uint64(11)) * _ONE_53


@compiled
def happens(probability: float, seed: int, purpose: int, entity: int, counter: int) -> bool:
    """Whether something of a probability happens, by the draw of `hash_uniform`."""
    return probability > 0.0 and hash_uniform(seed, purpose, entity, counter) < probability
