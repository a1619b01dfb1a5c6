"""Log intensity of event pixels against numpy's logarithm."""

import numpy as np
from scipy.ndimage import convolve1d

from carlaloc_env.sensors.event_camera.log_intensity import log_intensity


def test_log_is_the_logarithm_of_luminance_and_dark_current() -> None:
    rgb = np.random.default_rng(8).lognormal(3, 3, (32, 48, 3)).astype(np.float32)
    luminance = rgb.astype(np.float64) @ [0.2126, 0.7152, 0.0722]
    value = log_intensity(rgb, 0.05, blurred=False)
    np.testing.assert_allclose(value, np.log(luminance + 0.05), atol=2e-6)


def test_the_lens_blurs_over_three_pixels_each_way() -> None:
    rgb = np.random.default_rng(9).lognormal(3, 1, (33, 47, 3)).astype(np.float32)
    luminance = rgb.astype(np.float64) @ [0.2126, 0.7152, 0.0722]
    weights = [0.1065, 1 - 2 * 0.1065, 0.1065]
    for axis in (0, 1):
        luminance = convolve1d(luminance, weights, axis=axis, mode="nearest")
    value = log_intensity(rgb, 0.05, blurred=True)
    np.testing.assert_allclose(value, np.log(luminance + 0.05), atol=2e-6)
