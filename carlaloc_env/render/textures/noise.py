"""Periodic noise on a square of pixels: spectral, cellular and streaked; everything wraps."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Field = NDArray[np.float32]
"""A square of numbers that wraps."""
Layer = NDArray[np.float32]
"""Linear albedo in RGB, roughness in A, shape (S, S, 4)."""


class WorleyCells(NamedTuple):
    """Worley noise: distances in units of a cell, and which cell is nearest."""

    nearest: Field
    second: Field
    owner: NDArray[np.int64]

    @property
    def edge(self) -> Field:
        """Zero on the border between two cells, growing inwards."""
        return self.second - self.nearest


def fbm(
    rng: np.random.Generator,
    size: int,
    longest: float,
    shortest: float,
    gain: float = 0.7,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Field:
    """Fractal noise of mean 0 and deviation 1, made in the frequency domain, so that it wraps.

    Args:
        rng: Source of randomness.
        size: Edge [px].
        longest: Longest wavelength as a share of the tile.
        shortest: Shortest wavelength as a share of the tile.
        gain: Amplitude of an octave over that of the octave below.
        stretch: How many times longer the noise is along u and v.
    """
    white = rng.standard_normal((size, size), dtype=np.float32)
    fu = np.fft.rfftfreq(size, 1.0 / size).astype(np.float32)[None, :] * stretch[0]
    fv = np.fft.fftfreq(size, 1.0 / size).astype(np.float32)[:, None] * stretch[1]
    f = np.sqrt(fu * fu + fv * fv)
    f[0, 0] = 1.0
    # In two dimensions an octave holds f² coefficients, hence the further 1/f.
    weight = f ** np.float32(np.log2(gain) - 1.0)
    low, high = 1.0 / longest, 1.0 / shortest
    weight *= np.clip(2.0 * f / low - 1.0, 0.0, 1.0) * np.clip(2.0 - f / high, 0.0, 1.0)
    weight[0, 0] = 0.0
    field = np.fft.irfft2(np.fft.rfft2(white) * weight, s=(size, size)).astype(np.float32)
    return field / np.float32(max(float(field.std()), 1e-9))


def worley(rng: np.random.Generator, size: int, columns: int, rows: int, jitter: float = 0.9) -> WorleyCells:
    """Cellular noise of one jittered point per cell of a wrapped grid."""
    points = 0.5 + jitter * (rng.random((rows, columns, 2), dtype=np.float32) - 0.5)
    u = (np.arange(size, dtype=np.float32) + 0.5) / size * columns
    v = (np.arange(size, dtype=np.float32) + 0.5) / size * rows
    cu, cv = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    nearest = second = np.full((size, size), np.inf, np.float32)
    index = np.zeros((size, size), np.int64)
    for dv in (-1, 0, 1):
        row = (cv + dv) % rows
        for du in (-1, 0, 1):
            column = (cu + du) % columns
            point = points[row[:, None], column[None, :]]
            x = (cu + du).astype(np.float32)[None, :] + point[..., 0] - u[None, :]
            y = (cv + dv).astype(np.float32)[:, None] + point[..., 1] - v[:, None]
            distance = np.sqrt(x * x + y * y)
            closer = distance < nearest
            second = np.where(closer, nearest, np.minimum(second, distance))
            nearest = np.where(closer, distance, nearest)
            index = np.where(closer, row[:, None] * columns + column[None, :], index)
    return WorleyCells(nearest, second, index)


def smoothstep(low: float, high: float, x: ArrayLike) -> Field:
    """0 below `low`, 1 above `high`, smooth between; falls when `low` > `high`."""
    t = np.clip((np.asarray(x, dtype=np.float32) - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t), dtype=np.float32)


def per_cell(rng: np.random.Generator, index: NDArray[np.int64], spread: float) -> Field:
    """One normal number of a deviation per cell."""
    count = int(index.max()) + 1
    return (spread * rng.standard_normal(count)).astype(np.float32)[index]


def coordinates(size: int) -> tuple[Field, Field]:
    """u and v of the pixel centres as shares of the tile, shapes (1, S) and (S, 1)."""
    axis = ((np.arange(size) + 0.5) / size).astype(np.float32)
    return axis[None, :], axis[:, None]


def blocks(
    size: int, columns: int, rows: int, shift: float, wobble: Field | None = None
) -> tuple[NDArray[np.int64], Field, Field]:
    """Masonry bond: index of each block, and the distances to its borders as shares of a block.

    Args:
        size: Edge [px].
        columns: Blocks along u.
        rows: Courses along v; even when `shift` is not 0.
        shift: Offset of every second course as a share of a block.
        wobble: Displacement of the joints as a share of a course.
    """
    u, v = coordinates(size)
    y = v * rows + np.zeros((size, size), np.float32)
    if wobble is not None:
        y = y + wobble
    row = np.floor(y).astype(np.int64)
    x = u * columns + shift * (row % 2)
    if wobble is not None:
        x = x + 0.4 * wobble
    column = np.floor(x).astype(np.int64)
    inside_u, inside_v = x - column, y - row
    to_side = np.minimum(inside_u, 1 - inside_u).astype(np.float32)
    to_bed = np.minimum(inside_v, 1 - inside_v).astype(np.float32)
    return (row % rows) * columns + column % columns, to_side, to_bed


def layer(
    mean: tuple[float, float, float], relief: ArrayLike, roughness: ArrayLike = 0.8, hue: Field | None = None
) -> Layer:
    """Albedo of a given mean times exp(relief), with a roughness channel.

    Args:
        mean: Mean linear albedo.
        relief: Logarithm of the brightness, shape (S, S) or (S, S, 3).
        roughness: Roughness 0–1.
        hue: Extra warmth: +1 doubles red over blue.
    """
    log = np.asarray(relief, dtype=np.float32)
    if log.ndim == 2:
        log = np.repeat(log[..., None], 3, axis=-1)
    if hue is not None:
        log = log + hue[..., None] * np.array([0.5, 0.0, -0.5], np.float32)
    rgb = np.exp(log)
    for _ in range(3):
        # Clipping shifts the mean a little; a few rounds bring it back.
        rgb = rgb * (np.array(mean, np.float32) / rgb.mean(axis=(0, 1)))
        rgb = np.clip(rgb, 0.02, 0.85)
    return with_roughness(rgb, roughness)


def with_roughness(rgb: Field, roughness: ArrayLike) -> Layer:
    """Layer of a picture and its roughness."""
    alpha = np.broadcast_to(np.asarray(roughness, dtype=np.float32), rgb.shape[:2])[..., None]
    rgba = np.concatenate([np.clip(rgb, 0.02, 0.85), np.clip(alpha, 0.02, 1.0)], axis=-1)
    return rgba.astype(np.float32)


def levelled(tile: Layer, cycles: float) -> Layer:
    """The same layer without its slow variations, which show as a grid where many tiles lie side by side.

    Of the slowest ones 12 % stay.

    Args:
        tile: A layer that repeats.
        cycles: Variations with fewer cycles per tile than this are weakened; the fall-off is Gaussian.
    """
    log = np.log(tile[..., :3])
    size = log.shape[0]
    k = np.fft.fftfreq(size, 1.0 / size)
    slow = np.exp(-(k[:, None] ** 2 + k[None, :] ** 2) / cycles**2)
    gain = 1.0 - (1.0 - 0.12) * slow
    gain[0, 0] = 1.0
    flat = np.fft.ifft2(np.fft.fft2(log, axes=(0, 1)) * gain[..., None], axes=(0, 1)).real
    rgb = np.exp(flat)
    rgb *= tile[..., :3].mean(axis=(0, 1)) / rgb.mean(axis=(0, 1))
    return with_roughness(rgb.astype(np.float32), tile[..., 3])


def softened(tile: Layer, contrast: float) -> Layer:
    """The same layer with less contrast about its mean, as dust, haze and the lens leave it."""
    mean = tile[..., :3].mean(axis=(0, 1), keepdims=True)
    rgb = mean * (tile[..., :3] / mean) ** np.float32(contrast)
    rgb *= mean / rgb.mean(axis=(0, 1), keepdims=True)
    return with_roughness(rgb.astype(np.float32), tile[..., 3])
