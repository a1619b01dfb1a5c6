"""Limits of sensors' sizes, checked when a configuration is made, long before memory is taken."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from carlaloc_env.core.errors import ConfigError

SENSORS_MAX = 64
"""Most sensors of a rig."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """Smallest and largest value of a parameter; of a list, of its length."""

    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    unit: str = ""
    """Unit of both."""


LIMITS: dict[str, dict[str, Limit]] = {
    "camera": {
        "pinhole.width_px": Limit(low=1, high=8192, unit="px"),
        "pinhole.height_px": Limit(low=1, high=8192, unit="px"),
        "events.threshold_on": Limit(low=0.01, high=10),
        "events.threshold_off": Limit(low=0.01, high=10),
        "events.leak_hz": Limit(low=0, high=1000, unit="Hz"),
        "events.shot_hz": Limit(low=0, high=1000, unit="Hz"),
        "events.rate_max_mev_s": Limit(low=0, high=10_000, unit="million/s"),
        "events.restart_s": Limit(low=0.05, high=600, unit="s"),
    },
    "lidar": {
        "elevations_deg": Limit(low=1, high=256, unit="beams"),
        "columns": Limit(low=0, high=36_000),
        "rays": Limit(low=1, high=4_000_000),
        "range_max_m": Limit(low=0, high=2000, unit="m"),
    },
    "radar": {
        "columns": Limit(low=1, high=4096),
        "rows": Limit(low=1, high=1024),
        "rays_per_actor": Limit(low=1, high=1000),
        "detections_max": Limit(low=1, high=100_000),
        "clutter_mean": Limit(low=0, high=10_000),
        "range_max_m": Limit(low=0, high=2000, unit="m"),
        "range_resolution_m": Limit(low=0.01, high=100, unit="m"),
        "azimuth_resolution_deg": Limit(low=0.01, high=180, unit="deg"),
        "elevation_resolution_deg": Limit(low=0.01, high=90, unit="deg"),
        "doppler_resolution_mps": Limit(low=0.001, high=100, unit="m/s"),
    },
}
"""Limits by kind of sensor and parameter; a dot leads into a part of the configuration."""
RATE = Limit(low=0.01, high=200, unit="Hz")
"""Limit of the rate of every sensor, which divides 200 Hz besides."""


def check_limits(config: Any) -> None:
    """Refuse a sensor's configuration that is beyond a limit.

    Args:
        config: A `SensorConfig`.

    Raises:
        ConfigError: a value is too small, too large or no number; the message names the limit.
    """
    for name, limit in {"rate_hz": RATE, **LIMITS.get(config.kind, {})}.items():
        value: Any = config
        for part in name.split("."):
            value = getattr(value, part)
        size = len(value) if isinstance(value, tuple) else value
        if not (math.isfinite(size) and limit.low <= size <= limit.high):
            unit = f" {limit.unit}" if limit.unit else ""
            what = f"{config.kind} '{config.name}': {name}"
            raise ConfigError(f"{what} is {size:g}; give {limit.low:g} to {limit.high:g}{unit}")
