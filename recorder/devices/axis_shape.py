"""Shapes a raw axis of a wheel, pedal or stick into a value: dead zone, saturation, gamma and expo."""

import math
from dataclasses import dataclass

from carlaloc_env.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisShape:
    """Mapping of one raw axis, −1…1 as SDL gives it, to a value."""

    axis: int
    """Number of the axis."""
    rest: float
    """Raw value of an axis that is not touched."""
    full: float
    """Raw value that counts as +1: pedal down, or wheel fully to the left."""
    opposite: float | None = None
    """Raw value that counts as −1 (wheel fully to the right); None: the axis is a pedal."""
    dead_zone: float = 0.03
    """Fraction of the travel next to rest that gives 0; the rest is stretched to meet it."""
    saturation: float = 0.02
    """Fraction of the travel at the end that gives 1 already."""
    gamma: float = 1.0
    """Exponent of the travel: 1 is linear, more is gentler at first."""
    expo: float = 0.0
    """Fraction k of a cubic, y = (1 − k) x + k x³: 0 is linear, 1 gentlest about the middle."""

    def __post_init__(self) -> None:
        ends = (self.full,) if self.opposite is None else (self.full, self.opposite)
        if self.axis < 0:
            raise ConfigError(f"axis {self.axis}; axes are counted from 0")
        if any(not -1.0 <= value <= 1.0 for value in (self.rest, *ends)):
            raise ConfigError(f"axis {self.axis}: raw values lie between -1 and 1")
        if any(abs(end - self.rest) < 0.05 for end in ends):
            raise ConfigError(f"axis {self.axis}: rest {self.rest:g} and its end are too close; calibrate")
        if self.opposite is not None and (self.full - self.rest) * (self.opposite - self.rest) > 0.0:
            raise ConfigError(f"axis {self.axis}: both ends lie on one side of rest; calibrate")
        if not (0.0 <= self.dead_zone < 0.5 and 0.0 <= self.saturation < 0.5):
            raise ConfigError(f"axis {self.axis}: dead_zone and saturation lie between 0 and 0.5")
        if not (0.2 <= self.gamma <= 5.0 and 0.0 <= self.expo <= 1.0):
            raise ConfigError(f"axis {self.axis}: gamma lies between 0.2 and 5, expo between 0 and 1")


def shape_axis(raw: float, shape: AxisShape) -> float:
    """Value of an axis: 0…1 for a pedal, −1…1 for a wheel; monotone, 0 at rest, ±1 at the ends.

    A raw value that is not finite counts as rest.
    """
    if not math.isfinite(raw):
        return 0.0
    away = raw - shape.rest
    positive = away * (shape.full - shape.rest) >= 0.0
    if not positive and shape.opposite is None:
        return 0.0
    end = shape.full if positive or shape.opposite is None else shape.opposite
    travel = away / (end - shape.rest)
    usable = 1.0 - shape.dead_zone - shape.saturation
    x = min(1.0, max(0.0, (travel - shape.dead_zone) / usable))
    x = math.pow(x, shape.gamma)
    y = (1.0 - shape.expo) * x + shape.expo * x * x * x
    return y if positive else -y
