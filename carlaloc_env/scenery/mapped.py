"""Things beside the roads by a town's `features.geojson`: houses, trees, rails, squares."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.geodesy import GeoReference


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MappedFeature:
    """One thing with its place."""

    kind: str
    """`building`, `part`, `tree`, `tree_row`, `rail`, `square` and so on."""
    id: str
    """Where it comes from, such as `way/1`."""
    shape: Any
    """Point, line or polygon in the world [m]."""
    properties: Mapping[str, Any]
    """Its tags, and measures made of them."""

    def number(self, key: str, default: float) -> float:
        """A property that is a number."""
        value = self.properties.get(key, default)
        return float(value) if isinstance(value, int | float) else default


def read_mapped(path: Path, geo: GeoReference) -> list[MappedFeature]:
    """Things of a GeoJSON file in longitudes and latitudes.

    Args:
        path: The file.
        geo: Place of the world's origin.

    Raises:
        MapError: The file cannot be read or is none.
    """
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))["features"]
        shapes = [shapely.geometry.shape(entry["geometry"]) for entry in entries]
        pairs = [(entry["properties"], shape) for entry, shape in zip(entries, shapes, strict=True)]
        return [_feature(properties, shape, geo) for properties, shape in pairs]
    except OSError as error:
        raise MapError(f"cannot read {path}: {error.strerror}; import the town again") from error
    except (ValueError, KeyError, TypeError, AttributeError, shapely.GEOSException) as error:
        raise MapError(f"{path} is no GeoJSON of a town ({error}); import the town again") from error


def _feature(properties: Mapping[str, Any], shape: Any, geo: GeoReference) -> MappedFeature:
    degrees = shapely.get_coordinates(shape)
    geodetic = np.column_stack([degrees[:, ::-1], np.full(len(degrees), geo.height_m)])
    world = np.round(geo.geodetic_to_enu(geodetic)[:, :2], 3)
    placed = shapely.set_coordinates(shape, world)
    return MappedFeature(
        kind=str(properties["kind"]), id=str(properties["id"]), shape=placed, properties=dict(properties)
    )


def of_kind(features: Sequence[MappedFeature], *kinds: str) -> list[MappedFeature]:
    """Things of some kinds."""
    return [feature for feature in features if feature.kind in kinds]


def land_points(features: Sequence[MappedFeature]) -> Array:
    """Points (K, 3) of the land between the roads [m]; none where nothing is known of it."""
    points = [
        np.column_stack([shapely.get_coordinates(land.shape), land.properties["heights_m"]])
        for land in of_kind(features, "land")
    ]
    return np.concatenate([np.zeros((0, 3)), *points])
