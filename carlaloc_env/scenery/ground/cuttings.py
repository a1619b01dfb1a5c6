"""Stretches of road that lie in a cut between walls, or below a roof."""

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.lane_network import CLEARANCE_M
from carlaloc_env.scenery.ground.grade_graph import RoadGraph, grown, runs
from carlaloc_env.scenery.ground.grade_levels import State, States, Stretch
from carlaloc_env.scenery.ground.height_fields import GroundGrid

ROOF_M = 0.4
"""Thickness of the roof of an underpass [m]."""
COVER_RANGE_M = 30.0
"""Farthest that an underpass stays roofed from the road that crosses it [m]."""
_EASE_M = 12.0


def cuttings(graph: RoadGraph, state: States, grid: GroundGrid, crossings: Array) -> list[Stretch]:
    """Sunken stretches of all strips.

    Args:
        graph: Samples of all roads.
        state: `State` of each sample, shape (M,).
        grid: Heights of the ground.
        crossings: Where roads cross far above each other [m], shape (K, 2).
    """
    stretches = []
    for strip in np.unique(graph.strip[state == State.SUNKEN]):
        rows = graph.rows(int(strip))
        for a, b in runs(grown(state[rows] == State.SUNKEN)):
            if b - a > 2:
                stretches.append(
                    _stretch(graph, state, slice(rows.start + a, rows.start + b), grid, crossings)
                )
    return stretches


def _stretch(graph: RoadGraph, state: States, rows: slice, grid: GroundGrid, crossings: Array) -> Stretch:
    left, right, s = graph.left_m[rows], graph.right_m[rows], graph.s_m[rows]
    # The ends of a cut are where the road is on the ground again; it may go on over the next road.
    ease = np.ones(len(s))
    for end, from_end_m in ((rows.start, s - s[0]), (rows.stop - 1, s[-1] - s)):
        beyond = [n for n in graph.neighbours(end) if not rows.start <= n < rows.stop]
        if not any(state[n] == State.SUNKEN for n in beyond):
            ease = np.minimum(ease, np.clip(from_end_m / _EASE_M, 0.0, 1.0))
    tops = []
    for edge in (left, right):
        top = edge.copy()
        top[:, 2] += (np.maximum(grid.height(edge), edge[:, 2]) - edge[:, 2]) * ease
        tops.append(top)
    depth = np.minimum(tops[0][:, 2] - left[:, 2], tops[1][:, 2] - right[:, 2])
    middle = graph.middle_m[rows][:, None, :2]
    near = np.hypot(*np.moveaxis(middle - crossings[None], -1, 0)).min(axis=1) < COVER_RANGE_M
    return Stretch(
        left_m=left,
        right_m=right,
        left_top_m=tops[0],
        right_top_m=tops[1],
        detached=(depth >= CLEARANCE_M + ROOF_M) & near,
    )
