"""Accuracy, completeness, precision, recall and F-score of a map, by class and by visibility.

Ghosts: points of a map that movers have left where nothing stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core.array_types import U8, Array, Mask
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.raycast.scene import into_actor_frame
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.timeline import Timeline
from recorder.laboratory.surface_cloud import SurfaceCloud

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
    """Distances between M points of a map and K points of the true surfaces."""

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


def score_map(distances: Distances, distances_m: Sequence[float]) -> tuple[MapScore, ...]:
    """Scores of the whole, of both parts, and of every class in each of them.

    Precision, recall and F-score are those of Knapitsch et al., "Tanks and Temples", ACM TOG 36 (2017),
    equations 4 to 8.

    Args:
        distances: Distances between map and surfaces.
        distances_m: Distances d [m].

    Raises:
        ConfigError: a distance is not above 0, or there is none.
    """
    if not distances_m or not all(d > 0 for d in distances_m):
        raise ConfigError("scores need distances above 0 m")
    rows = []
    everything = (np.ones(len(distances.map_m), np.bool_), np.ones(len(distances.surface_m), np.bool_))
    parts = {
        ALL: everything,
        VISIBLE: (distances.map_visible, distances.surface_visible),
        HIDDEN: (~distances.map_visible, ~distances.surface_visible),
    }
    for part, (of_map, of_surface) in parts.items():
        for tag in (None, *np.unique(distances.surface_tag).tolist()):
            built = of_map if tag is None else of_map & (distances.map_tag == tag)
            true = of_surface if tag is None else of_surface & (distances.surface_tag == tag)
            if built.any() or true.any():
                name = ALL if tag is None else Tag(tag).name.lower()
                rows += [
                    _score(part, name, d, distances.map_m[built], distances.surface_m[true])
                    for d in distances_m
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


@dataclass(frozen=True, slots=True, kw_only=True)
class GhostRule:
    """Thresholds that make a point of a map a ghost."""

    surface_m: float = 0.3
    """Least distance from every static surface [m]; noise and small errors of poses stay below it."""
    margin_m: float = 0.2
    """Width by which movers' boxes are grown on all sides but the ground's [m]."""

    def __post_init__(self) -> None:
        if not (self.surface_m > 0 and self.margin_m >= 0):
            raise ConfigError("a ghost's distance from surfaces must be above 0 m, its margin not below")


def find_ghosts(
    points_m: Array,
    surface_distance_m: Array,
    timeline: Timeline,
    span_ns: tuple[int, int],
    rule: GhostRule = GhostRule(),
) -> Mask:
    """Mask of ghosts: points off all static surfaces, in a mover's box at a stamp of the drive, shape (N,).

    Boxes are taken every 50 ms. At less than their length in that time their union is the swept volume.

    Args:
        points_m: Points of a map, world, shape (N, 3).
        surface_distance_m: Distance of each from the nearest static surface [m], shape (N,).
        timeline: The drive, with the actors that may have left ghosts.
        span_ns: First and last stamp of the map [ns].
        rule: When a point is a ghost.
    """
    ghost = np.zeros(len(points_m), np.bool_)
    far = np.flatnonzero(surface_distance_m > rule.surface_m)
    if not len(far) or not len(timeline.catalog):
        return ghost
    points = points_m[far]
    tree = cKDTree(points)
    low, high = points.min(axis=0), points.max(axis=0)
    size_m = timeline.catalog.size_m.astype(np.float64)
    around = 0.5 * np.sqrt(np.sum(size_m**2, axis=1)) + 2.0 * rule.margin_m
    covered = np.zeros(len(far), np.bool_)
    before: NDArray[np.float64] | None = None
    first, last = (min(max(ns, timeline.start_ns), timeline.end_ns) for ns in span_ns)
    for stamp in np.unique([*range(first, last, STEP_NS), last]).tolist():
        frame = timeline.actors_at(stamp)
        pose = np.column_stack([frame.position_m, frame.heading_rad, frame.pitch_rad, frame.roll_rad]).astype(
            np.float64
        )
        centre = pose[:, :3] + [0.0, 0.0, 0.5] * size_m
        near = np.all((centre > low - around[:, None]) & (centre < high + around[:, None]), axis=1)
        if before is not None:
            near &= np.any(pose != before, axis=1)  # who stands still covers nothing new
        before = pose
        actors = np.flatnonzero(near)
        if not len(actors):
            continue
        lists = tree.query_ball_point(centre[actors], around[actors])
        actor = np.repeat(actors, [len(rows) for rows in lists])
        point = np.concatenate([np.asarray(rows, np.intp) for rows in lists])
        covered[point[_in_boxes(points[point], pose[actor], size_m[actor], rule.margin_m)]] = True
    ghost[far[covered]] = True
    return ghost


def _in_boxes(points_m: Array, pose: Array, size_m: Array, margin_m: float) -> Mask:
    """Whether points lie in boxes, row by row; poses are x, y, z on the ground, heading, pitch, roll."""
    offset_m = points_m - pose[:, :3]
    forward, left, up = into_actor_frame(offset_m, offset_m, pose[:, 3], pose[:, 4], pose[:, 5])[:, :3].T
    half = 0.5 * size_m + margin_m
    inside: Mask = (
        (np.abs(forward) <= half[:, 0])
        & (np.abs(left) <= half[:, 1])
        & (up >= 0.0)
        & (up <= size_m[:, 2] + margin_m)
    )
    return inside
