"""Faults of cameras: dirt and drops on one lens, wrong exposure, a wrong written lens."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.faults.fields import fault
from carlaloc_env.faults.timing import Draws, MountedFaults
from carlaloc_env.samples import Image, Sample
from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.weather.parameters import WeatherParameters

DIRT_CELLS = (9, 16)
"""Rows and columns of the noise whose hills are blots of dirt."""
DIRT_RGB = (52.0, 46.0, 38.0)
"""Colour of dirt, sRGB."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFaults(MountedFaults):
    """Faults of a camera. Those of the data change colour pictures alone; labels and depth are truth."""

    exposure_stops: float = fault(
        "stops", "light is multiplied by 2 to this power, before it is cut at white", worst=4.0,
        source="IEC 61966-2-1 (sRGB)",
    )  # fmt: skip
    dirt_share: float = fault(
        "1", "share of the picture behind blots of dirt, which stay where they are", worst=0.8, low=0.0,
        high=1.0,
    )  # fmt: skip
    drops_percent: float = fault(
        "%", "drops on the lens, as rain of so many per cent of 50 mm/h leaves them", worst=100.0, low=0.0,
        high=100.0,
    )  # fmt: skip
    calib_focal_share: float = fault(
        "1", "written focal lengths are larger by this share", worst=0.1, low=-0.9
    )
    calib_centre_px: float = fault("px", "added to the written principal point, to the right", worst=20.0)

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A colour picture of a faulty camera."""
        if not isinstance(sample, Image):
            return sample
        rgb, stamp_ns = sample.rgb, sample.stamp_ns
        if self.drops_percent:
            # Imported here: rigs know faults, and commands refuse mistakes before OpenCV is there.
            from carlaloc_env.sensors.imaging.lens_drops import with_lens_drops

            rain, camera = WeatherParameters(precipitation=self.drops_percent), f"{draws.target}/fault"
            rgb = with_lens_drops(rgb, rain, stamp_ns=stamp_ns, seed=draws.seed, camera=camera)
        if self.dirt_share:
            share = dirt(rgb.shape[:2], self.dirt_share, draws)[..., None]
            mixed = rgb * (1.0 - share) + np.array(DIRT_RGB, np.float32) * share + np.float32(0.5)
            rgb = mixed.astype(np.uint8)
        if self.exposure_stops:
            rgb = exposed(self.exposure_stops)[rgb]
        return replace(sample, rgb=rgb)

    def believed(self, config: SensorConfig) -> SensorConfig:
        """The configuration with the written mount and lens."""
        moved: Any = MountedFaults.believed(self, config)
        lens, scale = moved.pinhole, 1.0 + self.calib_focal_share
        focal: Any = {"fx_px": lens.fx_px * scale, "fy_px": lens.fy_px * scale}
        written: SensorConfig = replace(
            moved, pinhole=replace(lens, **focal, cx_px=lens.cx_px + self.calib_centre_px)
        )
        return written


def exposed(stops: float) -> NDArray[np.uint8]:
    """Values that all 256 sRGB values get under another exposure, shape (256,)."""
    code = np.arange(256) / 255.0
    light = np.where(code <= 0.04045, code / 12.92, elementary.power((code + 0.055) / 1.055, 2.4))
    light = np.minimum(light * float(elementary.power(2.0, stops)), 1.0)
    low = 12.92 * light
    code = np.where(
        light <= 0.0031308, low, 1.055 * elementary.power(np.maximum(light, 0.0031308), 1.0 / 2.4) - 0.055
    )
    return np.asarray(255.0 * code + 0.5, np.uint8)


def dirt(shape: tuple[int, ...], share: float, draws: Draws) -> NDArray[np.float32]:
    """Cover of each pixel by dirt, 0–1, shape (H, W); `share` of them are more than half hidden."""
    import cv2

    height, width = shape
    noise = draws.at("dirt").random(DIRT_CELLS).astype(np.float32)
    hills = cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    level = np.quantile(hills, 1.0 - share)
    return np.asarray(np.clip(0.5 + 12.0 * (hills - level), 0.0, 1.0), np.float32)
