"""Lowers sidewalks and medians where lanes of another road run across them, as happens on generated maps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from carlaloc_env.core.areas import Area, strip_polygon
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.scenery.ground.lane_strips import SAMPLE_M, Strip

BELOW_M = 0.01
"""How far a lowered sidewalk lies below the lanes [m]."""
FLARE_M = 0.6
"""Length of the slope up to the sidewalk on both sides [m]."""
_INSIDE_M = 0.3
"""Lanes are free at this distance from their edges already where sidewalks merely touch them."""
_LEAST_M2 = 0.05
_LEVEL_M = 1.0


def lower_walks(strips: Sequence[Strip]) -> list[Strip]:
    """The same strips with sidewalks lowered wherever driving lanes of other roads cross them."""
    lanes = [(n, area) for n, strip in enumerate(strips) for area in _driven(strip)]
    if not lanes:
        return list(strips)
    tree = shapely.STRtree([area for _, area in lanes])
    result = []
    for number, strip in enumerate(strips):
        walks = [k for k in range(len(strip.lanes)) if strip.kind(k) in ("sidewalk", "median")]
        if strip.junction_id is None and walks:
            left, right = strip.edges_m[walks[0]], strip.edges_m[walks[-1] + 1]
            near = [lanes[k] for k in tree.query(strip_polygon(left, right)) if lanes[k][0] != number]
            for walk in walks if near else ():
                crossing = _crossing(strips, strip, walk, near)
                strip = _lowered(strip, walk, crossing) if crossing is not None else strip
        result.append(strip)
    return result


def _driven(strip: Strip) -> list[Area]:
    """Inner parts of the strip's driving lanes."""
    areas = []
    for lane in range(len(strip.lanes)):
        if strip.lanes[lane].type == "driving":
            area = shapely.buffer(strip_polygon(*strip.lane_edges(lane)), -_INSIDE_M)
            if not area.is_empty:
                areas.append(area)
    return areas


def _crossing(strips: Sequence[Strip], strip: Strip, walk: int, near: Sequence[tuple[int, Area]]) -> Area:
    """Part of a sidewalk that driving lanes at the same level cross; None for nothing."""
    walk_area = strip_polygon(*strip.lane_edges(walk))
    taken = []
    for other, lane in near:
        part = shapely.intersection(walk_area, lane)
        if part.area > _LEAST_M2 and _level_with(strip, strips[other], part):
            taken.append(part)
    return shapely.union_all(taken) if taken else None


def _level_with(a: Strip, b: Strip, part: Area) -> bool:
    """Whether two strips have about the same height where they meet."""
    x, y = shapely.get_coordinates(shapely.centroid(part))[0]
    heights = []
    for strip in (a, b):
        points = strip.edges_m.reshape(-1, 3)
        heights.append(points[np.argmin((points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2), 2])
    return bool(abs(heights[0] - heights[1]) < _LEVEL_M)


def _lowered(strip: Strip, walk: int, crossing: Area) -> Strip:
    """The strip with one lane lowered wherever it lies under lanes, with slopes at both ends."""
    dense = np.linspace(strip.s_m[0], strip.s_m[-1], int(np.ceil(np.ptp(strip.s_m) / SAMPLE_M)) + 1)
    left, right = (interpolated(dense, strip.s_m, edge) for edge in strip.lane_edges(walk))
    across = shapely.linestrings(np.stack([left[:, :2], right[:, :2]], axis=1))
    under = shapely.intersects(across, shapely.buffer(crossing, _INSIDE_M + SAMPLE_M))
    if not under.any():
        return strip
    gap = np.min(np.abs(dense[:, None] - dense[under][None]), axis=1)
    share = np.clip(gap / FLARE_M, 0.0, 1.0)
    kept = (gap < FLARE_M + 2 * SAMPLE_M) | (np.arange(len(dense)) % round(2.0 / SAMPLE_M) == 0)
    s = np.unique(np.concatenate([strip.s_m, dense[kept]]))
    raised = interpolated(s, strip.s_m, np.moveaxis(strip.raised_m, -1, 0).reshape(len(strip.s_m), -1))
    raised = np.moveaxis(raised.reshape(len(s), *strip.raised_m.shape[:2]), 0, -1).copy()
    down = np.interp(s, dense, share)
    raised[walk] = (raised[walk] + BELOW_M) * down - BELOW_M
    return replace(
        strip,
        s_m=s,
        t_m=np.stack([np.interp(s, strip.s_m, row) for row in strip.t_m]),
        edges_m=np.stack([interpolated(s, strip.s_m, edge) for edge in strip.edges_m]),
        raised_m=raised,
    )
