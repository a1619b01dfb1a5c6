"""A receiver's own position from one epoch of pseudoranges: weighted least squares, and what it is worth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.geodesy import ecef_to_geodetic, local_axes
from carlaloc_env.core.parallel_arrays import ParallelArrays
from carlaloc_env.sensors.gnss_satellites import EARTH_RATE_RADPS, inverse_of
from carlaloc_env.sensors.raw_gnss.atmosphere import L1_HZ, klobuchar_m, saastamoinen_m
from carlaloc_env.sensors.raw_gnss.config import RangeErrors
from carlaloc_env.sensors.raw_gnss.orbits import Sky, turned
from carlaloc_env.sensors.raw_gnss.systems import LIGHT_MPS, WEEK_S

USED_DEG = 15.0
"""Elevation above which satellites are used, RTKLIB's default [deg]."""
_ROUNDS = 10
COMMON = 0.8
"""Part of the ionosphere's error that all satellites share; √(1 − 0.8²) of it is each satellite's own."""
_SURE_SIGMA, _DOP_MAX = 3.0902, 30.0
"""Residuals of a good position are refused once in 1000, RTKLIB's rule; largest dilution of precision."""
_DONE_M = 1e-4
"""Step that ends the iteration [m]."""
_NOISE_M, _BIAS_M, _IONOSPHERE, _TROPOSPHERE_M = 0.3, 0.3, 0.5, 0.3
"""Weights as RTKLIB has them: code noise, code bias [m], share of the ionosphere's delay, troposphere [m]."""
_NO_IONOSPHERE_M, _NO_TROPOSPHERE_M = 5.0, 3.0
"""The same where no model is applied [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranges(ParallelArrays):
    """Measurements of one signal of each of N satellites."""

    row: NDArray[np.intp]
    """Rows of the satellites in the `Sky`, shape (N,)."""
    frequency_hz: Array
    """Carriers [Hz], shape (N,)."""
    pseudorange_m: Array
    """Pseudoranges [m], shape (N,)."""
    doppler_hz: Array
    """Doppler shifts [Hz], shape (N,)."""
    sigma_m: Array
    """Standard deviations of the pseudoranges' noise [m], shape (N,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix:
    """A position; NaN without one."""

    geodetic: Array
    """Latitude [deg], longitude [deg], height above the ellipsoid [m]."""
    covariance_m2: Array
    """Covariance, east, north, up [m²], shape (3, 3)."""
    velocity_mps: Array
    """Velocity by Doppler, east, north, up [m/s]."""
    dop: Array
    """Dilutions of precision: position, horizontal, vertical."""

    @classmethod
    def none(cls) -> Fix:
        """No position."""
        nan = np.full(3, np.nan)
        return cls(geodetic=nan, covariance_m2=np.zeros((3, 3)), velocity_mps=nan, dop=nan)


def locate(
    sky: Sky,
    tag_ns: int,
    ranges: Ranges,
    errors: RangeErrors,
    start_m: Array,
) -> Fix:
    """Position, and the covariance of its error under open sky.

    Weights, models and the test of residuals are those of RTKLIB 2.4.3 in single mode, one clock a system.
    There is no position where that test fails, as with large reflections. The covariance is that of
    these weights with the errors' true sizes, so that it is worth as much as it says.

    Args:
        sky: Satellites and their messages.
        tag_ns: GPS time of the receiver's clock [ns].
        ranges: Measurements.
        errors: Sizes of the errors of messages and models; models are applied where these are.
        start_m: Where to begin, Earth-fixed [m]: a place within some kilometres.
    """
    code_m, left, velocities = _satellites(sky, tag_ns, ranges)
    _, elevation = look_angles(ecef_to_geodetic(start_m), left - start_m)
    used = np.flatnonzero(elevation > math.radians(USED_DEG))
    ranges, code_m, left, velocities = ranges.take(used), code_m[used], left[used], velocities[used]
    models = errors.models
    systems, column = np.unique([sky.records[k].system.letter for k in ranges.row], return_inverse=True)
    width = 3 + len(systems)
    if len(ranges.row) < width:
        return Fix.none()
    clocks = np.zeros((len(column), len(systems)))
    clocks[np.arange(len(column)), column] = 1.0
    place, offsets = start_m.copy(), np.zeros(len(systems))
    tow_s = tag_ns % (WEEK_S * 1_000_000_000) * 1e-9
    for _ in range(_ROUNDS):
        geodetic = ecef_to_geodetic(place)
        # The Earth turns while the light is on its way.
        turn_rad = EARTH_RATE_RADPS / LIGHT_MPS * np.sqrt(np.sum((left - place) ** 2, axis=-1))
        there = turned(left, turn_rad)
        to = there - place
        distance = np.sqrt(np.sum(to * to, axis=-1))
        unit = to / distance[:, None]
        azimuth, elevation = look_angles(geodetic, unit)
        up = np.maximum(elevation, 0.02)
        ion = klobuchar_m(geodetic, azimuth, up, tow_s) * (L1_HZ / ranges.frequency_hz) ** 2
        expected = distance + offsets[column] + ion * models[1] + saastamoinen_m(geodetic, up) * models[2]
        rows = np.concatenate([-unit, clocks], axis=1)
        variance = _variance(sky, ranges, up, ion, models)
        inverse = inverse_of(_weighted(rows, rows, 1.0 / variance))
        if inverse is None:
            return Fix.none()
        gain = np.sum(inverse[:, None, :] * (rows / variance[:, None])[None], axis=-1)
        step = np.sum(gain * (code_m - expected), axis=-1)
        place, offsets = place + step[:3], offsets + step[3:]
        if float(np.max(np.abs(step))) < _DONE_M:
            break
    axes, free = local_axes(*geodetic[:2]).T, len(rows) - width
    left_over = float(np.sum((code_m - expected) ** 2 / variance))
    dop = _dilutions(rows, axes)
    if (free and left_over > _largest_residual(free)) or not dop[0] < _DOP_MAX:
        return Fix.none()
    gain_enu = np.sum(axes[:, :, None] * gain[None, :3], axis=1)
    leaving = np.sum(unit * turned(velocities, turn_rad), axis=-1)
    turning = EARTH_RATE_RADPS * (unit[:, 0] * there[:, 1] - unit[:, 1] * there[:, 0])
    rate = LIGHT_MPS * (sky.clock_rate[ranges.row] - ranges.doppler_hz / ranges.frequency_hz)
    rate = rate * (1.0 + (leaving - turning) / LIGHT_MPS) - leaving
    return Fix(
        geodetic=ecef_to_geodetic(place),
        covariance_m2=_covariance(gain_enu, sky, ranges, errors, up, ion),
        velocity_mps=np.sum(gain_enu * rate, axis=-1),
        dop=dop,
    )


def _satellites(sky: Sky, tag_ns: int, ranges: Ranges) -> tuple[Array, Array, Array]:
    """Pseudoranges less satellites' clocks [m], and places and velocities at transmission, Earth-fixed."""
    row = ranges.row
    delay = [
        sky.records[k].delay_s(f) for k, f in zip(row.tolist(), ranges.frequency_hz.tolist(), strict=True)
    ]
    back_s = np.zeros(len(sky.records))
    back_s[row] = ranges.pseudorange_m / LIGHT_MPS + sky.clock_s(tag_ns)[row]
    places, velocities = sky.at(tag_ns, back_s)
    corrected = ranges.pseudorange_m + LIGHT_MPS * (sky.clock_s(tag_ns)[row] - np.array(delay))
    return corrected, places[row], velocities[row]


def _variance(sky: Sky, ranges: Ranges, up: Array, ion: Array, models: tuple[bool, bool, bool]) -> Array:
    """Variances of pseudoranges for the weights [m²], as RTKLIB 2.4.3 has them."""
    sine = elementary.sin(up)
    announced = np.array([sky.records[k].system.accuracy_m for k in ranges.row])
    # RTKLIB scales the variance as the delay, though its square is meant.
    scaled = _IONOSPHERE * ion * ranges.frequency_hz / L1_HZ
    air = scaled * scaled if models[1] else _NO_IONOSPHERE_M * _NO_IONOSPHERE_M
    low = (_TROPOSPHERE_M / (sine + 0.1)) ** 2 if models[2] else _NO_TROPOSPHERE_M * _NO_TROPOSPHERE_M
    noise = _NOISE_M * _NOISE_M * (1.0 + 1.0 / sine)
    variance: Array = noise + announced * announced + _BIAS_M * _BIAS_M + air + low
    return variance


def _covariance(gain: Array, sky: Sky, ranges: Ranges, errors: RangeErrors, up: Array, ion: Array) -> Array:
    """Covariance of the position, (3, 3), of errors of each range and of those that all share."""
    space = errors.signal_in_space * np.array([sky.records[k].system.signal_in_space_m for k in ranges.row])
    own = errors.ionosphere * math.sqrt(1.0 - COMMON * COMMON) * ion
    variance = ranges.sigma_m * ranges.sigma_m + space * space + own * own
    shared = np.stack([errors.ionosphere * COMMON * ion, errors.troposphere_m / elementary.sin(up)])
    moved = np.sum(gain[:, None, :] * shared[None], axis=-1)
    covariance: Array = np.sum(gain[:, None, :] * (gain * variance)[None], axis=-1)
    covariance += np.sum(moved[:, None, :] * moved[None], axis=-1)
    return covariance


def _dilutions(rows: Array, axes: Array) -> Array:
    """Dilutions of precision: position, horizontal, vertical."""
    inverse = inverse_of(_weighted(rows, rows, np.ones(len(rows))))
    if inverse is None:
        return np.full(3, np.inf)
    turned = np.sum(axes[:, :, None] * inverse[None, :3, :3], axis=1)
    east, north, up = np.sum(turned * axes, axis=-1)
    dilutions: Array = np.sqrt(np.array([east + north + up, east + north, up]))
    return dilutions


def _weighted(a: Array, b: Array, weight: Array) -> Array:
    """aᵀ·diag(weight)·b."""
    product: Array = np.sum(a[:, :, None] * (b * weight[:, None])[:, None, :], axis=0)
    return product


def look_angles(geodetic: Array, to: Array) -> tuple[Array, Array]:
    """Azimuths, clockwise from true north, and elevations [rad] of Earth-fixed vectors (N, 3)."""
    unit = to / np.sqrt(np.sum(to * to, axis=-1))[:, None]
    east, north, up = local_axes(*geodetic[:2]).T
    azimuth = elementary.arctan2(np.sum(unit * east, axis=-1), np.sum(unit * north, axis=-1))
    return azimuth, elementary.arcsin(np.clip(np.sum(unit * up, axis=-1), -1.0, 1.0))


def _largest_residual(free: int) -> float:
    """Chi-squared quantile, within 4 % (Wilson and Hilferty 1931) and the same on all processors."""
    spread = 2.0 / (9.0 * free)
    root = 1.0 - spread + _SURE_SIGMA * math.sqrt(spread)
    return free * root * root * root
