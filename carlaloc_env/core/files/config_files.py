"""Frozen dataclasses to plain mappings and back, for YAML files; an unknown key names the nearest one."""

import dataclasses
import enum
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, Union, cast

from carlaloc_env.core.errors import ConfigError, unknown_name

T = TypeVar("T")


def set_paths(config: Any, *names: str) -> None:
    """Make paths of texts that were given for fields of a frozen dataclass."""
    for name in names:
        if isinstance(value := getattr(config, name), str):
            object.__setattr__(config, name, Path(value))


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
