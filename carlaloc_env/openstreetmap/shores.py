"""Water whose shore leaves the extract: seas by their coast, lakes and rivers by what stands on dry land."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from carlaloc_env.core.array_types import Array
from carlaloc_env.openstreetmap.extract import Extract

FAR_M = 2500.0
"""Seas and rivers go on so far beyond the streets [m]."""
ASIDE_M = 0.5
"""Sides of a coast are looked at so far from it [m]."""


def sea(extract: Extract) -> Any:
    """Area of the sea round the streets: a coast has it on the right; empty without a coast."""
    coasts = [way.nodes for way in extract.ways.values() if way.tags.get("natural") == "coastline"]
    frame = _frame(extract)
    cut = [shapely.intersection(shapely.LineString(extract.line(nodes)), frame) for nodes in coasts]
    faces = _faces(cut, frame)
    if len(faces) < 2:
        return shapely.Polygon()
    tree, votes = shapely.STRtree(faces), np.zeros(len(faces))
    for nodes in coasts:
        line = extract.line(nodes)
        step = np.diff(line, axis=0)
        length = np.maximum(np.hypot(*step.T), 1e-9)
        right = np.column_stack([step[:, 1], -step[:, 0]]) / length[:, None] * ASIDE_M
        for sign in (1.0, -1.0):
            middles = shapely.points((line[1:] + line[:-1]) / 2 + sign * right)
            rows, at = tree.query(middles, predicate="within")
            np.add.at(votes, at, sign * length[rows])
    return shapely.union_all(faces[votes > 0.0])


def open_water(extract: Extract, lines: Sequence[Any]) -> Any:
    """Area of a water of whose outline only some lines are known: the side with fewer streets and houses.

    Args:
        extract: What stands on dry land.
        lines: The known parts of its outline, islands included.
    """
    frame = _frame(extract)
    faces = _faces([shapely.intersection(line, frame) for line in lines], frame)
    if len(faces) < 2:
        return shapely.Polygon()
    # From face to face, every shore that is crossed leads from water to land or back.
    inner = shapely.get_coordinates(shapely.point_on_surface(faces))
    rays = shapely.linestrings(np.stack([np.broadcast_to(inner[0], inner.shape), inner], axis=1))
    net = shapely.boundary(faces)
    crossed = shapely.intersection(rays[1:], shapely.union_all(net))
    second = np.concatenate([[False], shapely.get_num_geometries(crossed) % 2 == 1])
    dry = shapely.points(_dry_places(extract))
    sides = [shapely.union_all(faces[side]) for side in (second, ~second)]
    for side in sides:
        shapely.prepare(side)
    return min(sides, key=lambda side: (int(shapely.contains(side, dry).sum()), side.area))


def _frame(extract: Extract) -> Any:
    nodes = [node for way in extract.ways.values() if "highway" in way.tags for node in way.nodes]
    xy = extract.line(nodes) if nodes else np.zeros((1, 2))
    return shapely.box(*(xy.min(axis=0) - FAR_M), *(xy.max(axis=0) + FAR_M))


def _faces(lines: Sequence[Any], frame: Any) -> Array:
    """Parts of a frame between lines; lines that end inside it are led to its nearest border."""
    border = shapely.boundary(frame)
    parts = shapely.get_parts(shapely.line_merge(shapely.union_all(lines))) if len(lines) else []
    ends = [end for part in parts if part.geom_type == "LineString" and not part.is_closed
            for end in (shapely.get_point(part, 0), shapely.get_point(part, -1))]  # fmt: skip
    led = [shapely.shortest_line(end, border) for end in ends if not shapely.dwithin(end, border, 1e-6)]
    faces: Array = shapely.get_parts(shapely.polygonize([shapely.union_all([*parts, *led, border])]))
    return faces


def _dry_places(extract: Extract) -> Array:
    """Nodes of streets that are no bridges, and of houses, (N, 2)."""
    nodes = [
        node
        for way in extract.ways.values()
        if "building" in way.tags
        or ("highway" in way.tags and way.tags.get("bridge", "no") == way.tags.get("tunnel", "no") == "no")
        for node in way.nodes
    ]
    return extract.line(nodes) if nodes else np.zeros((0, 2))
