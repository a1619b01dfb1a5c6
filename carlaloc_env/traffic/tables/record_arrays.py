"""Tables whose columns compiled functions read by name: structured arrays described by a class."""

from collections.abc import Sequence, Sized
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Index
from carlaloc_env.core.files.array_files import Arrays

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
    """Beginning of each of N rows of records (N + 1,), and a table of all records laid end to end.

    Args:
        kind: Class of the table; a record has its columns in their order.
        rows: Records of each row.
    """
    flat = [record for row in rows for record in row]
    values = {name: [record[k] for record in flat] for k, name in enumerate(get_type_hints(kind))}
    return starts(rows), fill(kind, len(flat), **values)


def starts(rows: Sequence[Sized]) -> Index:
    """Beginning of each of N rows of different length when they are laid end to end, (N + 1,)."""
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
