"""Traffic levels of a replay: the fraction of the recorded actors that it shows."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.timeline.timeline import Timeline

LEVELS = {"dynamic": 1.0, "static": 0.0, "empty": 0.0}
"""Named levels, as fractions of the recorded actors; `empty` leaves out parked cars, too."""
LEVEL_WORDS = {
    "dynamic": "all recorded actors, and parked cars",
    "static": "parked cars alone",
    "empty": "no actors and no parked cars, as in the paper's static sequences",
    "0.5": "a fraction of the recorded actors, and parked cars",
}
"""What each level shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficLevel:
    """Fraction of the recorded actors that a replay shows; the ego's motion never depends on it."""

    name: str
    """``dynamic``, ``static``, ``empty`` or ``trafficNN`` (per cent)."""
    fraction: float
    """Fraction of the actors that stay, 0–1."""
    parked_cars: bool = True
    """Whether cars are parked in the town."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.fraction <= 1.0:
            raise ConfigError(f"traffic fraction {self.fraction:g}; give a number from 0 to 1")

    def select(self, timeline: Timeline) -> Timeline:
        """The same drive with this fraction of the actors.

        Who stays is decided by a hash of the actor's id, so a larger fraction contains every smaller one.
        """
        if self.fraction >= 1.0:
            return timeline
        keep = [
            index
            for index, actor in enumerate(timeline.catalog.id)
            if int.from_bytes(hashlib.blake2b(str(int(actor)).encode(), digest_size=4).digest(), "big")
            < self.fraction * 2**32
        ]
        return timeline.select_actors(np.array(keep, dtype=np.intp))


def traffic_level(text: str) -> TrafficLevel:
    """Level of a name (one of `LEVELS`) or a fraction such as ``0.5``.

    Raises:
        ConfigError: neither a known name nor a number from 0 to 1.
    """
    if text in LEVELS:
        return TrafficLevel(name=text, fraction=LEVELS[text], parked_cars=text != "empty")
    try:
        fraction = float(text)
    except ValueError:
        message = unknown_name("traffic level", text, [*LEVELS, "a fraction such as 0.5"])
        raise ConfigError(message) from None
    return TrafficLevel(name=f"traffic{round(100 * fraction):02d}", fraction=fraction)
