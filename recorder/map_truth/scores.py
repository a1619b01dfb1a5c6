"""Accuracy, completeness, precision, recall and F-score of a map, by class and by visibility."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from carlaloc_env.core.array_types import U8, Array, Mask
from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.scene.materials import Tag
from recorder.map_truth.surface_cloud import SurfaceCloud

ALL = "all"
"""Name of the whole in columns of parts and classes."""
VISIBLE, HIDDEN = "visible", "never visible"
"""Parts of the surfaces: those that were in sight once, and those that never were."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapScore:
    """One row of a map's scores; NaN where there are no points to measure."""

    part: str
    """`ALL`, `VISIBLE` or `HIDDEN`."""
    tag: str
    """Class of the surfaces, or `ALL`."""
    distance_m: float
    """Distance d of precision and recall [m]."""
    map_points: int
    """Points of the map whose nearest surface is of this part and class."""
    surface_points: int
    """Points of the true surfaces."""
    accuracy_m: float
    """Mean distance from the map's points to the nearest surface [m]."""
    completeness_m: float
    """Mean distance from the surfaces' points to the nearest point of the map [m]."""
    precision: float
    """Share of the map's points nearer than d to a surface, 0–1."""
    recall: float
    """Share of the surfaces' points nearer than d to the map, 0–1: completeness as a share."""
    f_score: float
    """Harmonic mean of precision and recall, 0–1."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Distances:
    """All that scores are made of: M points of a map and K points of the true surfaces."""

    map_m: Array
    """From the map's points to the nearest surface [m], shape (M,)."""
    map_tag: U8
    """Class of that surface, shape (M,)."""
    map_visible: Mask
    """Whether that surface was ever in sight, shape (M,)."""
    surface_m: Array
    """From the surfaces' points to the nearest point of the map [m], shape (K,)."""
    surface_tag: U8
    """Their classes, shape (K,)."""
    surface_visible: Mask
    """Whether they were ever in sight, shape (K,)."""


def measure(points_m: Array, nearest: tuple[Array, U8], surface: SurfaceCloud, visible: Mask) -> Distances:
    """Distances between a map and the true surfaces, both ways.

    Args:
        points_m: Points of the map, world, shape (M, 3).
        nearest: Distance of each from the nearest surface, and the class of that, shapes (M,).
        surface: Points of the surfaces, K of them.
        visible: Which of these were ever in sight, shape (K,).

    Raises:
        EvaluationError: the map has no point, or there are no surfaces.
    """
    if not len(points_m) or not len(surface):
        raise EvaluationError("the map has no point near the drive; look at its frame and the alignment")
    partner = cKDTree(surface.points_xyz_m).query(points_m)[1]
    to_map = np.asarray(cKDTree(points_m).query(surface.points_xyz_m)[0])
    return Distances(
        map_m=nearest[0],
        map_tag=nearest[1],
        map_visible=visible[partner],
        surface_m=to_map,
        surface_tag=surface.tag,
        surface_visible=visible,
    )


def score_map(found: Distances, distances_m: Sequence[float]) -> tuple[MapScore, ...]:
    """Scores of the whole, of both parts, and of every class in each of them.

    Precision, recall and F-score are those of Knapitsch et al., "Tanks and Temples", ACM TOG 36 (2017),
    equations 4 to 8.

    Args:
        found: Distances between map and surfaces.
        distances_m: Distances d [m].

    Raises:
        ConfigError: a distance is not above 0, or there is none.
    """
    if not distances_m or not all(d > 0 for d in distances_m):
        raise ConfigError("scores need distances above 0 m")
    rows = []
    everything = (np.ones(len(found.map_m), np.bool_), np.ones(len(found.surface_m), np.bool_))
    parts = {
        ALL: everything,
        VISIBLE: (found.map_visible, found.surface_visible),
        HIDDEN: (~found.map_visible, ~found.surface_visible),
    }
    for part, (of_map, of_surface) in parts.items():
        for tag in (None, *np.unique(found.surface_tag).tolist()):
            built = of_map if tag is None else of_map & (found.map_tag == tag)
            true = of_surface if tag is None else of_surface & (found.surface_tag == tag)
            if built.any() or true.any():
                name = ALL if tag is None else Tag(tag).name.lower()
                rows += [
                    _score(part, name, d, found.map_m[built], found.surface_m[true]) for d in distances_m
                ]
    return tuple(rows)


def _score(part: str, tag: str, d: float, map_m: Array, surface_m: Array) -> MapScore:
    precision, recall = (float((m < d).mean()) if len(m) else np.nan for m in (map_m, surface_m))
    both = precision + recall
    return MapScore(
        part=part,
        tag=tag,
        distance_m=d,
        map_points=len(map_m),
        surface_points=len(surface_m),
        accuracy_m=float(map_m.mean()) if len(map_m) else np.nan,
        completeness_m=float(surface_m.mean()) if len(surface_m) else np.nan,
        precision=precision,
        recall=recall,
        f_score=0.0 if both == 0.0 else 2.0 * precision * recall / both,
    )
