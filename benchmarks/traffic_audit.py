"""Audit of traffic from outside: overlapping boxes, stuck vehicles, lights run, walkers hit or astray."""

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.traffic.signals import SignalState
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.world import TrafficWorld

NOBODY = EgoView(position_m=(1e5, 1e5, 0.0), heading_rad=0.0, speed_mps=0.0)
"""An ego that is nowhere near."""
STUCK_MPS = 0.1
"""Slower than this, a vehicle stands [m/s]."""
LATE_S = 1.0
"""A front that crosses its line after so long a red has run it [s]."""
BODY_RADIUS_M = 0.25
"""A walker is a disc of this radius [m]."""
_HEIGHT_M = 3.0
"""Largest difference of height of boxes on one level [m]; more is a bridge or an underpass."""


@dataclass(slots=True, kw_only=True)
class TrafficReport:
    """Findings of a run of traffic, seen from outside."""

    vehicles: int
    """Number of vehicles."""
    walkers: int
    """Number of walkers."""
    duration_s: float
    """Length of the run [s]."""
    overlap_fraction: float
    """Fraction of vehicle-seconds in which a vehicle's box overlaps another's."""
    longest_stand_s: float
    """Longest time for which a vehicle stood without a break [s]."""
    speed_fraction: float
    """Mean over all vehicles and times of speed over the limit of the lane."""
    red_runs: int
    """Fronts that crossed a stop line whose lights had all been red for more than a second."""
    lines_crossed: int
    """Fronts that crossed a stop line with lights."""
    walker_hits: int
    """Walker-seconds inside a vehicle's box."""
    walkers_astray: int
    """Walker-seconds neither on a sidewalk nor on a crosswalk."""
    walked_across: int
    """Walker-seconds on crosswalks."""
    lane_changes: int
    """Lane changes that began."""
    step_ms: tuple[float, float]
    """CPU time of one step: least and median [ms]."""
    overlaps: list[tuple[float, int, int]] = field(default_factory=list)
    """Time [s] and the two vehicles of every overlap, once for each second."""
    red_runners: list[tuple[float, int]] = field(default_factory=list)
    """Time [s] and vehicle of every line crossed at red."""
    hits: list[tuple[float, int]] = field(default_factory=list)
    """Time [s] and walker of every walker-second inside a box; walkers count from the first vehicle on."""


def audit_traffic(
    network: LaneNetwork, config: TrafficConfig, duration_s: float, tables: TrafficTables | None = None
) -> TrafficReport:
    """Run traffic and watch it every second, at lights and for standing vehicles every 50 ms."""
    world = TrafficWorld(network, config, tables)
    frame = world.reset()
    watch = _Watch(network, world)
    steps = round(duration_s * 1e9) // STEP_NS
    costs = np.zeros(steps)
    for step in range(steps):
        watch.see(frame, step)
        begin = time.process_time()
        frame = world.step(NOBODY)
        costs[step] = time.process_time() - begin
    return watch.report(duration_s, costs)


class _Watch:
    def __init__(self, network: LaneNetwork, world: TrafficWorld) -> None:
        self._network = network
        self._world = world
        is_walker = world.catalog.tag == Tag.PEDESTRIAN
        self._vehicles, self._walkers = np.flatnonzero(~is_walker), np.flatnonzero(is_walker)
        count = len(self._vehicles)
        self._stand_s, self._longest_s = np.zeros(count), 0.0
        self._speed_fraction: list[float] = []
        self._overlaps: list[tuple[float, int, int]] = []
        self._red_runners: list[tuple[float, int]] = []
        self._hits: list[tuple[float, int]] = []
        self._crossed = self._astray = self._across = self._changes = 0
        self._was_changing = np.zeros(count, dtype=bool)
        self._lines = _StopLines(network)
        self._before: ActorFrame | None = None

    def see(self, frame: ActorFrame, step: int) -> None:
        """Record one frame."""
        speed = frame.speed_mps[self._vehicles]
        self._stand_s = np.where(speed < STUCK_MPS, self._stand_s + STEP_NS / 1e9, 0.0)
        self._longest_s = max(self._longest_s, float(self._stand_s.max(initial=0.0)))
        states = self._world.signals(step * STEP_NS)
        if self._before is not None:
            crossed, red = self._lines.passed(
                self._before, frame, self._world.catalog, self._vehicles, states
            )
            self._crossed += crossed
            self._red_runners += [(step * STEP_NS / 1e9, int(v)) for v in red]
        else:
            self._lines.update(states)
        self._before = frame
        changing = self._world.changing_lanes()
        self._changes += int(np.count_nonzero(changing & ~self._was_changing))
        self._was_changing = changing
        if step % 20 == 0:
            self._each_second(frame, step)

    def _each_second(self, frame: ActorFrame, step: int) -> None:
        limit = self._world.speed_limits_mps()
        self._speed_fraction.append(
            float(np.mean(frame.speed_mps[self._vehicles] / limit)) if len(limit) else 1.0
        )
        for a, b in overlapping_boxes(frame, self._world.catalog, self._vehicles):
            self._overlaps.append((step * STEP_NS / 1e9, int(a), int(b)))
        if len(self._walkers):
            hit = walkers_in_boxes(frame, self._world.catalog, self._vehicles, self._walkers)
            self._hits += [(step * STEP_NS / 1e9, int(w)) for w in self._walkers[hit]]
            sidewalk, crosswalk = on_walkable(self._network, frame.position_m[self._walkers])
            self._astray += int(np.count_nonzero(~sidewalk & ~crosswalk))
            self._across += int(np.count_nonzero(crosswalk & ~sidewalk))

    def report(self, duration_s: float, costs_s: Array) -> TrafficReport:
        """The findings."""
        seconds = max(len(self._speed_fraction), 1)
        hit = {(at, v) for at, a, b in self._overlaps for v in (a, b)}
        return TrafficReport(
            vehicles=len(self._vehicles),
            walkers=len(self._walkers),
            duration_s=duration_s,
            overlap_fraction=len(hit) / (seconds * max(len(self._vehicles), 1)),
            longest_stand_s=self._longest_s,
            speed_fraction=float(np.mean(self._speed_fraction)),
            red_runs=len(self._red_runners),
            lines_crossed=self._crossed,
            walker_hits=len(self._hits),
            walkers_astray=self._astray,
            walked_across=self._across,
            lane_changes=self._changes,
            step_ms=(1e3 * float(costs_s.min()), 1e3 * float(np.median(costs_s))),
            overlaps=self._overlaps,
            red_runners=self._red_runners,
            hits=self._hits,
        )


def overlapping_boxes(frame: ActorFrame, catalog: ActorCatalog, which: Index) -> NDArray[np.intp]:
    """Pairs (K, 2) of vehicles whose boxes overlap, by the separating axes of two rectangles.

    Boxes more than 3 m apart in height do not count: one of them is on a bridge.
    """
    position = frame.position_m[which].astype(np.float64)
    half = 0.5 * catalog.size_m[which, :2].astype(np.float64)
    heading = frame.heading_rad[which].astype(np.float64)
    if len(which) < 2:
        return np.zeros((0, 2), np.intp)
    range_m = 2.0 * float(np.hypot(half[:, 0], half[:, 1]).max())
    pairs = cKDTree(position[:, :2]).query_pairs(range_m, output_type="ndarray")
    pairs = pairs[np.abs(position[pairs[:, 0], 2] - position[pairs[:, 1], 2]) < _HEIGHT_M]
    a, b = pairs[:, 0], pairs[:, 1]
    delta = position[b, :2] - position[a, :2]
    apart = np.zeros(len(pairs), dtype=np.bool_)
    for own, other in ((a, b), (b, a)):
        turn = heading[other] - heading[own]
        cos, sin = np.abs(elementary.cos(turn)), np.abs(elementary.sin(turn))
        c, s = elementary.cos(heading[own]), elementary.sin(heading[own])
        along = np.abs(delta[:, 0] * c + delta[:, 1] * s)
        across = np.abs(delta[:, 1] * c - delta[:, 0] * s)
        apart[along > half[own, 0] + half[other, 0] * cos + half[other, 1] * sin] = True
        apart[across > half[own, 1] + half[other, 0] * sin + half[other, 1] * cos] = True
    result: NDArray[np.intp] = which[pairs[~apart]]
    return result


def walkers_in_boxes(
    frame: ActorFrame, catalog: ActorCatalog, vehicles: Index, walkers: Index
) -> NDArray[np.bool_]:
    """Which walkers' discs touch a vehicle's box, (W,)."""
    delta = frame.position_m[walkers, None].astype(np.float64) - frame.position_m[None, vehicles]
    heading = frame.heading_rad[vehicles].astype(np.float64)
    half = 0.5 * catalog.size_m[vehicles, :2].astype(np.float64)
    along = (
        np.abs(delta[..., 0] * elementary.cos(heading) + delta[..., 1] * elementary.sin(heading)) - half[:, 0]
    )
    across = (
        np.abs(delta[..., 1] * elementary.cos(heading) - delta[..., 0] * elementary.sin(heading)) - half[:, 1]
    )
    gap = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
    touched: NDArray[np.bool_] = (gap < BODY_RADIUS_M) & (np.abs(delta[..., 2]) < _HEIGHT_M)
    result: NDArray[np.bool_] = np.any(touched, axis=1)
    return result


def on_walkable(
    network: LaneNetwork, position_m: NDArray[np.float32]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether points (W, 3) lie on a sidewalk (within 0.1 m), and whether on a crosswalk, (W,) each."""
    near = network.nearest(position_m, types=("sidewalk",))
    width = network.width_m(near.lane, near.station_m)
    on_lane = np.abs(near.offset_m) <= 0.5 * width + 0.1
    sidewalk: NDArray[np.bool_] = on_lane & (near.distance_m <= 0.5 * width + 0.5)
    crosswalk: NDArray[np.bool_] = np.zeros(len(position_m), dtype=bool)
    for item in network.crosswalks:
        path = item.end_m[:2] - item.start_m[:2]
        length = float(np.hypot(path[0], path[1]))
        along = np.sum((position_m[:, :2] - item.start_m[:2]) * path, axis=1) / length
        side = position_m[:, :2] - item.start_m[:2] - along[:, None] * path / length
        level = np.abs(position_m[:, 2] - item.start_m[2]) < _HEIGHT_M
        inside = (along > -0.6) & (along < length + 0.6) & level
        crosswalk |= inside & (np.hypot(side[:, 0], side[:, 1]) < 0.5 * item.width_m + 0.1)
    return sidewalk, crosswalk


class _StopLines:
    """Lines across lanes with lights, and for how long each of their heads has been red."""

    def __init__(self, network: LaneNetwork) -> None:
        lines: dict[int, tuple[float, list[int]]] = {}
        for index, head in enumerate(network.signals):
            for own, stop in zip(head.lanes, head.stop_station_m, strict=True):
                lines.setdefault(own, (stop, []))[1].append(index)
        self._network = network
        self._lane = lane = np.array(list(lines), dtype=np.int64)
        station = np.array([stop for stop, _ in lines.values()])
        self._heads = [np.array(heads) for _, heads in lines.values()]
        pose = network.pose(lane, station)
        self._point = pose.position_m
        self._heading = pose.heading_rad
        self._half_m = 0.5 * network.width_m(lane, station)
        self._red_s = np.zeros(len(network.signals))

    def update(self, states: NDArray[np.uint8]) -> None:
        """Count for how long every head has been red."""
        self._red_s = np.where(states == SignalState.RED, self._red_s + STEP_NS / 1e9, 0.0)

    def passed(
        self,
        before: ActorFrame,
        after: ActorFrame,
        catalog: ActorCatalog,
        vehicles: Index,
        states: NDArray[np.uint8],
    ) -> tuple[int, Index]:
        """How many fronts crossed a line in the last step, and which vehicles did so at red."""
        self.update(states)
        if not len(self._heads):
            return 0, vehicles[:0]
        half = 0.5 * catalog.size_m[vehicles, 0].astype(np.float64)
        fronts = []
        for frame in (before, after):
            heading = frame.heading_rad[vehicles].astype(np.float64)
            nose = np.stack([elementary.cos(heading), elementary.sin(heading)], axis=-1) * half[:, None]
            fronts.append(frame.position_m[vehicles, :2] + nose)
        c, s = elementary.cos(self._heading), elementary.sin(self._heading)
        old, new = ((f[:, None] - self._point[None, :, :2]) for f in fronts)
        was = old[..., 0] * c + old[..., 1] * s
        now = new[..., 0] * c + new[..., 1] * s
        side = np.abs(new[..., 1] * c - new[..., 0] * s)
        level = np.abs(after.position_m[vehicles, 2][:, None] - self._point[None, :, 2]) < _HEIGHT_M
        along = elementary.cos(after.heading_rad[vehicles][:, None] - self._heading) > 0.8
        hit = (was < 0.0) & (now >= 0.0) & (side < self._half_m) & level & along
        # Lanes of a fork lie beside each other: only the line of the lane counts on which the front was.
        which = np.flatnonzero(hit.any(axis=1))
        nose_m = np.column_stack([fronts[0], before.position_m[vehicles, 2]])[which]
        hit[which] &= self._network.nearest(nose_m).lane[:, None] == self._lane
        rows = np.flatnonzero(hit.any(axis=0))
        late = [k for k in rows if (self._red_s[self._heads[k]] > LATE_S).all()]
        red: Index = vehicles[hit[:, late].any(axis=1)]
        return int(hit.sum()), red
