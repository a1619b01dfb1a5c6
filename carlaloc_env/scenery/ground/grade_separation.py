"""Finds the roads that leave the ground: where they cross far above each other, and over waters."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core.areas import Area, areas_only
from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.scenery.ground.cuttings import cuttings
from carlaloc_env.scenery.ground.grade_graph import Crossing, RoadGraph, grown, runs
from carlaloc_env.scenery.ground.grade_levels import Levels, State, States, strips_area
from carlaloc_env.scenery.ground.height_fields import NO_LAND, GroundGrid, land_beside
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.terrain import BANK_SLOPE, Zones
from carlaloc_env.scenery.ground.water import Water, water_areas, water_level_m

RANGE_M = 400.0
"""Roads farther than this from a crossing do not leave the ground for its sake [m]."""
FOLLOW_M = 200.0
"""Longest way on which a road comes back to the ground [m]."""
LEVEL_GRADE = 0.004
"""Grade below which a road that comes back to the ground has arrived."""
ON_GROUND_M = 0.3
"""Roads this near to the ground's height lie on it [m]."""
OPEN_M = 3.4
"""A road at least this high above a town's ground stands on piers, a lower one between walls [m]."""
ABUTMENT_M = 3.5
"""Distance of abutments from the road that passes below [m]."""
WING_M = 14.0
"""Distance from the road below up to which an embankment stands between walls [m]."""
SHORT_GAP_M = 9
"""Shorter stretches between two open ones are open too [m]."""
_BANK_ZONES = ("rural", "highway", "park")


def find_levels(
    strips: Sequence[Strip], low_m: Array, high_m: Array, zones: Zones, land_m: Array = NO_LAND
) -> Levels:
    """Roads that leave the ground: where they cross far above each other, and over waters.

    Args:
        strips: All roads.
        low_m: South-western corner of the town [m], shape (2,).
        high_m: North-eastern corner [m], shape (2,).
        zones: Kinds of scenery with their areas.
        land_m: Known points of the land (K, 3) [m].
    """
    graph = RoadGraph(strips)
    crossings = graph.crossings(strips)
    above_m = graph.middle_m[:, 2] - GroundGrid(land_m, low_m, high_m).height(graph.middle_m)
    raised, sunken = _regions(graph, crossings, above_m)
    basins = water_areas(zones)
    over = _over_water(graph, basins)
    on_ground = ~(raised | sunken | grown_in_strips(graph, over >= 0, 2))
    samples_m = _points(graph, on_ground)
    grid = GroundGrid(np.concatenate([samples_m, land_beside(land_m, samples_m)]), low_m, high_m)
    waters = _waters(graph, basins, over, grid)
    ground_m = grid.height(graph.middle_m)
    for number, water in enumerate(waters):
        ground_m[over == number] = water.level_m
    lift = graph.middle_m[:, 2] - ground_m
    state = np.zeros(len(lift), dtype=np.int8)
    state[sunken & (lift < -ON_GROUND_M)] = State.SUNKEN
    high = raised & (lift > ON_GROUND_M)
    state[high] = _carried(graph, high, lift, zones)
    state[grown_in_strips(graph, over >= 0, 2)] = State.OPEN
    _settle(graph, state, lift, strips)
    places = np.array([crossing.point_m for crossing in crossings]).reshape(-1, 2)
    cuts = tuple(cuttings(graph, state, grid, places))
    above = {graph.strip[c.high] for c in crossings if sunken[c.low]}
    return Levels(
        graph=graph,
        state=state,
        lift_m=lift,
        stretches=cuts,
        upper=areas_only(shapely.union_all([graph.prints[k] for k in sorted(above)])),
        waters=_shrunk(waters, graph, state),
    )


def grown_in_strips(graph: RoadGraph, mask: Mask, rows: int) -> Mask:
    """The mask with some more rows at both ends of each run, but never over a strip's end."""
    wide = mask.copy()
    for a, b in zip(graph.first[:-1], graph.first[1:], strict=True):
        if mask[a:b].any():
            wide[a:b] = grown(mask[a:b], rows)
    return wide


def _regions(graph: RoadGraph, crossings: Sequence[Crossing], z: Array) -> tuple[Mask, Mask]:
    """Rows that are raised and rows that are sunken, (M,) each.

    At each crossing the smaller of two sets leaves the ground: all that is joined to the upper road above
    half the height between both, or all that is joined to the lower road below it. A set from which no
    road leads to the other height is itself the ground. Heights `z` are above the land where it is known.
    """
    raised, sunken = np.zeros(len(z), dtype=bool), np.zeros(len(z), dtype=bool)
    for crossing in crossings:
        if raised[crossing.high] or sunken[crossing.low]:
            continue
        half = 0.5 * (z[crossing.low] + z[crossing.high])
        up = graph.component(z > half, crossing.high)
        down = graph.component(z < half, crossing.low)
        lifted = (not graph.leads_out(up), up.sum()) <= (not graph.leads_out(down), down.sum())
        near = np.hypot(*(graph.middle_m[:, :2] - crossing.point_m).T) < RANGE_M
        if lifted:
            raised |= _followed(graph, up & near, z)
        else:
            sunken |= _followed(graph, down & near, -z)
    return raised, sunken


def _followed(graph: RoadGraph, region: Mask, height: Array) -> Mask:
    """The region with the roads that lead out of it, as far as they go on falling (`height` sinks)."""
    wide = region.copy()
    front = [(int(row), 0.0) for row in np.flatnonzero(region)]
    while front:
        row, distance_m = front.pop()
        for other in graph.neighbours(row):
            if wide[other] or graph.junction[other]:
                continue
            gap = float(np.hypot(*(graph.middle_m[other] - graph.middle_m[row])[:2]))
            falls = height[row] - height[other] > LEVEL_GRADE * gap
            if (falls or gap < 0.01) and distance_m + gap < FOLLOW_M:
                wide[other] = True
                front.append((int(other), distance_m + gap))
    return wide


def _over_water(graph: RoadGraph, basins: Sequence[Area]) -> NDArray[np.int64]:
    """Number of the water below each row, −1 over land, (M,)."""
    over = np.full(len(graph.strip), -1, dtype=np.int64)
    for number, basin in enumerate(basins):
        shapely.prepare(basin)
        inside = [shapely.contains_xy(basin, p[:, 0], p[:, 1]) for p in
                  (graph.left_m, graph.middle_m, graph.right_m)]  # fmt: skip
        over[inside[1] & (inside[0] | inside[2]) | (inside[0] & inside[2])] = number
    return over


def _waters(
    graph: RoadGraph, basins: Sequence[Area], over: NDArray[np.int64], grid: GroundGrid
) -> tuple[Water, ...]:
    waters = []
    for number, basin in enumerate(basins):
        rim = shapely.get_coordinates(shapely.segmentize(shapely.boundary(basin), 5.0))
        bridges = graph.middle_m[over == number, 2]
        waters.append(Water(area=basin, level_m=water_level_m(basin, grid.height(rim), bridges)))
    return tuple(waters)


def _shrunk(waters: Sequence[Water], graph: RoadGraph, state: States) -> tuple[Water, ...]:
    """The waters without what is paved on the land beside them."""
    if not waters:
        return ()
    on_land = np.isin(state, (State.GROUND, State.FILLED, State.BANK))
    land = shapely.buffer(strips_area(graph, on_land), 1.0, join_style="mitre")
    parts = [
        Water(area=areas_only(shapely.difference(water.area, land), 20.0), level_m=water.level_m)
        for water in waters
    ]
    return tuple(part for part in parts if not part.area.is_empty)


def _carried(graph: RoadGraph, high: Mask, lift: Array, zones: Zones) -> States:
    """State of the raised rows: piers, walls or an embankment."""
    middle = graph.middle_m[high]
    gap = _gap_below(graph, high)
    country = np.zeros(len(middle), dtype=bool)
    for kind, area in zones:
        if kind in _BANK_ZONES:
            shapely.prepare(area)
            country |= shapely.contains_xy(area, middle[:, 0], middle[:, 1])
    state = np.where(lift[high] > OPEN_M, State.OPEN, State.FILLED).astype(np.int8)
    near = gap < np.maximum(WING_M, BANK_SLOPE * lift[high] + 2.0)
    bank = np.where(gap < ABUTMENT_M, State.OPEN, np.where(near, State.FILLED, State.BANK))
    return np.where(country, bank, state).astype(np.int8)


def _gap_below(graph: RoadGraph, high: Mask) -> Array:
    """Distance of each raised row's cross-section from anything paved on the ground below it [m]."""
    shares = np.linspace(0.0, 1.0, 7)[:, None, None]
    low = np.flatnonzero(~high)
    across = graph.left_m[low] + shares * (graph.right_m - graph.left_m)[low]
    points = across.reshape(-1, 3)
    tree = cKDTree(points[:, :2])
    bars = graph.left_m[high] + shares * (graph.right_m - graph.left_m)[high]
    best = np.full(bars.shape[1], np.inf)
    for bar in bars:
        distance, index = tree.query(bar[:, :2], k=12, distance_upper_bound=30.0)
        index = np.minimum(index, len(points) - 1)
        below = bar[:, None, 2] - points[index, 2] > 1.5
        best = np.minimum(best, np.where(below, distance, np.inf).min(axis=1))
    return best


def _settle(graph: RoadGraph, state: States, lift: Array, strips: Sequence[Strip]) -> None:
    """Close short gaps between open stretches, and give each junction one state."""
    for a, b in zip(graph.first[:-1], graph.first[1:], strict=True):
        states = state[a:b]
        filled = states == State.FILLED
        for i, j in runs(filled):
            inner = i > 0 and j < len(states) and states[i - 1] == State.OPEN and states[j] == State.OPEN
            if inner and j - i < SHORT_GAP_M:
                states[i:j] = State.OPEN
    groups: dict[str, list[int]] = {}
    for number, strip in enumerate(strips):
        if strip.junction_id is not None:
            groups.setdefault(strip.junction_id, []).append(number)
    for group in groups.values():
        rows = np.concatenate([np.arange(graph.first[k], graph.first[k + 1]) for k in group])
        if not len(rows) or (state[rows] == State.SUNKEN).any():
            continue
        counts = np.bincount(state[rows], minlength=5)
        common = int(np.argmax(counts))
        if counts[common] < len(rows):
            up = counts[State.OPEN] + counts[State.FILLED]
            mean = float(lift[rows].mean())
            if up > 0.5 * len(rows):
                common = State.OPEN if mean > OPEN_M or counts[State.OPEN] > 0 else State.FILLED
            state[rows] = common


def _points(graph: RoadGraph, mask: Mask) -> Array:
    return np.concatenate([graph.left_m[mask], graph.right_m[mask]])
