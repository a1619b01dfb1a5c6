"""Fields of faults: each has a neutral value, a worst one, a unit, a definition and a source."""

from dataclasses import dataclass, field, fields
from math import isinf
from typing import Any

from carlaloc_env.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """Properties of a field of faults besides its value."""

    neutral: float
    """Value at which the field has no effect."""
    worst: float
    """Far end of a search; inf: the field is a setting of another fault."""
    unit: str
    """Unit, ``1`` for shares."""
    definition: str
    """Exact meaning in a sentence."""
    source: str
    """Where the kind of fault is described; empty: it defines itself."""
    low: float
    """Least allowed value."""
    high: float
    """Largest allowed value."""


def fault(
    unit: str,
    definition: str,
    *,
    worst: float,
    neutral: float = 0.0,
    source: str = "",
    low: float = float("-inf"),
    high: float = float("inf"),
) -> Any:
    """A field that is a fault by itself, off at its neutral value."""
    quantity = Quantity(
        neutral=neutral, worst=worst, unit=unit, definition=definition, source=source, low=low, high=high
    )
    return field(default=neutral, metadata={"quantity": quantity})


def setting(unit: str, definition: str, *, default: float, low: float = float("-inf")) -> Any:
    """A field that shapes other faults, and has no effect by itself."""
    return fault(unit, definition, worst=float("inf"), neutral=default, low=low)


def quantities(cls: type) -> dict[str, Quantity]:
    """Fields of a class of faults, settings included."""
    return {item.name: item.metadata["quantity"] for item in fields(cls)}


def active(faults: Any) -> tuple[str, ...]:
    """Names of the faults that are on."""
    items = quantities(type(faults)).items()
    return tuple(name for name, q in items if not isinf(q.worst) and getattr(faults, name) != q.neutral)


def check_fields(faults: Any, what: str) -> None:
    """Refuse values out of range.

    Raises:
        ConfigError: a value is no number, or out of its range.
    """
    for name, quantity in quantities(type(faults)).items():
        value = getattr(faults, name)
        endless = isinf(value) and not isinf(quantity.neutral)
        if endless or not quantity.low <= value <= quantity.high:
            raise ConfigError(
                f"{what}.{name} = {value:g}; give {quantity.low:g} to {quantity.high:g} [{quantity.unit}]"
            )
