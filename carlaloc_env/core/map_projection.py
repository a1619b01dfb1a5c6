"""World points of maps that are drawn in a map projection, to the Earth and back (by PROJ)."""

import math
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.geodesy import GeoReference

_DECIMALS = 11
"""Degrees are rounded to these, a micrometre: last bits of PROJ differ from processor to processor."""
_MERIDIAN_DEG = 6.0
"""Transverse Mercator projections are used this near to their own meridian [deg]."""
_STEP_M = 10.0
"""Way along which the direction of north is measured [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProjectedReference(GeoReference):
    """Place of a projected world on the Earth.

    World x and y are metres of the projection, turned and shifted, so that they run along its grid, not to
    true east and north; world z is a height: a flat map stays level everywhere. Latitude, longitude and
    height are those of the world's origin.
    """

    projection: str
    """The projected coordinate system: a PROJ string, EPSG code, WKT, or all else that PROJ reads."""
    x_m: float
    """Easting of the world's origin [m]."""
    y_m: float
    """Northing of the world's origin [m]."""
    turn_rad: float
    """Angle from the grid's east to world x, anticlockwise."""
    azimuth_rad: float
    """Angle from true north to world y at the origin, clockwise: the meridian convergence less the turn."""

    def enu_to_geodetic(self, position_m: ArrayLike) -> Array:
        """Latitude [deg], longitude [deg], height [m] (..., 3) of world points [m] (..., 3)."""
        p = np.asarray(position_m, dtype=np.float64)
        lat, lon = _unprojected(self.projection, *self._grid(p[..., 0], p[..., 1]))
        return np.stack([lat, lon, p[..., 2] + self.height_m], axis=-1)

    def geodetic_to_enu(self, geodetic: ArrayLike) -> Array:
        """World points [m] (..., 3) of latitude [deg], longitude [deg], height [m] (..., 3)."""
        g = np.asarray(geodetic, dtype=np.float64)
        x, y = _projected(self.projection, g[..., 0], g[..., 1])
        x, y = _turned(x - self.x_m, y - self.y_m, -self.turn_rad)
        return np.stack([x, y, g[..., 2] - self.height_m], axis=-1)

    def ecef_to_enu(self, ecef_m: ArrayLike) -> Array:
        """World directions of Earth-centred points [m] (..., 3), on the plane that touches at the origin."""
        tangent = GeoReference(
            latitude_deg=self.latitude_deg, longitude_deg=self.longitude_deg, height_m=self.height_m
        )
        enu = tangent.ecef_to_enu(ecef_m)
        x, y = _turned(enu[..., 0], enu[..., 1], self.azimuth_rad)
        return np.stack([x, y, enu[..., 2]], axis=-1)

    def covariance_enu(self, covariance_m2: Array) -> Array:
        """Covariance [m²] (3, 3) about true east, north, up of one about world axes."""
        c, s = elementary.cos(self.azimuth_rad), elementary.sin(self.azimuth_rad)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        half = np.sum(turn[:, :, None] * covariance_m2[None], axis=1)
        turned: Array = np.sum(half[:, None, :] * turn[None], axis=2)
        return turned

    def _grid(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        x, y = _turned(x_m, y_m, self.turn_rad)
        return x + self.x_m, y + self.y_m


def projected_reference(
    projection: str, x_m: float, y_m: float, *, height_m: float = 0.0, turn_rad: float = 0.0
) -> ProjectedReference:
    """Reference of a world whose origin has these coordinates in a projection.

    Args:
        projection: What PROJ reads as a projected coordinate system.
        x_m: Easting of the world's origin [m].
        y_m: Northing of the world's origin [m].
        height_m: Its height [m].
        turn_rad: Angle from the grid's east to world x, anticlockwise.

    Raises:
        ConfigError: PROJ does not know the projection, it is none, or it has no such place.
    """
    lat, lon = (float(v) for v in _unprojected(projection, np.array(x_m), np.array(y_m)))
    if not (math.isfinite(lat) and math.isfinite(lon)):
        raise ConfigError(f"x={x_m:.0f}, y={y_m:.0f} lies outside the projection {projection[:200]}")
    # One step along grid north, seen from the plane that touches at the origin.
    ahead = [float(v) for v in _unprojected(projection, np.array(x_m), np.array(y_m + _STEP_M))]
    east, north, _ = GeoReference(latitude_deg=lat, longitude_deg=lon).geodetic_to_enu([*ahead, 0.0])
    return ProjectedReference(
        latitude_deg=lat,
        longitude_deg=lon,
        height_m=height_m,
        projection=projection,
        x_m=x_m,
        y_m=y_m,
        turn_rad=turn_rad,
        azimuth_rad=round(float(elementary.arctan2(east, north)), 9) - turn_rad + 0.0,
    )


def area_of_use(projection: str) -> tuple[float, float, float, float] | None:
    """West, south, east, north [deg] of where a projection is meant to be used; None where PROJ has no word.

    Raises:
        ConfigError: PROJ does not know the projection, or it is none.
    """
    crs, _, _ = _read(projection)
    if crs.area_of_use is not None:
        bounds: tuple[float, float, float, float] = crs.area_of_use.bounds
        return bounds
    if crs.utm_zone is not None:
        middle, north = 6.0 * int(crs.utm_zone[:-1]) - 183.0, crs.utm_zone.endswith("N")
        return (middle - 3.0, 0.0 if north else -80.0, middle + 3.0, 84.0 if north else 0.0)
    way = crs.coordinate_operation
    if way is None or way.method_name != "Transverse Mercator":
        return None
    middle = next(p.value for p in way.params if p.name == "Longitude of natural origin")
    return (middle - _MERIDIAN_DEG, -90.0, middle + _MERIDIAN_DEG, 90.0)


def _turned(x: Array, y: Array, angle_rad: float) -> tuple[Array, Array]:
    if angle_rad == 0.0:
        return x, y
    c, s = elementary.cos(angle_rad), elementary.sin(angle_rad)
    return c * x - s * y, s * x + c * y


def _unprojected(projection: str, x_m: Array, y_m: Array) -> tuple[Array, Array]:
    _, transformer, metres = _read(projection)
    lon, lat = transformer.transform(np.asarray(x_m) / metres, np.asarray(y_m) / metres)
    return np.round(lat, _DECIMALS), np.round(lon, _DECIMALS)


def _projected(projection: str, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
    _, transformer, metres = _read(projection)
    x, y = transformer.transform(np.asarray(lon_deg), np.asarray(lat_deg), direction="INVERSE")
    return np.asarray(x) * metres, np.asarray(y) * metres


@lru_cache(maxsize=64)
def _read(projection: str) -> tuple[Any, Any, float]:
    """Coordinate system, its transformer to WGS84, and metres per unit of its axes."""
    from pyproj import CRS, Transformer
    from pyproj.exceptions import ProjError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # Old spellings, which are read all the same.
            crs = CRS.from_user_input(projection).to_2d()
        if not crs.is_projected:
            raise ConfigError(f"{projection[:100]} is a {crs.type_name}, no map projection")
        transformer = Transformer.from_crs(crs, 4326, always_xy=True)
    except ProjError as error:
        raise ConfigError(f"PROJ cannot read {projection[:100]}") from error
    return crs, transformer, float(crs.axis_info[0].unit_conversion_factor)
