"""Hatching on the paved wedge between two carriageways that part or join side by side."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import shapely

from carlaloc_env.core.areas import Area, areas_only, strip_polygon
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import distance_along, interpolated
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scenery.ground.lane_strips import Strip

HATCHING_BAR_M, BAR_STEP_M = 0.5, 2.0
"""Width of the oblique bars and their distance along the road [m] (German guideline RMS: 0.5 m wide)."""
RIM_M = 0.2
"""Distance of bars from the lines beside driving lanes [m]."""
LEAST_M = 0.9
"""Wedges narrower than this carry no bars [m]."""
_TOUCH_M = 0.1
_HALF_LENGTH_M = 8.0


def gore_bars(strips: Sequence[Strip], roads: Sequence[Road]) -> list[tuple[tuple[Strip, Strip], Area]]:
    """Bars on each wedge, with the two strips between which it lies."""
    groups: dict[str, list[Strip]] = {}
    for strip in strips:
        junction = roads[strip.road].junction_id
        if junction is not None and strip.junction_id is None:
            groups.setdefault(junction, []).append(strip)
    hatched = []
    for group in groups.values():
        for pair in combinations(group, 2):
            bars = _bars_on_wedge(*pair)
            if not bars.is_empty:
                hatched.append((pair, bars))
    return hatched


def _bars_on_wedge(one: Strip, other: Strip) -> Area:
    wedge, middle = _wedge(one, other)
    if wedge.is_empty or middle is None:
        return shapely.MultiPolygon()
    # Opening keeps what is wide enough for a bar.
    inner = shapely.buffer(wedge, -RIM_M, join_style="mitre")
    half = 0.5 * LEAST_M - RIM_M
    inner = shapely.intersection(shapely.buffer(shapely.buffer(inner, -half), 1.1 * half), inner)
    along = distance_along(middle)
    at = np.arange(0.5 * BAR_STEP_M, along[-1], BAR_STEP_M)
    points = interpolated(at, along, middle)
    ahead = interpolated(at + 0.5, along, middle) - points
    ahead /= np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-9)[:, None]
    slant = np.sqrt(0.5) * np.stack([ahead[:, 0] - ahead[:, 1], ahead[:, 0] + ahead[:, 1]], axis=-1)
    lines = np.stack([points - _HALF_LENGTH_M * slant, points + _HALF_LENGTH_M * slant], axis=1)
    bars = shapely.buffer(shapely.linestrings(lines), 0.5 * HATCHING_BAR_M, cap_style="flat")
    return areas_only(shapely.intersection(shapely.union_all(bars), inner), 0.05)


def _wedge(one: Strip, other: Strip) -> tuple[Area, Array | None]:
    """Shoulders of both strips that lie side by side, and the middle (N, 2) of one of them."""
    parts: list[Area] = []
    middle = None
    for strip, beside in ((one, other), (other, one)):
        span = beside.span(("roadway",))
        if span is None:
            continue
        area = strip_polygon(beside.edges_m[span[0]], beside.edges_m[span[1]])
        for lane, record in enumerate(strip.lanes):
            if record.type != "shoulder":
                continue
            left, right = strip.lane_edges(lane)
            shoulder = strip_polygon(left, right)
            if shoulder.area > 1.0 and shapely.dwithin(shoulder, area, _TOUCH_M):
                parts.append(shoulder)
                middle = 0.5 * (left + right)[:, :2] if middle is None else middle
    if not parts:
        return shapely.MultiPolygon(), None
    return shapely.buffer(shapely.union_all(parts), 0.02, join_style="mitre"), middle
