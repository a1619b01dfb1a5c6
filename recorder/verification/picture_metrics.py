"""Metrics of a camera's picture that differ between real recordings and drawn ones.

They need no truth, so they hold for anybody's pictures.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array

WIDTH_PX = 1280
"""Wider pictures are shrunk to this width first, since all metrics depend on the number of pixels [px]."""
FAST_THRESHOLD, CELL_CORNERS, CELLS = 20, 5, (6, 8)
"""Difference [DN] of FAST's corners, corners of a cell that is covered, and rows and columns of cells."""
SATURATED_DN = 250
"""Pixels from this grey value on count as saturated [DN]."""
_REACH_PX, _END_PX, _STEP_DN, _UNEVEN = 7, 3, 40.0, 0.1
"""Edges: samples on each side [px], those of a plateau [px], least step [DN], its share of unevenness."""
_FINER = 8
"""Places between two samples at which a step is looked at."""
_BLOCK_PX, _FLATTEST_PERCENT = 24, 5.0
"""Noise: edge of a block [px], and the percentile of the blocks."""
_BAND = (0.02, 0.35)
"""Frequencies that the spectrum's slope is fitted over [cycles/px]."""
REAL_PICTURES = {
    "edge width [px]": (1.4, 3.6),
    "gradient p50 [DN/px]": (1.5, 2.6),
    "gradient p99/p50": (9.0, 34.0),
    "FAST corners": (1000.0, 3400.0),
    "cells with corners": (25.0, 48.0),
    "noise [DN]": (0.1, 2.5),
    "spectrum slope": (-3.6, -2.4),
    "saturated [%]": (0.0, 6.0),
    "contrast [DN]": (39.0, 81.0),
}
"""Least and largest values of real pictures by day, of 1280 pixels in width.

Seven pictures of nuScenes (Singapore, six cameras, JPEG; Caesar et al. 2020), three of KITTI (PNG; Geiger
et al. 2012) and one of Boreas (Burnett et al. 2023) measured with this module's functions or the same rules.
KITTI, whose pictures are sharpened and half as high, has gradients of 4.9 to 8.5 and 6700 to 8500 corners.
"""


def picture_metrics(image: NDArray[np.uint8]) -> dict[str, float]:
    """Metrics of a picture by name; NaN where a picture has nothing to measure.

    Args:
        image: Grey values (H, W), or colours in the order of OpenCV (H, W, 3).
    """
    codes: NDArray[Any] = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    if codes.shape[1] > WIDTH_PX:
        size = WIDTH_PX, round(codes.shape[0] * WIDTH_PX / codes.shape[1])
        codes = cv2.resize(codes, size, interpolation=cv2.INTER_AREA)
    codes = np.ascontiguousarray(codes, np.uint8)
    grey = codes.astype(np.float32)
    slope = np.hypot(*np.gradient(grey)).astype(np.float32)
    middle, strong = np.percentile(slope, (50, 99))
    corners, covered = fast_corners(codes)
    return {
        "edge width [px]": edge_width_px(grey),
        "gradient p50 [DN/px]": float(middle),
        "gradient p99/p50": float(strong / max(middle, 1e-3)),
        "FAST corners": float(corners),
        "cells with corners": float(covered),
        "noise [DN]": noise_dn(grey),
        "spectrum slope": spectrum_slope(grey),
        "saturated [%]": 100.0 * float((codes >= SATURATED_DN).mean()),
        "contrast [DN]": float(grey.std()),
    }


def edge_width_px(grey: F32) -> float:
    """Distance from 10 to 90 % of steps that lie along rows and columns, lower quartile [px].

    Softer steps are shadows and round things rather than the lens. A step counts if it is even on both
    sides and rises all the way. A Gaussian blur of σ gives 2.56 σ.
    """
    widths = np.concatenate([_step_widths(grey), _step_widths(np.ascontiguousarray(grey.T))])
    return float(np.percentile(widths, 25)) if len(widths) else float("nan")


def _step_widths(grey: F32) -> Array:
    """Widths of the steps along the rows of a picture [px], shape (N,)."""
    along = np.abs(grey[:, 2:] - grey[:, :-2])
    across = np.abs(np.gradient(grey, axis=0))[:, 1:-1]
    reach = _REACH_PX
    peak = np.zeros(grey.shape, bool)
    # The steepest place of its row that turns little: a step that rows cross at a right angle.
    steepest = along >= cv2.dilate(along, np.ones((1, 2 * reach + 1), np.uint8))
    peak[:, 1:-1] = steepest & (along > 0.25 * _STEP_DN) & (2 * across < 0.15 * along)
    peak[:, :reach] = peak[:, -reach:] = False
    row, column = np.nonzero(peak)
    if not len(row):
        return np.zeros(0)
    lines = grey[row[:, None], column[:, None] + np.arange(-reach, reach + 1)]
    left, right = lines[:, :_END_PX], lines[:, -_END_PX:]
    low, step = left.mean(axis=1), right.mean(axis=1) - left.mean(axis=1)
    size = np.abs(step)
    even = (np.ptp(left, axis=1) < _UNEVEN * size) & (np.ptp(right, axis=1) < _UNEVEN * size)
    share = (lines - low[:, None]) / np.where(step == 0, 1.0, step)[:, None]
    even &= (size > _STEP_DN) & (np.diff(share, axis=1).min(axis=1) > -0.5 * _UNEVEN)
    even &= (low > 5) & (low < SATURATED_DN) & (low + step > 5) & (low + step < SATURATED_DN)
    if not even.any():
        return np.zeros(0)
    wide = _FINER * share.shape[1], int(even.sum())
    share = cv2.resize(share[even], wide, interpolation=cv2.INTER_CUBIC).astype(np.float64)
    return (_crossing(share, 0.9) - _crossing(share, 0.1)) / _FINER


def _crossing(share: Array, level: float) -> Array:
    """Places, between samples, at which rows of (N, M) first exceed a level, shape (N,)."""
    after = np.maximum(np.argmax(share > level, axis=1), 1)
    rows = np.arange(len(share))
    before = share[rows, after - 1]
    place: Array = after - (share[rows, after] - level) / np.maximum(share[rows, after] - before, 1e-6)
    return place


def fast_corners(codes: NDArray[np.uint8]) -> tuple[int, int]:
    """Number of FAST corners, and of 6 × 8 cells with at least five of them."""
    corners = cv2.FastFeatureDetector.create(FAST_THRESHOLD).detect(codes)
    if not corners:
        return 0, 0
    x, y = np.array([corner.pt for corner in corners]).T
    (rows, columns), (height, width) = CELLS, codes.shape
    cell = (y * rows / height).astype(int) * columns + (x * columns / width).astype(int)
    return len(corners), int((np.bincount(cell, minlength=rows * columns) >= CELL_CORNERS).sum())


def noise_dn(grey: F32) -> float:
    """Deviation of the noise in the flattest blocks of a picture [DN], after Immerkær (1996).

    His mask is blind to planes, so that shades that run over a block do not count.
    """
    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    rest = np.abs(cv2.filter2D(grey, -1, mask))[1:-1, 1:-1]
    inside = grey[1:-1, 1:-1]
    blocks = [_blocks(field) for field in (rest, inside)]
    level = blocks[1].mean(axis=(1, 2))
    usable = (level > 15) & (level < 240)
    sizes = np.sqrt(np.pi / 2) / 6 * blocks[0][usable].mean(axis=(1, 2))
    return float(np.percentile(sizes, _FLATTEST_PERCENT)) if len(sizes) else float("nan")


def _blocks(field: F32) -> F32:
    """Squares of a picture, shape (N, edge, edge)."""
    edge = _BLOCK_PX
    rows, columns = (length // edge for length in field.shape)
    squares = field[: rows * edge, : columns * edge].reshape(rows, edge, columns, edge)
    return squares.swapaxes(1, 2).reshape(-1, edge, edge)


def spectrum_slope(grey: F32) -> float:
    """Exponent of the power spectrum over frequency, of the largest square in the middle.

    Natural scenes have about −2 (Field 1987), blurred ones less; noise that is white has 0.
    """
    edge = min(grey.shape)
    top, left = ((length - edge) // 2 for length in grey.shape)
    square = grey[top : top + edge, left : left + edge]
    window = np.hanning(edge)
    power = np.abs(np.fft.fft2((square - square.mean()) * window[:, None] * window)) ** 2
    axis = np.fft.fftfreq(edge)
    frequency = np.hypot(axis[:, None], axis)
    bins = np.geomspace(*_BAND, 25)
    which = np.digitize(frequency.ravel(), bins) - 1
    inside = (which >= 0) & (which < len(bins) - 1)
    count = np.bincount(which[inside], minlength=len(bins) - 1)
    mean = np.bincount(which[inside], power.ravel()[inside], len(bins) - 1) / np.maximum(count, 1)
    used = (count > 0) & (mean > 0)
    if used.sum() < 3:
        return float("nan")
    centre = np.sqrt(bins[1:] * bins[:-1])
    return float(np.polyfit(np.log(centre[used]), np.log(mean[used]), 1)[0])
