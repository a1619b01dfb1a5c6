"""The imager: from light on the pixels to numbers in the picture, after EMVA 1288.

N = η·E·t electrons gather in a pixel during the exposure t, with Poisson noise; reading adds a normal one.
Gain, conversion to whole numbers and a tone curve follow.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import F32
from carlaloc_env.sensors.camera_config import ImagerConfig


class Imager:
    """One imager with its fixed patterns."""

    def __init__(self, config: ImagerConfig, name: str, shape: tuple[int, int], seed: int) -> None:
        self.config = config
        self._name, self._seed = f"imager_{name}", seed
        v, u = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
        x, y = u - np.float32(shape[1] / 2), v - np.float32(shape[0] / 2)
        rr = (x * x + y * y) / np.float32((shape[1] ** 2 + shape[0] ** 2) / 4)
        light = np.float32(1) - np.float32(config.vignetting) * rr
        pixels = shape if config.bayer else (*shape, 3)
        self._response = light.copy() if config.bayer else np.repeat(light[..., None], 3, axis=2)
        self._offset_e = np.zeros(pixels, np.float32)
        if config.noise:
            generator = clock.stream(seed, f"{self._name}/pattern")
            spread = generator.standard_normal((2, *pixels), dtype=np.float32)
            self._response *= np.float32(1) + np.float32(config.response) * spread[0]
            self._offset_e = np.float32(config.dark_signal_e) * spread[1]
        top = 1 << config.adc_bits
        curve = [round(255.0 * (k / (top - 1)) ** (1.0 / config.gamma)) for k in range(top)]
        self._curve = np.array(curve, np.uint8)

    def level_cd_m2(self, radiance_cd_m2: F32) -> float:
        """Input of the exposure control: mean luminance on every eighth pixel, behind the lens [cd/m²]."""
        response = self._response.reshape(*radiance_cd_m2.shape[:2], -1)
        some = (radiance_cd_m2[::8, ::8] * response[::8, ::8]).astype(np.float64)
        return float((0.2126 * some[..., 0] + 0.7152 * some[..., 1] + 0.0722 * some[..., 2]).mean())

    def picture(self, radiance_cd_m2: F32, product_s: float, stamp_ns: int) -> NDArray[np.uint8]:
        """Picture of a mean radiance over the exposure.

        Args:
            radiance_cd_m2: Linear BT.709 colour [cd/m²], shape (H, W, 3).
            product_s: Exposure times gain [s].
            stamp_ns: Time of the picture [ns]; keys its noise.
        """
        config = self.config
        exposure_s, gain = config.split(product_s)
        light = radiance_cd_m2
        if config.lens_blur_px:
            light = np.asarray(cv2.GaussianBlur(light, (5, 5), config.lens_blur_px), np.float32)
        light = mosaic(light) if config.bayer else light
        electrons = light * np.float32(config.electrons_per_cd_m2_s * exposure_s)
        electrons *= self._response
        if config.noise:
            generator = clock.stream(self._seed, f"{self._name}/noise", stamp_ns)
            lot = generator.standard_normal(electrons.shape, dtype=np.float32)
            electrons += lot * np.sqrt(electrons + np.float32(config.read_noise_e**2)) + self._offset_e
        top = (1 << config.adc_bits) - 1
        electrons *= np.float32(top * gain / config.full_well_e)
        numbers = np.clip(np.rint(electrons), 0, top).astype(np.uint16)
        if config.bayer:
            # OpenCV names a pattern after its second row and column.
            numbers = np.asarray(cv2.cvtColor(numbers, cv2.COLOR_BayerBG2RGB), np.uint16)
        picture: NDArray[np.uint8] = self._curve[numbers]
        return picture


def mosaic(radiance_cd_m2: F32) -> F32:
    """Light that passes each pixel's colour filter, RGGB from the upper left, shape (H, W)."""
    seen = radiance_cd_m2[..., 1].copy()
    seen[::2, ::2], seen[1::2, 1::2] = radiance_cd_m2[::2, ::2, 0], radiance_cd_m2[1::2, 1::2, 2]
    return seen
