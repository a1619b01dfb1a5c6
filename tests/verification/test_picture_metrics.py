"""Metrics of pictures whose blur, noise, spectrum and saturation are known."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import erf

from carlaloc_env.core import clock
from recorder.verification.picture_metrics import (
    REAL_PICTURES,
    WIDTH_PX,
    edge_width_px,
    fast_corners,
    noise_dn,
    picture_metrics,
    spectrum_slope,
)


def stripes(sigma_px: float, shape: tuple[int, int] = (240, 400)) -> NDArray[np.float32]:
    """Dark and bright stripes whose borders, at many places in a pixel, have a normal blur."""
    x = np.arange(shape[1])
    steps = np.arange(13.0, shape[1] - 10, 31.37)
    level = 60.0 + sum(
        (80.0 if k % 2 == 0 else -80.0) * 0.5 * (1 + erf((x - at) / (sigma_px * np.sqrt(2.0))))
        for k, at in enumerate(steps)
    )
    return np.broadcast_to(level, shape).astype(np.float32)


@pytest.mark.parametrize(("sigma_px", "within_px"), [(0.6, 0.25), (1.0, 0.15), (1.6, 0.15)])
@pytest.mark.parametrize("turned", [False, True])
def test_width_of_an_edge_is_that_of_its_blur(sigma_px: float, within_px: float, turned: bool) -> None:
    picture = np.ascontiguousarray(stripes(sigma_px).T) if turned else stripes(sigma_px)
    # Φ⁻¹(0.9) − Φ⁻¹(0.1) = 2.563; straight lines between samples widen steps that are hardly sampled.
    assert edge_width_px(picture) == pytest.approx(2.563 * sigma_px, abs=within_px)


def test_a_plain_picture_has_no_edge_and_no_corner() -> None:
    plain = np.full((240, 320), 90, np.uint8)
    assert np.isnan(edge_width_px(plain.astype(np.float32)))
    metrics = picture_metrics(plain)
    assert metrics["FAST corners"] == metrics["contrast [DN]"] == metrics["saturated [%]"] == 0
    assert list(metrics) == list(REAL_PICTURES)


@pytest.mark.parametrize("sigma_dn", [0.5, 2.0])
def test_noise_is_found_under_a_shade(sigma_dn: float) -> None:
    noise = clock.stream(3, "noise").standard_normal((480, 640)).astype(np.float32)
    shade = np.linspace(40, 200, 640, dtype=np.float32)
    assert noise_dn(shade + np.float32(sigma_dn) * noise) == pytest.approx(sigma_dn, rel=0.10)


@pytest.mark.parametrize("exponent", [-2.0, -3.0])
def test_slope_is_that_of_the_spectrum(exponent: float) -> None:
    axis = np.fft.fftfreq(512)
    frequency = np.maximum(np.hypot(axis[:, None], axis), 1 / 512)
    white = np.fft.fft2(clock.stream(5, "spectrum").standard_normal((512, 512)))
    picture = np.fft.ifft2(white * frequency ** (exponent / 2)).real
    assert spectrum_slope(picture.astype(np.float32)) == pytest.approx(exponent, abs=0.1)


def test_corners_are_counted_by_cells() -> None:
    board = np.full((480, 640), 40, np.uint8)
    # Six squares of four corners each in the first of 6 × 8 cells, one square in the last.
    for x, y in ((5, 5), (25, 5), (45, 5), (5, 35), (25, 35), (45, 35), (600, 440)):
        board[y : y + 12, x : x + 12] = 200
    # Without a lens neighbours are equally good corners, of which none is the best.
    count, covered = fast_corners(cv2.GaussianBlur(board, (5, 5), 0.8))
    assert count == 28
    assert covered == 1


def test_saturation_and_size() -> None:
    picture = np.zeros((400, 2 * WIDTH_PX, 3), np.uint8)
    picture[:, : WIDTH_PX // 2] = 255
    metrics = picture_metrics(picture)
    assert metrics["saturated [%]"] == pytest.approx(25.0, abs=0.1)
    small = cv2.resize(picture, (WIDTH_PX, 200), interpolation=cv2.INTER_AREA)
    assert picture_metrics(small) == pytest.approx(metrics, nan_ok=True)
