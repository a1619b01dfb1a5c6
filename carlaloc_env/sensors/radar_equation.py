"""Radar equation: from echoes to detections, with fluctuation, resolution cells and errors.

All functions are pure; angles in radians, levels in dB, detections as parallel arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.parallel_arrays import ParallelArrays

RAIN_77_GHZ = (1.13, 0.718)
"""k and α of γ = k·R^α [dB/km], R in mm/h, at 77 GHz; ITU-R P.838-3, between its rows of 70 and 80 GHz."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RadarEchoes(ParallelArrays):
    """Scatterers in the radar's view, N of them."""

    range_m: Array
    """Distance [m], shape (N,)."""
    azimuth_rad: Array
    """Angle to the left of the x axis [rad], shape (N,)."""
    elevation_rad: Array
    """Angle above the x-y plane [rad], shape (N,)."""
    doppler_mps: Array
    """Rate of the distance [m/s], positive = moving away, shape (N,)."""
    rcs_m2: Array
    """Mean radar cross-section [m²], shape (N,)."""
    tag: NDArray[np.uint8]
    """Semantic `Tag`, shape (N,)."""
    instance: NDArray[np.uint32]
    """Instance id, 0 = none, shape (N,)."""

    def __len__(self) -> int:
        return len(self.range_m)


def snr_at(pd: float, pfa: float) -> float:
    """Mean signal-to-noise ratio at which a Swerling-1 target is detected with probability `pd`.

    Inverse of P_d = P_fa^(1/(1+S)) (Swerling 1954; Skolnik, "Introduction to Radar Systems").
    """
    return float(elementary.log(pfa) / elementary.log(pd)) - 1.0


def merge_cells(echoes: RadarEchoes, cell: tuple[float, float, float, float]) -> RadarEchoes:
    """One echo per resolution cell: cross-sections add, the position is their power-weighted middle.

    The strongest scatterer lends its tag and instance.

    Args:
        echoes: Scatterers.
        cell: Size of a cell in range [m], azimuth [rad], elevation [rad] and Doppler [m/s].
    """
    if len(echoes) == 0:
        return echoes
    values = (echoes.range_m, echoes.azimuth_rad, echoes.elevation_rad, echoes.doppler_mps)
    key = np.zeros(len(echoes), dtype=np.int64)
    for value, size in zip(values, cell, strict=True):
        key = key * 4096 + (np.floor(value / size).astype(np.int64) + 2048)
    order = np.lexsort((-echoes.rcs_m2, key))
    sorted_key = key[order]
    begins = np.flatnonzero(np.concatenate([[True], sorted_key[1:] != sorted_key[:-1]]))
    weight = echoes.rcs_m2[order]
    total = np.add.reduceat(weight, begins)

    def mean(value: Array) -> Array:
        summed: Array = np.add.reduceat(value[order] * weight, begins) / total
        return summed

    strongest = order[begins]
    range_m, azimuth, elevation, doppler = (mean(value) for value in values)
    return RadarEchoes(
        range_m=range_m,
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        doppler_mps=doppler,
        rcs_m2=total,
        tag=echoes.tag[strongest],
        instance=echoes.instance[strongest],
    )


def mean_snr(
    range_m: Array,
    rcs_m2: Array,
    *,
    at_reference: float,
    reference_m: float,
    pattern: Array,
    loss_db_per_m: float = 0.0,
) -> Array:
    """Mean signal-to-noise ratio of echoes, linear, shape (N,); falls with R⁻⁴ (radar equation).

    Args:
        range_m: Distances of scatterers or cells [m], shape (N,).
        rcs_m2: Their mean radar cross-sections [m²], shape (N,).
        at_reference: Ratio of a target of 1 m² on the axis at the reference distance.
        reference_m: Reference distance [m].
        pattern: Two-way antenna gain relative to the axis, linear, shape (N,).
        loss_db_per_m: One-way attenuation of the air [dB/m].
    """
    ratio = reference_m / range_m
    squared = ratio * ratio
    air: Array = elementary.power(10.0, -0.2 * loss_db_per_m * range_m)
    return at_reference * rcs_m2 * squared * squared * pattern * air


def detect(snr: Array, pfa: float, uniform: Array) -> tuple[NDArray[np.intp], Array]:
    """Fluctuating echoes that cross the threshold of a square-law detector, and their measured ratios.

    The detector's output of a Swerling-1 target is exponential with mean 1 + S; the threshold
    −ln P_fa gives P_d = P_fa^(1/(1+S)).

    Args:
        snr: Mean ratios, linear, shape (N,).
        pfa: Probability of a false alarm per cell.
        uniform: Uniform numbers of (0, 1], shape (N,).

    Returns:
        Indices of detections (M,) and their measured ratios, linear (M,).
    """
    output = -(1.0 + snr) * elementary.log(uniform)
    seen = np.flatnonzero(output > -elementary.log(pfa))
    return seen, output[seen] - 1.0


def errors(snr: Array, resolution: float, normal: Array) -> Array:
    """Measuring errors: standard deviation resolution / √(2 SNR), no less than a tenth of the resolution.

    The bound of a single echo's delay, angle or frequency (Richards, "Fundamentals of Radar Signal
    Processing", ch. 7); the floor stands for quantisation and calibration.
    """
    return normal * np.maximum(resolution / np.sqrt(2.0 * snr), 0.1 * resolution)


def rain_loss_db_per_m(rain_mmph: float) -> float:
    """One-way attenuation by rain at 77 GHz [dB/m]; fog and dust are negligible at 4 mm wavelength."""
    k, alpha = RAIN_77_GHZ
    return 1e-3 * k * float(elementary.power(rain_mmph, alpha)) if rain_mmph > 0 else 0.0
