"""The space of a search: quantities from neutral to worst, and the distance of a condition from neutral."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.faults.faults import KINDS
from carlaloc_env.faults.fields import quantities
from recorder.laboratory.sweep import FAULT, RIG, TRAFFIC, Setting

STEP = 1e-3
"""Steps in which a search moves, as a share of each range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """A quantity, from its neutral value to its worst one."""

    name: str
    """As in `recorder.laboratory.sweep.Axis`."""
    neutral: float
    """Value at distance 0; nothing is set there."""
    worst: float
    """Value at distance 1."""
    is_log: bool = False
    """Whether distances are those of the logarithm."""

    def __post_init__(self) -> None:
        ends = (self.neutral, self.worst)
        if not all(map(math.isfinite, ends)) or ends[0] == ends[1] or (self.is_log and min(ends) <= 0):
            raise ConfigError(f"range of {self.name}: give two finite values that differ, NEUTRAL:WORST")
        if self.name == TRAFFIC and max(ends) > 1:
            raise ConfigError("traffic is searched up to 1, the recorded one; give another drive for more")
        if self.name.startswith(RIG):
            raise ConfigError(f"{self.name}: a search keeps the rig; vary its fields by `carlaloc sweep`")
        Setting().changed(self.name, self.worst)

    @classmethod
    def parse(cls, word: str) -> Range:
        """Range of a word: ``NAME=NEUTRAL:WORST`` or ``NAME=NEUTRAL:WORST:log``.

        Raises:
            ConfigError: the quantity is unknown, or an end is no number that it can have.
        """
        name, _, text = word.partition("=")
        parts = text.split(":")
        try:
            return cls(name=name, neutral=float(parts[0]), worst=float(parts[1]), is_log=parts[2:] == ["log"])
        except (ValueError, IndexError):
            raise ConfigError(f"range '{word}'; give NAME=NEUTRAL:WORST, e.g. traffic=0:1") from None

    def value(self, share: float) -> float:
        """Value at a distance of 0–1."""
        if self.is_log:
            return float(f"{self.neutral * (self.worst / self.neutral) ** share:.6g}")
        return float(f"{self.neutral + share * (self.worst - self.neutral):.6g}")


def ranges_of(kinds: tuple[str, ...], *, weather: bool) -> tuple[Range, ...]:
    """Ranges of a search: weather, traffic, and every fault of the sensors with two finite ends.

    Args:
        kinds: Kinds of sensors that it reads, e.g. ``("lidar", "imu")``.
        weather: Whether weather reaches them.
    """
    air = (Range(name="fog_visibility_m", neutral=2000.0, worst=20.0, is_log=True),
           Range(name="rain_mmph", neutral=0.0, worst=50.0))  # fmt: skip
    ranges = [*(air if weather else ()), Range(name=TRAFFIC, neutral=0.0, worst=1.0)]
    for kind in kinds:
        for name, fault in quantities(KINDS[kind]).items():
            if math.isfinite(fault.worst) and math.isfinite(fault.neutral):
                ranges.append(Range(name=f"{FAULT}{kind}.{name}", neutral=fault.neutral, worst=fault.worst))
    return tuple(ranges)


def distance(shares: Mapping[str, float]) -> float:
    """Distance of a condition from the neutral one: root of the sum of squared shares of the ranges."""
    return math.sqrt(sum(share * share for share in shares.values()))


def setting_at(base: Setting, ranges: tuple[Range, ...], shares: Mapping[str, float]) -> Setting:
    """The condition at some shares of the ranges; quantities at 0 stay as they are in the base."""
    setting = base
    for quantity in ranges:
        if shares.get(quantity.name, 0.0) > 0.0 or quantity.name == TRAFFIC:
            setting = setting.changed(quantity.name, quantity.value(shares.get(quantity.name, 0.0)))
    return setting
