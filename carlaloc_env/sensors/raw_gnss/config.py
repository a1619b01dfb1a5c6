"""Settings of a receiver's raw measurements: systems, date, base station, and a switch for each error."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from datetime import datetime, timezone

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.sensors.raw_gnss.systems import GPS_EPOCH_NS, LEAP_S, SYSTEMS

_BASE_MAX_M = 50_000.0
"""Distance up to which a base station shares the air of a car [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeErrors:
    """Errors of raw measurements; each is off at 0 or ``false``."""

    receiver_clock: bool = True
    """Whether the receiver's clock drifts, and leaps by a millisecond where it is off by half of one."""
    satellite_clocks: bool = True
    """Whether satellites' clocks have offsets and group delays, which the messages give."""
    ionosphere: float = 0.5
    """Error of Klobuchar's model as a share of its delay, rms; the delay itself is off at 0 as well."""
    troposphere_m: float = 0.03
    """Error of Saastamoinen's model overhead, rms [m]; the delay itself is off at 0 as well."""
    signal_in_space: float = 1.0
    """Errors of broadcast orbits and clocks over each system's published ones (0.2–0.5 m)."""
    code_noise_m: float = 0.4
    """White noise of a pseudorange on L1 at 45 dB-Hz [m]; it grows as 1/√(C/N0)."""
    carrier_noise_m: float = 0.001
    """White noise of a carrier phase at 45 dB-Hz [m]; it grows as 1/√(C/N0)."""
    doppler_noise_mps: float = 0.05
    """White noise of a Doppler measurement at 45 dB-Hz [m/s]; it grows as 1/√(C/N0)."""
    cn0_noise_db: float = 1.5
    """Slow spread of C/N0 [dB]."""
    multipath_m: float = 0.3
    """Multipath of a pseudorange under open sky [m]; a hundredth of it in carrier phases."""
    multipath_s: float = 20.0
    """Correlation time of multipath [s]."""
    multipath_growth: float = 5.0
    """Growth of multipath with the hidden fraction b of the sky: factor 1 + growth·b."""
    slips_per_hour: float = 0.5
    """Cycle slips of each signal in sight [1/h]; reflected ones slip a hundred times as often."""
    ambiguities: bool = True
    """Whether carrier phases begin at an unknown whole number of cycles."""
    town: bool = True
    """Whether town and traffic block satellites, and walls reflect them."""

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(f"errors: {one.name} is {value}; give a number of at least 0")
        if self.multipath_s <= 0:
            raise ConfigError("errors: multipath_s must be above 0")

    @property
    def models(self) -> tuple[bool, bool, bool]:
        """Whether satellites' clocks, the ionosphere and the troposphere are in ranges."""
        return self.satellite_clocks, self.ionosphere > 0, self.troposphere_m > 0

    @classmethod
    def off(cls) -> RangeErrors:
        """No errors: geometry alone."""
        zero = {one.name: False if one.type == "bool" else 0.0 for one in fields(cls)}
        return cls(**{**zero, "multipath_s": 20.0})  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseStation:
    """A receiver at rest under open sky, whose measurements correct those of the car (RTK)."""

    position_m: tuple[float, float, float]
    """Its antenna in the world: east, north, up [m]."""

    def __post_init__(self) -> None:
        distance_m = math.hypot(*self.position_m)
        if not distance_m <= _BASE_MAX_M:
            raise ConfigError(f"base: {distance_m / 1e3:.0f} km from the town's origin; give at most 50 km")


@dataclass(frozen=True, slots=True, kw_only=True)
class RawConfig:
    """Raw measurements of a receiver: its satellites, its base station and its errors."""

    systems: tuple[str, ...] = ("gps", "galileo", "beidou")
    """Systems received: ``gps``, ``galileo``, ``beidou`` (the satellites of medium height)."""
    date: str = "2023-01-01"
    """Day and time at which the drive begins, UTC (ISO 8601); the default is that of all bags."""
    base: BaseStation | None = None
    """The base station, e.g. ``{position_m: [800, -600, 40]}``; None: there is none."""
    cn0_min_dbhz: float = 20.0
    """Weaker signals are not measured [dB-Hz]."""
    errors: RangeErrors = field(default_factory=RangeErrors)
    """Errors, each with its switch."""

    def __post_init__(self) -> None:
        for name in self.systems:
            if name == "glonass":
                raise ConfigError("system 'glonass' has no Kepler orbits in its messages; leave it out")
            if name not in SYSTEMS:
                raise ConfigError(unknown_name("system", name, SYSTEMS))
        if not self.systems or len(set(self.systems)) < len(self.systems):
            raise ConfigError(f"systems {list(self.systems)}; give at least one, each once")
        if self.gps_ns < 0:
            raise ConfigError(f"date {self.date} lies before 1980-01-06, where GPS time begins; give a later")

    @property
    def gps_ns(self) -> int:
        """GPS time at which the drive begins [ns since 1980-01-06]."""
        try:
            day = datetime.fromisoformat(self.date)
        except ValueError as error:
            raise ConfigError(f"date '{self.date}' is no ISO 8601 date, e.g. 2023-01-01T12:00") from error
        if day.tzinfo is None:
            day = day.replace(tzinfo=timezone.utc)
        unix_ns = round(day.timestamp()) * 1_000_000_000
        return unix_ns - GPS_EPOCH_NS + LEAP_S * 1_000_000_000
