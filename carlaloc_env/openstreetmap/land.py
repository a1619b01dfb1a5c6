"""Heights of the land from a raster of any reference system, such as a GeoTIFF."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt, map_coordinates

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError, MissingDependencyError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.openstreetmap.extract import Extract
from carlaloc_env.openstreetmap.features import Feature

CELL_M, MOST_CELLS = 5.0, 4_000_000
"""Side of the cells of the land, to which finer rasters are averaged [m]; and the most cells."""
REACH_M = 300.0
"""How far the land reaches beyond the streets [m]."""
LEAST_KNOWN = 0.9
"""A raster that has heights for fewer of the streets' nodes is refused."""
LOWEST_M, HIGHEST_M = -450.0, 9000.0
"""Other heights mean that a raster has none there [m]."""
POINT_M, MOST_POINTS = 10.0, 20_000
"""Distance of the points that a town's file has of its land [m], and about their number on large ones."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Land:
    """Heights on a grid of the world, relative to that of the origin."""

    low_m: Array
    """South-western corner (2,) [m]."""
    cell_m: float
    """Side of its cells [m]."""
    z_m: Array
    """Heights (columns to the east, rows to the north) [m]."""
    origin_m: float
    """Height of the origin in the raster [m]."""
    report: dict[str, Any]
    """Source, lowest, highest and guessed heights."""

    def height(self, xy_m: Array) -> Array:
        """Heights at world points (N, 2) [m], (N,)."""
        at = (xy_m - self.low_m) / self.cell_m
        return np.asarray(np.round(map_coordinates(self.z_m, at.T, order=1, mode="nearest"), 4))

    def feature(self, area: shapely.Geometry) -> Feature:
        """The heights in the rectangle round an area, for the file of a town's features."""
        low, high = np.reshape(shapely.bounds(area), (2, 2))
        step = max(POINT_M, CELL_M * np.ceil(np.sqrt(np.prod(high - low) / MOST_POINTS) / CELL_M))
        # On the nodes of the ground's own grid.
        xy = _grid(np.floor(low / step) * step, high, step).reshape(-1, 2)
        return Feature(
            "land", "raster", shapely.MultiPoint(xy), {"heights_m": self.height(xy).round(2).tolist()}
        )


def read_land(path: Path, extract: Extract) -> Land:
    """Read a raster round the streets of an extract; cells without a height get that of the nearest.

    Args:
        path: Its first band holds heights [m].
        extract: Streets, and the place of the world.

    Raises:
        MapError: The raster cannot be read, has no reference system, or lies elsewhere.
        MissingDependencyError: Rasters need rasterio.
    """
    nodes = [node for way in extract.ways.values() if "highway" in way.tags for node in way.nodes]
    streets = extract.line(nodes or list(extract.xy_m))
    low, high = np.floor(streets.min(axis=0) - REACH_M), streets.max(axis=0) + REACH_M
    cell = max(CELL_M, float(np.ceil(np.sqrt(np.prod(high - low) / MOST_CELLS))))
    z = _read(path, extract.geo, low, cell, _grid(low, high, cell).shape[:2])
    measured = np.isfinite(z)
    share = float(measured[tuple(np.rint((streets - low) / cell).astype(np.int64).T)].mean())
    if share < LEAST_KNOWN:
        raise MapError(
            f"{path} has heights for {100 * share:.0f} % of the streets; give a raster that covers them all"
        )
    z = z[tuple(distance_transform_edt(~measured, return_distances=False, return_indices=True))]
    report = {
        "raster": path.name,
        "lowest_m": round(float(z.min()), 1),
        "highest_m": round(float(z.max()), 1),
        "filled_from_neighbours": round(float(1.0 - measured.mean()), 4),
    }
    land = Land(low_m=low, cell_m=cell, z_m=z, origin_m=0.0, report=report)
    origin_m = round(float(land.height(np.zeros((1, 2)))[0]), 2)
    return replace(land, z_m=z - origin_m, origin_m=origin_m)


def _grid(low: Array, high: Array, step: float) -> Array:
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _read(path: Path, geo: GeoReference, west_south: Array, cell_m: float, shape: tuple[int, ...]) -> Array:
    """Heights at the corners of the cells of a grid of the world, NaN where the raster has none."""
    try:
        import rasterio
        from rasterio.enums import Resampling
        from rasterio.vrt import WarpedVRT
    except ImportError as error:
        raise MissingDependencyError(
            "heights need rasterio: pip install 'carlaloc[heights]', or leave --heights out"
        ) from error
    west, north = west_south + np.array([-0.5, shape[1] - 0.5]) * cell_m
    try:
        with rasterio.open(path) as source:
            if source.crs is None:
                raise MapError(
                    f"{path} names no reference system; add one: rio edit-info --crs EPSG:… {path}"
                )

            def warped(how: Resampling, empty: float | None) -> Array:
                # On the ellipsoid, seen along its normal at the origin: x and y of the world.
                system = f"+proj=ortho +lat_0={geo.latitude_deg!r} +lon_0={geo.longitude_deg!r} +datum=WGS84"
                place = rasterio.Affine(cell_m, 0.0, west, 0.0, -cell_m, north)
                with WarpedVRT(
                    source, crs=system, transform=place, width=shape[0], height=shape[1], resampling=how,
                    src_nodata=empty, nodata=np.nan, dtype="float64",
                ) as view:  # fmt: skip
                    return np.asarray(view.read(1)[::-1].T)

            empty, factor, offset = source.nodata, source.scales[0], source.offsets[0]
            if empty is None:
                # Heights that are none and not declared as such must not be mixed with their neighbours.
                z = warped(Resampling.nearest, None)
                empty = next(iter(z[_is_no_height(z * factor + offset)]), None)
            z = warped(Resampling.bilinear, empty) * factor + offset
    except rasterio.errors.RasterioError as error:
        raise MapError(f"cannot read {path}: {error}; give a GeoTIFF of heights") from error
    return np.where(_is_no_height(z), np.nan, z)


def _is_no_height(z: Array) -> Array:
    return np.asarray((z < LOWEST_M) | (z > HIGHEST_M))
