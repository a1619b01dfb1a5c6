"""Time as integers, 200 Hz ticks and nanoseconds since the drive began, and random streams keyed by it.

A number depends on nothing but its key (seed, name, stamp), so neither the order of sampling, nor workers,
nor a further sensor changes the noise of a sensor (Salmon et al., "Parallel random numbers: as easy as 1, 2,
3", SC 2011: Philox).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.errors import ConfigError

TICK_HZ = 200
"""Rate of the simulation tick [Hz]; every sensor rate divides it."""
TICK_NS = 1_000_000_000 // TICK_HZ
"""Length of a tick [ns]."""
TICK_S = 1.0 / TICK_HZ
"""Length of a tick [s]."""
STEP_TICKS = 10
"""Ticks in one environment step (50 ms)."""
STEP_NS = STEP_TICKS * TICK_NS
"""Length of an environment step [ns]."""
_WORD = (1 << 64) - 1
"""64 bits."""


def stamp_ns(tick: int) -> int:
    """Time of a tick since the drive began [ns]."""
    return tick * TICK_NS


@dataclass(frozen=True, slots=True)
class Schedule:
    """Schedule of a sensor's measurements, counted in ticks so that it cannot drift."""

    period_ticks: int
    """Ticks between two measurements."""

    @classmethod
    def from_hz(cls, rate_hz: float) -> Schedule:
        """Schedule of a rate [Hz] that divides the tick rate.

        Raises:
            ConfigError: the rate is not positive or does not divide 200 Hz.
        """
        period = TICK_HZ / rate_hz if rate_hz > 0 else 0.0
        if period < 1 or period != int(period):
            raise ConfigError(
                f"{rate_hz:g} Hz does not divide the {TICK_HZ} Hz tick; use one of "
                f"{', '.join(str(TICK_HZ // p) for p in (1, 2, 4, 5, 8, 10, 20, 40, 100, 200))} Hz"
            )
        return cls(int(period))

    def ticks_in(self, first_tick: int, end_tick: int) -> range:
        """Ticks of all measurements in ``[first_tick, end_tick)``."""
        first = -(-max(first_tick, 0) // self.period_ticks) * self.period_ticks
        return range(first, end_tick, self.period_ticks)

    def stamps_ns_in(self, first_ns: int, end_ns: int) -> list[int]:
        """Stamps [ns] of all measurements in ``[first_ns, end_ns)``."""
        ticks = self.ticks_in(-(-first_ns // TICK_NS), -(-end_ns // TICK_NS))
        return [stamp_ns(tick) for tick in ticks]


def stream(seed: int, name: str, stamp_ns: int = 0, index: int = 0) -> np.random.Generator:
    """Generator of one stream, the same on every machine and in every order of calls.

    Args:
        seed: The one seed of an episode or a replay.
        name: Name of what draws, e.g. ``"lidar/range"``.
        stamp_ns: Stamp of the sample the numbers are for [ns]; may be negative.
        index: Further counter, e.g. a block or an actor.
    """
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest()
    key = np.frombuffer(digest, dtype="<u8").astype(np.uint64)
    counter = np.array([0, 0, index & _WORD, stamp_ns & _WORD], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))
