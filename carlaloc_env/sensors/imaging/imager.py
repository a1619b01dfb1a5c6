"""The imager: from light on the pixels to numbers in the picture, after EMVA 1288.

N = η·E·t electrons gather in a pixel during the exposure t, with Poisson noise; reading adds a
normal one. Gain, conversion to whole numbers and a tone curve follow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import F32
from carlaloc_env.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class ImagerConfig:
    """A global-shutter imager with 3 µm pixels behind f/2.8, and its exposure control."""

    exposure_min_ms: float = 0.05
    """Shortest exposure [ms]."""
    exposure_max_ms: float = 20.0
    """Longest exposure [ms]; the control lengthens the exposure before it raises the gain."""
    gain_max_db: float = 24.0
    """Highest gain [dB]."""
    target: float = 0.18
    """Mean level that the control aims at, as a share of the largest number, before the tone curve."""
    reaction_s: float = 0.3
    """Time in which the control makes up 63 % of an error [s]."""
    electrons_per_cd_m2_s: float = 2000.0
    """Electrons in a pixel per luminance and time [e⁻/(cd/m²·s)]: 3 µm, f/2.8, 60 % quantum efficiency."""
    full_well_e: float = 10000.0
    """Electrons that give the largest number at 0 dB [e⁻]."""
    read_noise_e: float = 3.0
    """Standard deviation of reading a pixel [e⁻]."""
    dark_signal_e: float = 1.0
    """Standard deviation of the pixels' fixed offsets [e⁻] (DSNU)."""
    response: float = 0.005
    """Standard deviation of the pixels' fixed sensitivities, as a share (PRNU)."""
    noise: bool = True
    """Whether there is any noise."""
    adc_bits: int = 12
    """Bits of the converter."""
    gamma: float = 2.2
    """Exponent of the tone curve; 1 = linear."""
    vignetting: float = 0.3
    """Light lost at the farthest corner, as a share; it grows with the square of the distance."""
    restart_s: float = 5.0
    """The control begins anew, settled, at multiples of this time [s]."""

    def __post_init__(self) -> None:
        if not 0 < self.exposure_min_ms <= self.exposure_max_ms:
            raise ConfigError("imager: exposure_min_ms must be above zero and not above exposure_max_ms")
        if not 0 < self.target < 1 or not 8 <= self.adc_bits <= 16 or not 0 <= self.vignetting < 1:
            ranges = "target must lie between 0 and 1, adc_bits from 8 to 16, vignetting from 0 to 1"
            raise ConfigError(f"imager: {ranges}")
        positive = (self.reaction_s, self.electrons_per_cd_m2_s, self.full_well_e, self.gamma, self.restart_s)
        noises = (self.gain_max_db, self.read_noise_e, self.dark_signal_e, self.response)
        if min(positive) <= 0 or min(noises) < 0:
            raise ConfigError("imager: sizes and times must be above zero, noise and gain not below")

    def settled(self, level_cd_m2: float) -> float:
        """Exposure times gain [s] that brings a mean luminance [cd/m²] to the target, within limits."""
        wanted = self.target * self.full_well_e / (self.electrons_per_cd_m2_s * max(level_cd_m2, 1e-6))
        highest = 1e-3 * self.exposure_max_ms * 10 ** (self.gain_max_db / 20)
        return float(min(max(wanted, 1e-3 * self.exposure_min_ms), highest))

    def controlled(self, product_s: float, level_cd_m2: float, period_s: float) -> float:
        """Exposure times gain [s] of the next picture: a first-order lag of its logarithm."""
        share = 1.0 - math.exp(-period_s / self.reaction_s)
        return float(product_s * (self.settled(level_cd_m2) / product_s) ** share)

    def split(self, product_s: float) -> tuple[float, float]:
        """Exposure [s] and gain (factor) of their product."""
        exposure_s = min(product_s, 1e-3 * self.exposure_max_ms)
        return exposure_s, product_s / exposure_s


class Imager:
    """One imager with its fixed patterns."""

    def __init__(self, config: ImagerConfig, name: str, shape: tuple[int, int], seed: int) -> None:
        self.config = config
        self._name, self._seed = f"imager_{name}", seed
        v, u = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
        x, y = u - np.float32(shape[1] / 2), v - np.float32(shape[0] / 2)
        rr = (x * x + y * y) / np.float32((shape[1] ** 2 + shape[0] ** 2) / 4)
        light = np.float32(1) - np.float32(config.vignetting) * rr
        self._response = np.repeat(light[..., None], 3, axis=2)
        self._offset_e = np.zeros((*shape, 3), np.float32)
        if config.noise:
            generator = clock.stream(seed, f"{self._name}/pattern")
            spread = generator.standard_normal((2, *shape, 3), dtype=np.float32)
            self._response *= np.float32(1) + np.float32(config.response) * spread[0]
            self._offset_e = np.float32(config.dark_signal_e) * spread[1]
        top = 1 << config.adc_bits
        curve = [255.0 * (k / (top - 1)) ** (1.0 / config.gamma) for k in range(top)]
        self._curve = np.array([round(value) for value in curve], np.uint8)

    def level_cd_m2(self, radiance_cd_m2: F32) -> float:
        """Input of the exposure control: mean luminance of every eighth pixel [cd/m²]."""
        some = radiance_cd_m2[::8, ::8].astype(np.float64)
        luminance = 0.2126 * some[..., 0] + 0.7152 * some[..., 1] + 0.0722 * some[..., 2]
        return float(luminance.mean())

    def picture(self, radiance_cd_m2: F32, product_s: float, stamp_ns: int) -> NDArray[np.uint8]:
        """Picture of a mean radiance over the exposure.

        Args:
            radiance_cd_m2: Linear BT.709 colour [cd/m²], shape (H, W, 3).
            product_s: Exposure times gain [s].
            stamp_ns: Time of the picture [ns]; keys its noise.
        """
        config = self.config
        exposure_s, gain = config.split(product_s)
        electrons = radiance_cd_m2 * np.float32(config.electrons_per_cd_m2_s * exposure_s)
        electrons *= self._response
        if config.noise:
            generator = clock.stream(self._seed, f"{self._name}/noise", stamp_ns)
            lot = generator.standard_normal(electrons.shape, dtype=np.float32)
            electrons += lot * np.sqrt(electrons + np.float32(config.read_noise_e**2)) + self._offset_e
        top = (1 << config.adc_bits) - 1
        electrons *= np.float32(top * gain / config.full_well_e)
        numbers = np.clip(np.rint(electrons), 0, top).astype(np.uint16)
        picture: NDArray[np.uint8] = self._curve[numbers]
        return picture
