"""Delays of signals in the air, by the models that navigation messages and receivers share."""

from __future__ import annotations

import math

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.sensors.raw_gnss.systems import LIGHT_MPS

ALPHA = (1.1180e-8, -7.4510e-9, -5.9610e-8, 1.1920e-7)
BETA = (1.1670e5, -2.2940e5, -1.3110e5, 1.0490e6)
"""Coefficients of Klobuchar's model that all messages here have: those of 2004-01-01."""
L1_HZ = 1575.42e6
"""Carrier of the model's delay [Hz]."""
_HUMIDITY = 0.7


def klobuchar_m(geodetic: Array, azimuth_rad: Array, elevation_rad: Array, tow_s: float) -> Array:
    """Delay by the ionosphere on L1 [m] (IS-GPS-200, 20.3.3.5.2.5), shape (N,).

    Args:
        geodetic: Latitude [deg], longitude [deg] and height [m] of the antenna.
        azimuth_rad: Azimuths of the satellites [rad], shape (N,).
        elevation_rad: Their elevations [rad], shape (N,).
        tow_s: Time of the GPS week [s].
    """
    up = elevation_rad / math.pi
    angle = 0.0137 / (up + 0.11) - 0.022
    latitude = np.clip(geodetic[0] / 180.0 + angle * elementary.cos(azimuth_rad), -0.416, 0.416)
    aside = elementary.sin(azimuth_rad) / elementary.cos(latitude * math.pi)
    longitude = geodetic[1] / 180.0 + angle * aside
    magnetic = latitude + 0.064 * elementary.cos((longitude - 1.617) * math.pi)
    local_s = (43_200.0 * longitude + tow_s) % 86_400.0
    low = up - 0.53
    slant = 1.0 + 16.0 * np.abs(low * low * low)
    height = np.maximum(_polynomial(ALPHA, magnetic), 0.0)
    phase = 2.0 * math.pi * (local_s - 50_400.0) / np.maximum(_polynomial(BETA, magnetic), 72_000.0)
    square = phase * phase
    day = 5e-9 + height * (1.0 + square * (square / 24.0 - 0.5))
    delay: Array = LIGHT_MPS * slant * np.where(np.abs(phase) < 1.57, day, 5e-9)
    return delay


def saastamoinen_m(geodetic: Array, elevation_rad: Array) -> Array:
    """Delay by the troposphere of a standard atmosphere [m], shape (N,) (Saastamoinen 1972, as in RTKLIB).

    Args:
        geodetic: Latitude [deg], longitude [deg] and height [m] of the antenna.
        elevation_rad: Elevations of the satellites [rad], shape (N,).
    """
    height = max(float(geodetic[2]), 0.0)
    pressure = 1013.25 * elementary.power(1.0 - 2.2557e-5 * height, 5.2568)
    kelvin = 15.0 - 6.5e-3 * height + 273.16
    vapour = 6.108 * _HUMIDITY * elementary.exp((17.15 * kelvin - 4684.0) / (kelvin - 38.45))
    flattening = 1.0 - 0.00266 * elementary.cos(2.0 * math.radians(geodetic[0])) - 0.00028 * height / 1e3
    zenith = 0.0022768 * pressure / flattening + 0.002277 * (1255.0 / kelvin + 0.05) * vapour
    delay: Array = zenith / elementary.sin(elevation_rad)
    return delay


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    result = np.zeros_like(x)
    for coefficient in reversed(coefficients):
        result = result * x + coefficient
    return result
