"""Things beside the streets as records (houses, water, trees, fences), and their GeoJSON file."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from carlaloc_env.openstreetmap.extract import Extract


@dataclass(slots=True)
class Feature:
    """One thing: its kind, its shape in the world [m], and its properties."""

    kind: str
    id: str
    """`way/1`, `relation/2` or `node/3`."""
    shape: Any
    properties: dict[str, Any] = field(default_factory=dict)


@dataclass(slots=True)
class Features:
    """All things of an extract, and what was left out."""

    all: list[Feature]
    left_out: dict[str, str]
    """Ids and reasons."""

    def of(self, *kinds: str) -> list[Feature]:
        """Things of some kinds."""
        return [feature for feature in self.all if feature.kind in kinds]


def geojson(features: Iterable[Feature], extract: Extract) -> str:
    """Text of a GeoJSON file in longitudes and latitudes, one feature a line."""
    lines = []
    for feature in features:
        xy = shapely.get_coordinates(feature.shape)
        geodetic = extract.geo.enu_to_geodetic(np.column_stack([xy, np.zeros(len(xy))]))
        shape = shapely.set_coordinates(feature.shape, np.round(geodetic[:, 1::-1], 8))
        geometry = json.loads(shapely.to_geojson(shape))
        properties = {"id": feature.id, "kind": feature.kind, **feature.properties}
        lines.append(json.dumps({"type": "Feature", "properties": properties, "geometry": geometry}))
    return '{"type": "FeatureCollection", "features": [\n' + ",\n".join(lines) + "\n]}\n"
