"""Settings of an event camera."""

from __future__ import annotations

from dataclasses import dataclass

from carlaloc_env.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class EventConfig:
    """Pixels of an event camera; the defaults are CARLA's threshold with the noise of a good chip."""

    threshold_on: float = 0.3
    """Rise of log intensity that makes an event, no unit."""
    threshold_off: float = 0.3
    """Fall of log intensity that makes an event, no unit."""
    threshold_sigma: float = 0.03
    """Standard deviation of both thresholds between pixels, no unit (v2e: 0.03)."""
    refractory_us: int = 500
    """Shortest time between two events of a pixel [µs] (v2e: 500)."""
    leak_hz: float = 0.1
    """Positive events of a pixel in steady light [Hz]."""
    shot_hz: float = 0.1
    """Noise events of a pixel [Hz]."""
    dark_cd_m2: float = 0.05
    """Luminance whose photocurrent equals the dark current [cd/m²]."""
    rate_max_mev_s: float = 0.0
    """Most events the read-out passes on [million/s]; 0 = all."""
    step_px: float = 1.0
    """Farthest that anything moves between two samples of the signal [px]."""
    restart_s: float = 10.0
    """Pixels' memory begins anew at multiples of this time [s]."""

    def __post_init__(self) -> None:
        if min(self.threshold_on, self.threshold_off) < 0.01:
            raise ConfigError("event thresholds must be at least 0.01")
        rates = (self.leak_hz, self.shot_hz, self.rate_max_mev_s, self.threshold_sigma)
        if min(*rates, self.refractory_us) < 0:
            raise ConfigError(
                "leak, shot noise, refractory time and rate limit of events must not be negative"
            )
        if self.dark_cd_m2 <= 0 or self.step_px <= 0 or self.restart_s <= 0:
            raise ConfigError("dark_cd_m2, step_px and restart_s of events must be above zero")
