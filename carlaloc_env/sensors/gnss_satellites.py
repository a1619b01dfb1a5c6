"""Navigation satellites: their directions in the sky, and the error of a least-squares position from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.geodesy import GeoReference

GM_M3PS2 = 3.986004418e14
"""Earth's gravitational constant [m³/s²] (WGS84)."""
EARTH_RATE_RADPS = 7.2921151467e-5
"""Rotation of the Earth [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkerConstellation:
    """A Walker delta constellation t/p/f: evenly spread circular orbits."""

    satellites: int
    """Number of satellites t."""
    planes: int
    """Number of orbital planes p."""
    phasing: int
    """Relative spacing f of satellites in neighbouring planes."""
    inclination_deg: float
    """Tilt of the planes against the equator [deg]."""
    radius_m: float
    """Distance from the Earth's centre [m]."""

    def ecef_m(self, time_s: float) -> Array:
        """Earth-fixed positions at a time [s], shape (t, 3).

        Satellite k of plane j has the ascending node 360°·j/p and the argument of latitude
        360°·(k·p/t + f·j/t) + n·time (Walker, "Satellite constellations", J. Brit. Interplanet. Soc. 37,
        1984).
        """
        each = self.satellites // self.planes
        plane, slot = np.divmod(np.arange(self.satellites), each)
        rate = math.sqrt(GM_M3PS2 / (self.radius_m * self.radius_m * self.radius_m))
        turn = 2.0 * math.pi
        along = turn * (slot / each + self.phasing * plane / self.satellites) + rate * time_s
        node = turn * plane / self.planes - EARTH_RATE_RADPS * time_s
        tilt = math.radians(self.inclination_deg)
        x, y = elementary.cos(along), elementary.sin(along) * elementary.cos(tilt)
        c, s = elementary.cos(node), elementary.sin(node)
        up = elementary.sin(along) * elementary.sin(tilt)
        return self.radius_m * np.stack([x * c - y * s, x * s + y * c, up], axis=-1)


CONSTELLATIONS = {
    "galileo": WalkerConstellation(
        satellites=24, planes=3, phasing=1, inclination_deg=56.0, radius_m=29_599_800.0
    ),
    "beidou": WalkerConstellation(
        satellites=24, planes=3, phasing=1, inclination_deg=55.0, radius_m=27_906_100.0
    ),
    "glonass": WalkerConstellation(
        satellites=24, planes=3, phasing=1, inclination_deg=64.8, radius_m=25_508_000.0
    ),
}
"""Nominal constellations: Galileo OS service definition, BeiDou (MEO) and GLONASS open service documents."""


def sky_directions(names: Sequence[str], geo: GeoReference, time_s: float) -> Array:
    """Unit vectors to all satellites of some constellations, world (ENU), shape (N, 3)."""
    position = np.concatenate([CONSTELLATIONS[name].ecef_m(time_s) for name in names])
    enu = geo.ecef_to_enu(position)
    result: Array = enu / np.sqrt(np.sum(enu * enu, axis=-1))[:, None]
    return result


def least_squares(directions: Array, sigma_m: Array, range_error_m: Array) -> tuple[Array, Array]:
    """Error of a weighted least-squares position from errors of the pseudo-ranges, and its covariance.

    Geometry matrix rows (−û, 1): three coordinates and the receiver's clock (Misra and Enge, "Global
    Positioning System", ch. 6).

    Args:
        directions: Unit vectors to N ≥ 4 satellites, ENU, shape (N, 3).
        sigma_m: Standard deviations of the pseudo-ranges [m], shape (N,).
        range_error_m: Their errors [m], shape (N,).

    Returns:
        Error of the position, ENU [m] (3,), and its covariance [m²] (3, 3).

    Raises:
        ZeroDivisionError: the satellites' geometry does not fix a position.
    """
    rows = np.concatenate([-directions, np.ones((len(directions), 1))], axis=1)
    weight = 1.0 / (sigma_m * sigma_m)
    normal = np.array([[np.sum(weight * rows[:, i] * rows[:, j]) for j in range(4)] for i in range(4)])
    right = [float(np.sum(weight * rows[:, i] * range_error_m)) for i in range(4)]
    inverse = inverse_of(normal)
    if inverse is None:
        raise ZeroDivisionError("satellites lie in one plane")
    error = [sum(inverse[i][j] * right[j] for j in range(4)) for i in range(3)]
    covariance = inverse[:3, :3]
    return np.array(error), 0.5 * (covariance + covariance.T)


def dilution(directions: Array) -> float:
    """Position dilution of precision (PDOP) of N ≥ 4 unit vectors to satellites (N, 3); inf if degenerate."""
    try:
        _, covariance = least_squares(directions, np.ones(len(directions)), np.zeros(len(directions)))
    except ZeroDivisionError:
        return math.inf
    return math.sqrt(max(float(covariance[0, 0] + covariance[1, 1] + covariance[2, 2]), 0.0))


def inverse_of(matrix: Array) -> Array | None:
    """Inverse of a symmetric positive matrix by elimination, alike on every machine; None: there is none."""
    size = len(matrix)
    work = np.concatenate([matrix, np.eye(size)], axis=1)
    for k in range(size):
        if not work[k, k] > 1e-12 * matrix[k, k]:
            return None
        work[k] /= work[k, k]
        others = np.arange(size) != k
        work[others] -= work[others, k, None] * work[k]
    return work[:, size:]
