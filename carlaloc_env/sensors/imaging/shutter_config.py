"""When an imager's pixels gather light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutterConfig:
    """When the rows of a picture gather light; the stamp is the middle of the middle row's exposure."""

    motion_blur: bool = True
    """Whether light is gathered during the exposure, or at its middle."""
    readout_ms: float = 0.0
    """Time from the first row's exposure to the last row's [ms]; 0 = global shutter."""

    def __post_init__(self) -> None:
        if self.readout_ms < 0:
            raise ConfigError("shutter: readout_ms must not be negative")

    def span_ns(self, exposure_max_ms: float) -> int:
        """Time around the stamp in which any row may gather light [ns]."""
        return round(1e6 * (self.readout_ms + (exposure_max_ms if self.motion_blur else 0.0)))

    def rows_ns(self, stamp_ns: int, exposure_s: float, height: int) -> NDArray[np.float64]:
        """Beginning and end of every row's light [ns], shape (H, 2)."""
        middle = stamp_ns + 1e6 * self.readout_ms * (np.arange(height) / max(height - 1, 1) - 0.5)
        half = 0.5e9 * exposure_s if self.motion_blur else 0.0
        return np.stack([middle - half, middle + half], axis=-1)
