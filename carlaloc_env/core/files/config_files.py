"""Files that users give, as text and as dataclasses; records as bytes; the last line of logs.

Frozen dataclasses to plain mappings and back, for YAML files; an unknown key names the nearest one.

Records of numbers, names and small arrays as bytes of JSON, for files of arrays.

The line of a log that says why a program has ended.
"""

import dataclasses
import enum
import json
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, Union, cast

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import CarlaLocError, ConfigError, unknown_name

T = TypeVar("T")


def to_mapping(config: Any) -> dict[str, Any]:
    """Plain mapping of a dataclass: numbers, strings, lists and mappings only."""
    return {f.name: _plain(getattr(config, f.name)) for f in dataclasses.fields(config) if f.init}


def from_mapping(cls: type[T], mapping: Mapping[str, Any], where: str) -> T:
    """Dataclass from a plain mapping; keys left out keep their defaults.

    Args:
        cls: A dataclass; nested dataclasses, tuples, enums and optional values are followed.
        mapping: What a YAML or TOML file held.
        where: Place in the file, for messages, e.g. ``"rig.yaml: sensors[2]"``.

    Raises:
        ConfigError: a key is unknown or missing, or a value has the wrong type.
    """
    if not isinstance(mapping, Mapping):
        raise ConfigError(f"{where}: expected keys and values, found {_name_of(mapping)}")
    fields = {f.name: f for f in dataclasses.fields(cast(Any, cls)) if f.init}
    for key in mapping:
        if key not in fields:
            raise ConfigError(f"{where}: {unknown_name('key', str(key), fields)}")
    hints = typing.get_type_hints(cls)
    values = {key: _value(hints[key], value, f"{where}.{key}") for key, value in mapping.items()}
    for name, f in fields.items():
        optional = f.default is not dataclasses.MISSING or f.default_factory is not dataclasses.MISSING
        if name not in values and not optional:
            raise ConfigError(f"{where}: the key '{name}' is missing")
    try:
        return cls(**values)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return to_mapping(value)
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return value


def _value(hint: Any, value: Any, where: str) -> Any:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in arguments:
            return None
        return _first_that_fits([a for a in arguments if a is not type(None)], value, where)
    if origin is typing.Literal:
        if value not in arguments:
            raise ConfigError(f"{where}: {unknown_name('value', str(value), map(str, arguments))}")
        return value
    if origin is tuple:
        return _tuple(arguments, value, where)
    if dataclasses.is_dataclass(hint):
        return from_mapping(cast(type[Any], hint), value, where)
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        names = [member.value for member in hint]
        if value not in names:
            raise ConfigError(f"{where}: {unknown_name('value', str(value), map(str, names))}")
        return hint(value)
    return _scalar(hint, value, where)


def _tuple(arguments: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ConfigError(f"{where}: expected a list, found {_name_of(value)}")
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        arguments = (arguments[0],) * len(value)
    if len(arguments) != len(value):
        raise ConfigError(f"{where}: expected {len(arguments)} values, found {len(value)}")
    return tuple(_value(a, v, f"{where}[{i}]") for i, (a, v) in enumerate(zip(arguments, value, strict=True)))


def _scalar(hint: Any, value: Any, where: str) -> Any:
    if hint is Any:
        return value
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if hint is float and isinstance(value, str):
        # YAML 1.1 takes 2e-5, without a point, for text.
        try:
            return float(value)
        except ValueError:
            pass
    if not isinstance(hint, type) or (
        isinstance(value, hint) and not (hint in (int, float) and isinstance(value, bool))
    ):
        return value
    raise ConfigError(f"{where}: expected {hint.__name__}, found {_name_of(value)}")


def _first_that_fits(hints: Sequence[Any], value: Any, where: str) -> Any:
    errors = []
    for hint in hints:
        try:
            return _value(hint, value, where)
        except ConfigError as error:
            errors.append(error)
    raise errors[0]


def _name_of(value: Any) -> str:
    return f"{value!r} ({type(value).__name__})" if value is not None else "nothing"


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


def _to_array(found: dict[str, Any]) -> NDArray[np.float64]:
    return np.array(found["values"], dtype=np.float64).reshape(found["shape"])


def _frozen(value: Any) -> Any:
    """Tuples in place of lists."""
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


def read_text(path: Path, kind: str, error: type[CarlaLocError] = ConfigError) -> str:
    """Text of a file, without the mark that editors of Windows put at the beginning.

    Args:
        path: The file.
        kind: What it should be, e.g. ``"rig"``.
        error: Kind of the error raised.

    Raises:
        CarlaLocError: of this kind; the file cannot be read or is no text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as fault:
        where = f"at byte {fault.start + 1}"
        raise error(
            f"cannot read the {kind} {path}: no UTF-8 text {where}; save it as UTF-8, or give another file"
        ) from fault
    except OSError as fault:
        raise error(f"cannot read the {kind} {path}: {fault.strerror or fault}; give another file") from fault


_ERROR_LINE = 300
"""Longest text of an error that is kept [characters]."""


def last_line(log: Path, *, but: str = "") -> str:
    """Last line that a system printed and that an error, `but`, does not hold already; empty: none."""
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    printed = [line.strip()[:_ERROR_LINE] for line in lines if line.strip()]
    return next((line for line in reversed(printed) if line not in but), "")
