"""Traffic lights as a closed formula of time: no state to keep, none to record.

Main streets are coordinated ("Signal Timing Manual", 2nd edition, NCHRP report 812, chapter 7): junctions of
the route share the longest cycle, spare time is green of their main streets, and between one green and the
next passes the time that a platoon travels in the direction of the route.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.map.config import SignalTiming
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.route import Route
from carlaloc_env.traffic.stop_lines import DEPARTURE_S, StopLines, stop_lines, travel_times_s
from carlaloc_env.traffic.tables.conflict_zones import TURN_RAD
from carlaloc_env.traffic.tables.lane_demand import MAIN_STREET_DEMAND, lane_demand
from carlaloc_env.traffic.tables.lane_tables import Roads

PACE = 0.82
"""Speed of progression over what limits and bends allow: that of vehicles in a platoon."""


class SignalState(IntEnum):
    """State of a signal head."""

    OFF = 0
    RED = 1
    YELLOW = 2
    GREEN = 3


_RED, _YELLOW, _GREEN = (int(state) for state in (SignalState.RED, SignalState.YELLOW, SignalState.GREEN))


class SignalsNow(NamedTuple):
    """All signal heads at one time."""

    state: NDArray[np.uint8]
    """`SignalState` of each, shape (S,)."""
    until_green_s: Array
    """Time until it next turns green [s], 0 while it is green, shape (S,)."""
    until_red_s: Array
    """Time until it next turns red [s], 0 while it is red, shape (S,)."""


class SignalPlan:
    """State of every signal head of a town at any time.

    Heads of one controller show the same; controllers of a junction with the same sequence number
    are green together; phases follow each other in the order of that number. Heads without a
    controller form one phase per direction of approach. Junctions along a route are coordinated. Their cycles
    begin whenever the town has it; with `green_wave`, so that a car that sets out at time 0 meets green.
    """

    def __init__(
        self,
        start_ns: NDArray[np.int64],
        green_ns: NDArray[np.int64],
        cycle_ns: NDArray[np.int64],
        yellow_s: float,
    ) -> None:
        self._start_ns = start_ns
        self._green_ns = green_ns
        self._cycle_ns = cycle_ns
        self._yellow_ns = round(yellow_s * 1e9)

    @classmethod
    def from_network(
        cls,
        network: LaneNetwork,
        timing: SignalTiming | None = None,
        route: Route | None = None,
        demand: Array | None = None,
    ) -> SignalPlan:
        """Plan of all heads of `network.signals`, in their order.

        Args:
            network: The lanes.
            timing: Durations; the usual ones when left out.
            route: Route whose streets are the main ones; None for none.
            demand: Demand for each lane along this route, (N,); worked out when left out.
        """
        timing = timing or SignalTiming()
        lines = StopLines(np.zeros(0), []) if route is None else stop_lines(network, route)
        passed = [heads[0] for heads in lines.heads]
        main = set(passed) if route is None else {*passed, *_main_heads(network, route, demand)}
        junction_of = [head.junction_id or f"signal {head.id}" for head in network.signals]
        junctions: dict[str, list[int]] = defaultdict(list)
        for index, junction in enumerate(junction_of):
            junctions[junction].append(index)
        coordinated = {junction_of[head] for head in passed}
        phases = {junction: _phases(network, heads) for junction, heads in junctions.items()}
        greens_s = {j: _green_durations(network, h, phases[j], timing, main) for j, h in junctions.items()}
        clear_s = timing.yellow_s + timing.all_red_s
        common_s = max((sum(greens_s[j]) + clear_s * len(greens_s[j]) for j in coordinated), default=0.0)
        start, green, cycle, offset_ns = np.zeros((4, len(network.signals)), np.int64)
        for junction, heads in junctions.items():
            durations = greens_s[junction]
            if junction in coordinated:
                streets = {phase for head, phase in zip(heads, phases[junction], strict=True) if head in main}
                spare_s = common_s - sum(durations) - clear_s * len(durations)
                for phase in streets:
                    durations[phase] += spare_s / len(streets)
            begins = np.cumsum([0.0, *(duration + clear_s for duration in durations)])
            digest = int.from_bytes(hashlib.blake2b(junction.encode(), digest_size=4).digest(), "big")
            cycle[heads] = round(float(begins[-1]) * 1e9)
            offset_ns[heads] = digest % 1000 * cycle[heads] // 1000
            for index, phase in zip(heads, phases[junction], strict=True):
                start[index], green[index] = round(float(begins[phase]) * 1e9), round(durations[phase] * 1e9)
        if route is not None and passed:
            town_ns = 0 if timing.green_wave else int(offset_ns[passed[0]])
            arrives_s = DEPARTURE_S + travel_times_s(route, lines.s_m) / PACE
            # Where the route comes twice, the first time counts.
            for head, arrive_s in zip(passed[::-1], arrives_s[::-1].tolist(), strict=True):
                middle_ns = int(start[head] + green[head] // 2)
                offset_ns[junctions[junction_of[head]]] = town_ns + round(arrive_s * 1e9) - middle_ns
        start += offset_ns + round(timing.offset_s * 1e9)
        return cls(start, green, cycle, timing.yellow_s)

    def later(self, offset_s: float) -> SignalPlan:
        """The same plan, begun so much later [s]."""
        start_ns = self._start_ns + round(offset_s * 1e9)
        return SignalPlan(start_ns, self._green_ns, self._cycle_ns, self._yellow_ns / 1e9)

    def at(self, stamp_ns: int) -> SignalsNow:
        """State of every head at a time [ns], and the time of its next change."""
        heads = len(self._start_ns)
        now = SignalsNow(np.empty(heads, np.uint8), np.empty(heads), np.empty(heads))
        _put_signals(self._start_ns, self._green_ns, self._cycle_ns, self._yellow_ns, stamp_ns, *now)
        return now

    def open_fraction(self, roads: Roads) -> NDArray[np.float64]:
        """Fraction of time for which lights let vehicles into each lane, 1 without lights, shape (N,)."""
        fraction = np.zeros(len(roads.lane.head_first))
        lane = np.repeat(np.arange(len(fraction)), roads.lane.head_end - roads.lane.head_first)
        np.maximum.at(fraction, lane, (self._green_ns / self._cycle_ns)[roads.head])
        fraction[roads.lane.head_first == roads.lane.head_end] = 1.0
        return fraction


@compiled
def _put_signals(
    start_ns: NDArray[np.int64],
    green_ns: NDArray[np.int64],
    cycle_ns: NDArray[np.int64],
    yellow_ns: int,
    stamp_ns: int,
    state: NDArray[np.uint8],
    until_green_s: Array,
    until_red_s: Array,
) -> None:
    """Write what S heads show at a time: green from the start of their cycle, then yellow, then red."""
    for head in range(len(start_ns)):
        into = (stamp_ns - start_ns[head]) % cycle_ns[head]
        green, closed = into < green_ns[head], green_ns[head] + yellow_ns
        state[head] = _GREEN if green else _YELLOW if into < closed else _RED
        until_green_s[head] = 0.0 if green else (cycle_ns[head] - into) / 1e9
        until_red_s[head] = max(closed - into, 0) / 1e9


def _main_heads(network: LaneNetwork, route: Route, demand: Array | None) -> set[int]:
    """Heads that straight traffic of main streets obeys."""
    demand = lane_demand(network, route.position_m) if demand is None else demand
    return {
        index
        for index, head in enumerate(network.signals)
        if head.lanes
        and max(demand[lane] for lane in head.lanes) > 0.5 * MAIN_STREET_DEMAND
        and not all(_turns_across(network, lane) for lane in head.junction_lanes)
    }


def _phases(network: LaneNetwork, heads: list[int]) -> list[int]:
    """Phase number of each head of one junction, counted from 0."""
    keys: list[tuple[int, int | str]] = []
    for index in heads:
        sequence = network.signals[index].sequence
        keys.append((1, _axis(network, index)) if sequence is None else (0, sequence))
    order = sorted(set(keys))  # type: ignore[type-var]
    return [order.index(key) for key in keys]


def _green_durations(
    network: LaneNetwork, heads: list[int], phases: list[int], timing: SignalTiming, main: set[int]
) -> list[float]:
    """Green of each phase [s]; a lone phase is followed by a phase without green."""
    durations = []
    for phase in range(1 + max(phases)):
        numbers = [k for k, of_head in zip(heads, phases, strict=True) if of_head == phase]
        lanes = [lane for k in numbers for lane in network.signals[k].junction_lanes]
        across = bool(lanes) and all(_turns_across(network, lane) for lane in lanes)
        if main.intersection(numbers):
            durations.append(timing.main_green_s or timing.green_s)
        else:
            durations.append(min(timing.left_green_s, timing.green_s) if across else timing.green_s)
    return durations if len(durations) > 1 else [*durations, timing.green_s]


def _turns_across(network: LaneNetwork, lane: int) -> bool:
    """Whether a lane turns across the oncoming traffic: left, and right where traffic keeps to the left."""
    tables, kerb_side = network.tables, network.lanes[lane].kerb_side
    first, count = int(tables.first[lane]), int(tables.count[lane])
    turn = tables.heading_rad[first + count - 1] - tables.heading_rad[first]
    return bool(-kerb_side * turn > TURN_RAD)


def _axis(network: LaneNetwork, index: int) -> str:
    """Direction of approach in steps of 90°, opposite directions alike."""
    head = network.signals[index]
    if not head.lanes:
        return "none"
    pose = network.pose(np.array(head.lanes[:1]), np.array(head.stop_station_m[:1]))
    quarter = int(np.round(float(pose.heading_rad[0]) / (np.pi / 2)))
    return "east-west" if quarter % 2 == 0 else "north-south"
