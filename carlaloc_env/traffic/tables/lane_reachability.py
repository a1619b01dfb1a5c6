"""Paths from every lane to the junction lanes ahead, and the lane changes that they take.

A driver who comes up to a junction has chosen one lane through it. For every lane before it the table holds
the lane changes left, their side, where to go on otherwise, and how far ahead the last chance lies.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.traffic.tables.record_arrays import Flags, packed

CHANGE_ROOM_M = 18.0
"""Shortest lane on which a lane change is planned [m]."""
CLOSED_FRACTION = 0.5
"""Where a smaller fraction of all lanes leads on for ever, vehicles may leave the map."""
_FAR_M = 3000.0
"""Room beyond this makes no difference to a driver [m]."""


class GoalPaths:
    """One row for each pair of a plain lane and a junction lane that it leads to, K rows."""

    goal: Index
    """Junction lane, (K,)."""
    changes: Index
    """Lane changes that are left, (K,)."""
    side: Index
    """Where to change to from here: 1 left, −1 right, 0 nowhere yet, (K,)."""
    onward: Index
    """Lane to go on to without a change, −1 = the change must happen before this lane ends, (K,)."""
    room_m: Array
    """From the lane's end to the last station at which all changes are still possible [m], (K,)."""


def find_goal_paths(
    length_m: Array,
    junction: Index,
    left: Index,
    right: Index,
    after: Sequence[Sequence[int]],
    before: Sequence[Sequence[int]],
    driving: Flags,
) -> tuple[Index, GoalPaths, Flags, Flags]:
    """Paths from all plain lanes to the next junction.

    Args:
        length_m: Length of each lane [m], (N,).
        junction: Junction of each lane, −1 = none, (N,).
        left: Left neighbour, −1 = none, (N,).
        right: Right neighbour, −1 = none, (N,).
        after: Driving successors of each lane.
        before: Driving predecessors of each lane.
        driving: Whether cars drive on a lane, (N,).

    Returns:
        Where each lane's rows begin (N + 1,), the rows, the lanes from which one can drive for ever (N,), and
        those at whose end one leaves the map (N,): none where most lanes go on for ever without leaving it.
    """
    entries = [
        lane
        for lane in range(len(length_m))
        if junction[lane] >= 0 and any(junction[n] < 0 for n in before[lane])
    ]
    changes = {goal: _changes_to(goal, length_m, junction, left, right, before) for goal in entries}
    leaves = np.zeros(len(length_m), dtype=bool)
    lasting = _lasting(junction, after, changes, leaves)
    plain_m = np.where(driving & (junction < 0), length_m, 0.0)
    if float(np.sum(plain_m[lasting])) < CLOSED_FRACTION * float(np.sum(plain_m)):
        leaves = road_ends(driving, junction, left, right, after)
        lasting = _lasting(junction, after, changes, leaves)
    rows: list[list[tuple[int, int, int, int, float]]] = [[] for _ in length_m]
    for goal in entries:
        if lasting[goal]:
            counts = changes[goal]
            for lane in sorted(counts):
                rows[lane].append(_path_to(goal, lane, counts, length_m, left, right, after))
    first, paths = packed(GoalPaths, rows)
    return first, paths, lasting, leaves


def road_ends(
    driving: Flags, junction: Index, left: Index, right: Index, links: Sequence[Sequence[int]]
) -> Flags:
    """Driving lanes outside junctions at which a road ends as a whole, (N,).

    Args:
        driving: Whether cars drive on a lane, (N,).
        junction: Junction of each lane, −1 = none, (N,).
        left: Left neighbour, −1 = none, (N,).
        right: Right neighbour, −1 = none, (N,).
        links: Successors of each lane, or predecessors for where roads begin.
    """
    linked = np.array([bool(ends) for ends in links], dtype=bool)
    ends: Flags = driving & (junction < 0) & ~linked
    for beside in (left, right):
        for lane in np.flatnonzero(ends).tolist():
            other = int(beside[lane])
            while other >= 0 and not linked[other]:
                other = int(beside[other])
            ends[lane] = other < 0
    return ends


def _changes_to(
    goal: int, length_m: Array, junction: Index, left: Index, right: Index, before: Sequence[Sequence[int]]
) -> dict[int, int]:
    """Fewest lane changes to a junction lane from every plain lane before it, nearest first."""
    changes: dict[int, int] = {}
    queue = deque((lane, 0) for lane in before[goal] if junction[lane] < 0)
    while queue:
        lane, count = queue.popleft()
        if changes.get(lane, count + 1) <= count:
            continue
        changes[lane] = count
        beside = (int(left[lane]), int(right[lane]))
        queue.extendleft((m, count) for m in before[lane] if junction[m] < 0)
        if length_m[lane] >= CHANGE_ROOM_M:
            queue.extend((n, count + 1) for n in beside if n >= 0)
    return changes


def _path_to(
    goal: int,
    lane: int,
    changes: dict[int, int],
    length_m: Array,
    left: Index,
    right: Index,
    after: Sequence[Sequence[int]],
) -> tuple[int, int, int, int, float]:
    """Record of `GoalPaths` from a lane to a goal."""
    count = changes[lane]
    side = 0
    if count and length_m[lane] >= CHANGE_ROOM_M:
        if changes.get(int(left[lane]), count) < count:
            side = 1
        elif changes.get(int(right[lane]), count) < count:
            side = -1
    onward, room = _onward(goal, lane, changes, after), 0.0
    ahead = onward
    while count and ahead >= 0 and room < _FAR_M and changes[ahead] == count:
        room += float(length_m[ahead])
        ahead = _onward(goal, ahead, changes, after)
    return goal, count, side, onward, room


def _onward(goal: int, lane: int, changes: dict[int, int], after: Sequence[Sequence[int]]) -> int:
    if goal in after[lane]:
        return goal
    options = [n for n in after[lane] if changes.get(n, changes[lane] + 1) <= changes[lane]]
    return min(options, key=lambda n: (changes[n], n)) if options else -1


def _lasting(
    junction: Index, after: Sequence[Sequence[int]], changes: dict[int, dict[int, int]], leaves: Flags
) -> Flags:
    """Lanes that lead on for ever, or out of the map: dead ends are peeled off until nothing changes."""
    reached: list[list[int]] = [[] for _ in junction]
    for goal, counts in changes.items():
        for lane in counts:
            reached[lane].append(goal)
    lasting = np.array([bool(own) or bool(goals) for own, goals in zip(after, reached, strict=True)]) | leaves
    peeling = True
    while peeling:
        peeling = False
        for lane in np.flatnonzero(lasting & ~leaves).tolist():
            if not any(lasting[n] for n in after[lane]) and not any(lasting[n] for n in reached[lane]):
                lasting[lane] = False
                peeling = True
    return lasting
