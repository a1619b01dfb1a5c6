"""A common industrial colour camera by its data sheet: Balluff BVS CA-SF2-0016Z with Sony's IMX273.

The sheet (Technical Documentation BVS CA-SF, "mvBlueFOX3-2016", assets.balluff.com) gives, measured after
EMVA 1288: global shutter, pixels of 3.45 µm, 12 bits, SNR_max 40.2 dB, dynamic range 71.4 dB.
"""

import math

from carlaloc_env.core.camera_model import Lens
from carlaloc_env.sensors.camera_config import ImagerConfig, ShutterConfig

SNR_MAX_DB, DYNAMIC_RANGE_DB, ADC_BITS, PIXEL_UM = 40.2, 71.4, 12, 3.45
"""Figures of the data sheet."""


def saturation_capacity_e() -> float:
    """Electrons at saturation [e⁻]; only shot noise counts there: SNR_max = √N (EMVA 1288 release 3.1)."""
    return float(10.0 ** (SNR_MAX_DB / 10.0))


def temporal_dark_noise_e() -> float:
    """Noise of reading [e⁻].

    The dynamic range is the saturation capacity over the sensitivity threshold, which is
    √(σ_d² + σ_q²/K² + ¼) + ½ electrons (EMVA 1288 release 3.1) with σ_q² = 1/12 of converting.
    """
    full_e = saturation_capacity_e()
    threshold_e = full_e / 10.0 ** (DYNAMIC_RANGE_DB / 20.0)
    electrons_per_number = full_e / (2**ADC_BITS - 1)
    return math.sqrt((threshold_e - 0.5) ** 2 - 0.25 - electrons_per_number**2 / 12.0)


def industrial_imager() -> ImagerConfig:
    """Imager of the camera; unevenness of pixels, which the sheet leaves out, is typical (1 e⁻, 0.5 %)."""
    return ImagerConfig(
        full_well_e=round(saturation_capacity_e()),
        read_noise_e=round(temporal_dark_noise_e(), 2),
        adc_bits=ADC_BITS,
        bayer=True,
        # Of seven pictures of nuScenes and three of KITTI by day the mean is 0.18 to 0.23, tone curve undone.
        target=0.20,
        # The pixel's area (√1/12), and a lens at half of its contrast at 0.5 cycles/px (0.37).
        lens_blur_px=0.47,
        # The same lens and quantum efficiency over larger pixels than the default's 3 µm.
        electrons_per_cd_m2_s=round(ImagerConfig().electrons_per_cd_m2_s * (PIXEL_UM / 3.0) ** 2),
    )


def industrial_shutter() -> ShutterConfig:
    """A global shutter; light is gathered while it is open."""
    return ShutterConfig(motion_blur=True, readout_ms=0.0)


def wide_angle_lens() -> Lens:
    """Distortion of a wide-angle lens on such cameras: that of EuRoC's left camera (sensor.yaml of cam0)."""
    return Lens(model="radtan", coefficients=(-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05))
