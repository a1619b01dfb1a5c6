"""Random surfaces with the spectrum of ISO 8608, the same in every direction.

Along a line G_d(n) = G_d(n₀)·(n/n₀)⁻ʷ, waviness w; tracks B apart have coherence 2·(x/2)ᵛ·Kᵥ(x)/Γ(v), x =
2πBn, v = w/2 (Dodds and Robson, "The description of road surface roughness", J. Sound Vib. 31, 1973; Kamash
and Robson, "The application of isotropy in road surface modelling", J. Sound Vib. 57, 1978).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled

ROAD_CLASSES = "ABCDEFGH"
"""Classes of ISO 8608, smooth to rough."""
REFERENCE_CPM = 0.1
"""Spatial frequency n₀ at which classes are defined [cycles/m]."""
UNIT_M3 = 1e-6
"""G_d(n₀) of a surface of level 1 [m³]."""
STANDARD_WAVINESS = 2.0
"""Waviness of the classes of ISO 8608."""
_TURN = (1.0 + math.sqrt(5.0)) / 2.0
"""Slope of the lattice against east: by the golden mean straight roads hardly meet their own past."""
_GRAIN_M = 2.0**-30
"""Coefficients lie on this grid [m], so that the last bit of a Fourier transform changes nothing."""


def class_roughness_m3(road_class: str) -> float:
    """G_d(n₀) of a class of ISO 8608, geometric mean [m³]: 16e-6 for A, four times more for each next."""
    return 16e-6 * 4.0 ** ROAD_CLASSES.index(road_class)


def class_level(road_class: str) -> float:
    """Height of a class over that of the unit surface: 4 for A, 8 for B, 16 for C."""
    return math.sqrt(class_roughness_m3(road_class) / UNIT_M3)


class WaveTable(NamedTuple):
    """A `RoughSurface` for compiled functions."""

    coefficients: NDArray[np.float32]
    """Of the B-spline, shape (K, K)."""
    to_lattice: tuple[float, float]
    """Cosine and sine of the turn from the world to the lattice, over its spacing [1/m]."""


class RoughSurface:
    """One isotropic surface with G_d(n₀) = `UNIT_M3`, periodic, twice differentiable.

    Args:
        seed: Number from which it is drawn.
        name: Name of its random stream.
        waves_cpm: Lowest and highest spatial frequency in it [cycles/m].
        spacing_m: Distance of its lattice's points, at most a third of the shortest wave [m].
        size: Points along each side of its period.
        blur_m: Standard deviation of the footprint over which heights are averaged [m].
        waviness: How fast the spectrum falls, w.
    """

    def __init__(
        self,
        seed: int,
        name: str,
        *,
        waves_cpm: tuple[float, float],
        spacing_m: float,
        size: int,
        blur_m: float = 0.0,
        waviness: float = STANDARD_WAVINESS,
    ) -> None:
        n: Array = np.fft.fftfreq(size, spacing_m).astype(np.float64)
        east, north = n[:, None], n[None, : size // 2 + 1]
        radius = np.hypot(east, north)
        inside = (radius >= waves_cpm[0]) & (radius < waves_cpm[1])
        # A two-sided density K·ρ⁻³ in the plane integrates to 4K·n⁻² along a line.
        density = 0.25 * UNIT_M3 * REFERENCE_CPM**2 / np.where(inside, radius**2 * radius, 1.0)
        if waviness != STANDARD_WAVINESS:
            # K·ρ⁻⁽ʷ⁺¹⁾ integrates to 2K·√π·Γ(w/2)/Γ((w+1)/2)·n⁻ʷ.
            line = math.sqrt(math.pi) * math.gamma(0.5 * waviness) / math.gamma(0.5 * waviness + 0.5)
            steeper = np.where(inside, radius / REFERENCE_CPM, 1.0) ** (STANDARD_WAVINESS - waviness)
            density = density * steeper * 2.0 / line
        gain: Array = np.where(inside, np.sqrt(density), 0.0) / spacing_m
        gain *= elementary.exp(-2.0 * (math.pi * blur_m * radius) ** 2)
        gain /= _knot_gain(east * spacing_m) * _knot_gain(north * spacing_m)
        white = clock.stream(seed, name).standard_normal((size, size))
        heights = np.fft.irfft2(np.fft.rfft2(white) * gain, s=(size, size))
        self._coefficients = (np.round(heights / _GRAIN_M) * _GRAIN_M).astype(np.float32)
        turn = float(elementary.arctan(_TURN))
        self._to_lattice = (float(elementary.cos(turn)) / spacing_m, float(elementary.sin(turn)) / spacing_m)

    def height(self, x_m: float, y_m: float) -> float:
        """Height at one place [m]."""
        return wave_height(self.table, x_m, y_m)

    @property
    def table(self) -> WaveTable:
        """The surface for compiled functions."""
        return WaveTable(self._coefficients, self._to_lattice)

    def heights(self, xy_m: Array) -> NDArray[np.float64]:
        """Height [m] and its slopes towards east and north at places (M, 2), shape (M, 3)."""
        # Lanes that are not finite are refused later, with their names.
        x, y = np.nan_to_num(np.asarray(xy_m, dtype=np.float64)[:, :2].T, posinf=0.0, neginf=0.0)
        size, (cos, sin) = len(self._coefficients), self._to_lattice
        u, v = cos * x + sin * y, cos * y - sin * x
        i, j = np.floor(u), np.floor(v)
        f, g = u - i, v - j
        rows = [((i + a - 1) % size).astype(np.intp) for a in range(4)]
        columns = [((j + b - 1) % size).astype(np.intp) for b in range(4)]
        weights, slopes = [_weight(b, g) for b in range(4)], [_weight_slope(b, g) for b in range(4)]
        z, zu, zv = np.zeros((3, len(x)))
        for a in range(4):
            wa, da = _weight(a, f), _weight_slope(a, f)
            for b in range(4):
                c = self._coefficients[rows[a], columns[b]]
                z += wa * weights[b] * c
                zu += da * weights[b] * c
                zv += wa * slopes[b] * c
        return np.stack([z, cos * zu - sin * zv, sin * zu + cos * zv], axis=1)


def _knot_gain(cycles: Array) -> Array:
    """Gain of a cubic B-spline from its coefficients to its knots, by cycles per knot."""
    gain: Array = (2.0 + elementary.cos(2.0 * math.pi * cycles)) / 3.0
    return gain


def _weight(k: int, f: Any) -> Any:
    """Weight of the k-th of four knots, f past the second."""
    if k == 0:
        return (1.0 - f) * ((1.0 - f) * (1.0 - f)) / 6.0
    if k == 1:
        return (3.0 * (f * (f * f)) - 6.0 * (f * f) + 4.0) / 6.0
    if k == 2:
        return (-3.0 * (f * (f * f)) + 3.0 * (f * f) + 3.0 * f + 1.0) / 6.0
    return f * (f * f) / 6.0


def _weight_slope(k: int, f: Any) -> Any:
    """Its derivative by f."""
    if k == 0:
        return -0.5 * ((1.0 - f) * (1.0 - f))
    if k == 1:
        return 1.5 * (f * f) - 2.0 * f
    if k == 2:
        return -1.5 * (f * f) + f + 0.5
    return 0.5 * (f * f)


_compiled_weight = compiled(_weight)


@compiled
def wave_height(table: WaveTable, x: float, y: float) -> float:
    """Height [m] at one place [m]: a cubic B-spline on a periodic lattice."""
    coefficients, (cos, sin) = table
    size = len(coefficients)
    u, v = cos * x + sin * y, cos * y - sin * x
    i, j = math.floor(u), math.floor(v)
    f, g = u - i, v - j
    total = 0.0
    for a in range(4):
        row = (i + a - 1) % size
        wa = _compiled_weight(a, f)
        for b in range(4):
            total += wa * _compiled_weight(b, g) * coefficients[row, (j + b - 1) % size]
    return total
