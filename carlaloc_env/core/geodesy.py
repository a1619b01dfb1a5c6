"""WGS84: local east-north-up metres to latitude, longitude, height, and back."""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError

WGS84_A_M = 6378137.0
"""Semi-major axis [m] (NIMA TR8350.2)."""
WGS84_F = 1.0 / 298.257223563
"""Flattening."""
_E2 = WGS84_F * (2.0 - WGS84_F)
"""Square of the ellipsoid's first eccentricity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GeoReference:
    """Geodetic position of the world origin; world axes are east, north, up there."""

    latitude_deg: float
    """Latitude of the origin [deg]."""
    longitude_deg: float
    """Longitude of the origin [deg]."""
    height_m: float = 0.0
    """Height of the origin above the WGS84 ellipsoid [m]."""

    def __post_init__(self) -> None:
        if not abs(self.latitude_deg) <= 90.0:
            raise ConfigError(f"latitude_deg is {self.latitude_deg:g}; give -90 to 90 [deg]")
        if not abs(self.longitude_deg) <= 360.0:
            raise ConfigError(f"longitude_deg is {self.longitude_deg:g}; give -360 to 360 [deg]")
        if not math.isfinite(self.height_m):
            raise ConfigError(f"height_m is {self.height_m:g}; give a finite number [m]")

    def enu_to_geodetic(self, position_m: ArrayLike) -> Array:
        """Latitude [deg], longitude [deg], height [m] (..., 3) of world points [m] (..., 3)."""
        return ecef_to_geodetic(transforms.apply(_axes_at(self), position_m))

    def geodetic_to_enu(self, geodetic: ArrayLike) -> Array:
        """World points [m] (..., 3) of latitude [deg], longitude [deg], height [m] (..., 3)."""
        return self.ecef_to_enu(geodetic_to_ecef(geodetic))

    def ecef_to_enu(self, ecef_m: ArrayLike) -> Array:
        """World points [m] (..., 3) of Earth-centred points [m] (..., 3)."""
        T = _axes_at(self)
        rotation = transforms.from_rotation(T[:3, :3].T)
        return transforms.apply(rotation, np.asarray(ecef_m, dtype=np.float64) - T[:3, 3])

    def covariance_enu(self, covariance_m2: Array) -> Array:
        """Covariance [m²] (3, 3) about true east, north, up of one about world axes."""
        return covariance_m2


@functools.lru_cache(maxsize=8)
def _axes_at(place: GeoReference) -> Array:
    """Pose of the axes east, north, up at a place, Earth-centred, shape (4, 4)."""
    axes = local_axes(place.latitude_deg, place.longitude_deg)
    origin = geodetic_to_ecef([place.latitude_deg, place.longitude_deg, place.height_m])
    return transforms.from_rotation(axes, origin)


def local_axes(latitude_deg: float, longitude_deg: float) -> Array:
    """East, north and up as columns, Earth-centred, shape (3, 3)."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    sl, cl, so, co = elementary.sin(lat), elementary.cos(lat), elementary.sin(lon), elementary.cos(lon)
    return np.array([[-so, -sl * co, cl * co], [co, -sl * so, cl * so], [0.0, cl, sl]])


def geodetic_to_ecef(geodetic: ArrayLike) -> Array:
    """Earth-centred points [m] (..., 3) of latitude [deg], longitude [deg], height [m]."""
    g = np.asarray(geodetic, dtype=np.float64)
    lat, lon, h = np.radians(g[..., 0]), np.radians(g[..., 1]), g[..., 2]
    n = WGS84_A_M / np.sqrt(1.0 - _E2 * elementary.sin(lat) ** 2)
    return np.stack(
        [
            (n + h) * elementary.cos(lat) * elementary.cos(lon),
            (n + h) * elementary.cos(lat) * elementary.sin(lon),
            (n * (1.0 - _E2) + h) * elementary.sin(lat),
        ],
        axis=-1,
    )


def ecef_to_geodetic(ecef_m: ArrayLike) -> Array:
    """Latitude [deg], longitude [deg], height [m] (..., 3) of Earth-centred points [m].

    Bowring's parametric-latitude iteration; three rounds reach rounding error below 10 km height.
    """
    # Here, since numba takes half a second to import, and rigs and maps are read without it.
    from carlaloc_env.core.geodesy_kernels import to_geodetic

    points = np.asarray(ecef_m, dtype=np.float64)
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    rows = np.stack([np.hypot(x, y), y, x, z], axis=-1).reshape(-1, 4)
    to_geodetic(rows, WGS84_A_M, WGS84_F)
    rows[:, :2] = np.degrees(rows[:, :2])
    return rows[:, :3].reshape(points.shape)
