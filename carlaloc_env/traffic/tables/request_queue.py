"""Requests of vehicles to enter junctions, and junction lanes that are held by those admitted."""

from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.record_arrays import columns
from carlaloc_env.traffic.tables.vehicle_state import HELD, PLAN, Fleet


class RequestQueue:
    """Vehicles that come up to a junction and ask to enter, W rows."""

    vehicle: Index
    """Number of the vehicle, (W,)."""
    hop: Index
    """Index of the first junction lane in the vehicle's plan, (W,)."""
    distance_m: Array
    """From its front to that lane [m], (W,)."""
    urgency: Array
    """Urgency: requests are decided from the greatest on, (W,)."""


class Requests(NamedTuple):
    """Requests to enter junctions, and the vehicles admitted to each lane, the holders."""

    queue: RequestQueue
    """The first ``used[0]`` rows are in use."""
    holder_first: Index
    """Rows of `holder` for each lane, (N + 1,)."""
    holder: Index
    """Vehicle or ego · HELD + slot in its list of held lanes, ((N + C) · HELD,)."""
    claimed: Array
    """Room claimed on each lane by those admitted to a junction before it [m], (N,)."""
    used: Index
    """Requests in use, and the number of the next ticket, (2,)."""


def empty_requests(vehicles: int, egos: int, lanes: int) -> Requests:
    """Room for all requests of a number of vehicles, one for each lane of each plan at most.

    Args:
        vehicles: Number of vehicles, egos not counted.
        egos: Number of egos.
        lanes: Number of lanes.
    """
    return Requests(
        queue=columns(RequestQueue, vehicles * PLAN),
        holder_first=np.zeros(lanes + 1, np.int64),
        holder=np.zeros((vehicles + egos) * HELD, np.int64),
        claimed=np.zeros(lanes),
        used=np.zeros(2, np.int64),
    )


@compiled
def swap_requests(queue: RequestQueue, a: int, b: int) -> None:
    """Exchange two rows of the queue."""
    queue.vehicle[a], queue.vehicle[b] = queue.vehicle[b], queue.vehicle[a]
    queue.hop[a], queue.hop[b] = queue.hop[b], queue.hop[a]
    queue.distance_m[a], queue.distance_m[b] = queue.distance_m[b], queue.distance_m[a]
    queue.urgency[a], queue.urgency[b] = queue.urgency[b], queue.urgency[a]


@compiled
def list_holders(requests: Requests, fleet: Fleet) -> None:
    """Sort all holders by lane; writes `holder_first` (N + 1,) and `holder`."""
    first = requests.holder_first
    first[:] = 0
    rows, slots = fleet.held_lane.shape
    for v in range(rows):
        for k in range(slots):
            if fleet.held_lane[v, k] >= 0:
                first[fleet.held_lane[v, k]] += 1
    for lane in range(1, len(first)):
        first[lane] += first[lane - 1]
    # Each lane's end moves down to its beginning, one holder at a time.
    for v in range(rows - 1, -1, -1):
        for k in range(slots - 1, -1, -1):
            lane = fleet.held_lane[v, k]
            if lane >= 0:
                first[lane] -= 1
                requests.holder[first[lane]] = v * HELD + k


@compiled
def holds(fleet: Fleet, v: int, lane: int) -> bool:
    """Whether a vehicle has been admitted to a lane."""
    is_held = False
    for k in range(HELD):
        is_held = is_held or fleet.held_lane[v, k] == lane
    return is_held


@compiled
def drop_holds_ahead(fleet: Fleet, v: int) -> None:
    """Give up all lanes that the vehicle has not entered."""
    for k in range(HELD):
        if fleet.held_lane[v, k] >= 0 and fleet.held_front_m[v, k] < 0.0:
            fleet.held_lane[v, k] = -1
