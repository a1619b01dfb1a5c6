"""Traffic lights as a closed formula of time: no state to keep, none to record."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.errors import ConfigError
from carlaloc_env.town.network import LaneNetwork


class SignalState(IntEnum):
    """What a signal head shows."""

    OFF = 0
    RED = 1
    YELLOW = 2
    GREEN = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalTiming:
    """Durations that all junctions of a town share."""

    green_s: float = 18.0
    """Green of each phase [s]."""
    yellow_s: float = 3.3
    """Yellow [s]; 1 + v/6.1 at 50 km/h (ITE, deceleration 3.05 m/s²)."""
    all_red_s: float = 2.0
    """Red for everybody between two phases [s]."""
    offset_s: float = 0.0
    """How much later all cycles begin [s]."""

    def __post_init__(self) -> None:
        if self.green_s <= 0 or self.yellow_s < 0 or self.all_red_s < 0:
            raise ConfigError("signal timing: green_s must be positive, yellow_s and all_red_s not negative")


class SignalPlan:
    """State of every signal head of a town at any time.

    Heads of one controller show the same; controllers of a junction with the same sequence number
    are green together; phases follow each other in the order of that number. Heads without a
    controller form one phase per direction of approach.
    """

    def __init__(
        self, start_ns: NDArray[np.int64], cycle_ns: NDArray[np.int64], timing: SignalTiming
    ) -> None:
        self._start_ns = start_ns
        self._cycle_ns = cycle_ns
        self._green_ns = round(timing.green_s * 1e9)
        self._yellow_ns = round(timing.yellow_s * 1e9)

    @classmethod
    def from_network(cls, network: LaneNetwork, timing: SignalTiming | None = None) -> SignalPlan:
        """Plan of all heads of `network.signals`, in their order."""
        timing = timing or SignalTiming()
        phase_ns = round((timing.green_s + timing.yellow_s + timing.all_red_s) * 1e9)
        count = len(network.signals)
        start = np.zeros(count, np.int64)
        cycle = np.full(count, phase_ns, np.int64)
        groups: dict[str, list[int]] = defaultdict(list)
        for index, head in enumerate(network.signals):
            groups[head.junction_id or f"signal {head.id}"].append(index)
        for junction, heads in groups.items():
            phases = _phases(network, junction, heads)
            total = phase_ns * max(2, 1 + max(phases))
            offset = int.from_bytes(hashlib.blake2b(junction.encode(), digest_size=4).digest(), "big")
            for index, phase in zip(heads, phases, strict=True):
                cycle[index] = total
                start[index] = phase * phase_ns + offset % 1000 * total // 1000 + round(timing.offset_s * 1e9)
        return cls(start, cycle, timing)

    def state_at(self, stamp_ns: int) -> NDArray[np.uint8]:
        """`SignalState` of every head at a time [ns], shape (S,)."""
        into = np.mod(stamp_ns - self._start_ns, self._cycle_ns)
        state = np.where(into < self._green_ns, SignalState.GREEN, SignalState.RED)
        yellow = (into >= self._green_ns) & (into < self._green_ns + self._yellow_ns)
        return np.where(yellow, SignalState.YELLOW, state).astype(np.uint8)


def _phases(network: LaneNetwork, junction_id: str, heads: list[int]) -> list[int]:
    """Phase number of each head of one junction, counted from 0."""
    sequence = {
        controller.id: controller.sequence
        for junction in network.xodr.junctions
        if junction.id == junction_id
        for controller in junction.controllers
    }
    keys: list[tuple[int, int | str]] = []
    for index in heads:
        head = network.signals[index]
        if head.controller_id is not None and head.controller_id in sequence:
            keys.append((0, sequence[head.controller_id]))
        else:
            keys.append((1, _axis(network, index)))
    order = sorted(set(keys))  # type: ignore[type-var]
    return [order.index(key) for key in keys]


def _axis(network: LaneNetwork, index: int) -> str:
    """Direction of approach in steps of 90°, opposite directions alike."""
    head = network.signals[index]
    if not head.lanes:
        return "none"
    pose = network.pose(np.array(head.lanes[:1]), np.array(head.stop_station_m[:1]))
    quarter = int(np.round(float(pose.heading_rad[0]) / (np.pi / 2)))
    return "east-west" if quarter % 2 == 0 else "north-south"
