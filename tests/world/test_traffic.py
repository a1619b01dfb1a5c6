"""Traffic: car following in equilibrium, signals as formulas, and a run of Town03 watched from outside."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.clock import STEP_NS
from carlaloc_env.errors import ConfigError
from carlaloc_env.semantics import Tag
from carlaloc_env.timeline import ActorCatalog, ActorFrame
from carlaloc_env.town.build import find_town
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.traffic.car_following import SpeedTables, idm_plus
from carlaloc_env.traffic.ego_view import EgoView
from carlaloc_env.traffic.signal_plan import SignalPlan, SignalState, SignalTiming
from carlaloc_env.traffic.tables import TrafficTables
from carlaloc_env.traffic.world import TrafficConfig, TrafficWorld

FAR_AWAY = EgoView(position_m=(1e5, 1e5, 0.0), heading_rad=0.0, speed_mps=0.0)


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    """Town03's lanes."""
    return LaneNetwork.from_opendrive(find_town("Town03"))


@pytest.fixture(scope="module")
def tables(network: LaneNetwork) -> TrafficTables:
    """What traffic knows of Town03."""
    return TrafficTables(network)


def test_equilibrium_gap_is_standstill_gap_plus_headway() -> None:
    """In equilibrium behind a leader of equal speed the gap is s0 + v·T, exactly."""
    speed = np.array([3.0, 8.0, 13.0])
    one = np.ones(3)
    law = {
        "headway_s": 1.2 * one,
        "standstill_m": 2.0 * one,
        "acceleration_mps2": 1.4 * one,
        "braking_mps2": 2.0 * one,
    }
    held = idm_plus(speed, 20.0 * one, 2.0 + 1.2 * speed, speed, **law)
    assert np.allclose(held, 0.0, atol=1e-12)
    assert (idm_plus(speed, 20.0 * one, 1.5 + 1.2 * speed, speed, **law) < 0).all()
    free = idm_plus(speed, speed, np.full(3, np.inf), speed, **law)
    assert np.allclose(free, 0.0, atol=1e-12)


def test_a_following_car_settles_at_the_equilibrium_gap() -> None:
    """A car that comes up behind a leader at 8 m/s settles at s0 + v·T without touching it."""
    gap, speed, closest = 60.0, 14.0, 60.0
    for _ in range(4000):
        a = idm_plus(
            np.array([speed]), np.array([14.0]), np.array([gap]), np.array([8.0]),
            headway_s=np.array([1.2]), standstill_m=np.array([2.0]),
            acceleration_mps2=np.array([1.4]), braking_mps2=np.array([2.0]),
        )[0]  # fmt: skip
        gap += (8.0 - speed) * 0.05
        speed += a * 0.05
        closest = min(closest, gap)
    assert gap == pytest.approx(2.0 + 1.2 * 8.0, abs=0.05)
    assert closest > 8.0


def test_speed_tables_keep_lateral_acceleration(network: LaneNetwork) -> None:
    """No lane may be driven faster than its limit or than its bend allows."""
    tables = SpeedTables(network)
    for lane in network.lanes:
        station = np.linspace(0.0, lane.length_m, 40)
        index = np.full(40, lane.index)
        v = tables.at(index, station)
        # The table holds the value of the sample before; bends change little over half a metre.
        bend = np.abs(network.pose(index, np.floor(station / 0.5) * 0.5).curvature_radpm)
        assert (v * v * bend <= 2.2 + 1e-6).all()
        assert (v <= network.speed_limit_mps(index, station) + 1e-9).all()


def test_signal_groups_of_a_junction_are_never_open_together(network: LaneNetwork) -> None:
    """Heads of different phases never show green or yellow at once; every head gets its green."""
    timing = SignalTiming(green_s=15.0, yellow_s=3.0, all_red_s=2.0)
    plan = SignalPlan.from_network(network, timing)
    sequence = {(j.id, c.id): c.sequence for j in network.xodr.junctions for c in j.controllers}
    states = np.array([plan.state_at(k * 500_000_000) for k in range(2 * 240)])
    assert len(network.signals) > 8
    open_ = (states == SignalState.GREEN) | (states == SignalState.YELLOW)
    for a, head_a in enumerate(network.signals):
        for b, head_b in enumerate(network.signals):
            if head_a.junction_id != head_b.junction_id or head_a.junction_id is None:
                continue
            phase_a = sequence.get((head_a.junction_id, head_a.controller_id or ""))
            phase_b = sequence.get((head_b.junction_id, head_b.controller_id or ""))
            if phase_a is not None and phase_b is not None and phase_a != phase_b:
                assert not (open_[:, a] & open_[:, b]).any()
    assert open_.any(axis=0).all()
    assert (states == SignalState.RED).any(axis=0).all()


def test_signal_phases_last_as_long_as_configured(network: LaneNetwork) -> None:
    """Green, yellow and red of a head follow each other with the configured durations."""
    plan = SignalPlan.from_network(network, SignalTiming(green_s=15.0, yellow_s=3.0, all_red_s=2.0))
    states = np.array([plan.state_at(k * STEP_NS)[0] for k in range(20 * 400)])
    edges = np.flatnonzero(np.diff(states.astype(int))) + 1
    runs = [(int(states[a]), (b - a) * 0.05) for a, b in itertools.pairwise(edges)]
    green = [duration for state, duration in runs if state == SignalState.GREEN]
    yellow = [duration for state, duration in runs if state == SignalState.YELLOW]
    assert len(green) > 2
    assert green == pytest.approx([15.0] * len(green), abs=0.051)
    assert yellow == pytest.approx([3.0] * len(yellow), abs=0.051)
    order = [s for s, _ in runs]
    assert all(
        following == SignalState.YELLOW
        for state, following in itertools.pairwise(order)
        if state == SignalState.GREEN
    )


def test_an_offset_shifts_every_cycle(network: LaneNetwork) -> None:
    """The state at t with an offset is the state at t less the offset without it."""
    plain = SignalPlan.from_network(network, SignalTiming())
    later = SignalPlan.from_network(network, SignalTiming(offset_s=7.5))
    for second in range(0, 200, 3):
        shifted = later.state_at(round((second + 7.5) * 1e9))
        assert (shifted == plain.state_at(second * 1_000_000_000)).all()


def _boxes(frame: ActorFrame, catalog: ActorCatalog, which: NDArray[np.intp]) -> NDArray[np.float64]:
    """Corners of boxes in the plane, shape (N, 4, 2)."""
    half = 0.5 * catalog.size_m[which, :2].astype(np.float64)
    c, s = np.cos(frame.heading_rad[which]), np.sin(frame.heading_rad[which])
    signs = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    local = half[:, None, :] * signs[None]
    x = c[:, None] * local[..., 0] - s[:, None] * local[..., 1]
    y = s[:, None] * local[..., 0] + c[:, None] * local[..., 1]
    return frame.position_m[which, None, :2] + np.stack([x, y], axis=-1)


def _overlapping(boxes: NDArray[np.float64], height_m: NDArray[np.float32]) -> int:
    """Pairs of boxes that overlap, by separating axes."""
    centre = boxes.mean(axis=1)
    count = 0
    for a in range(len(boxes)):
        near = np.flatnonzero(np.linalg.norm(centre - centre[a], axis=1) < 14.0)
        for b in near[near > a]:
            if abs(float(height_m[a] - height_m[b])) > 3.0:
                continue
            edges = np.concatenate([np.diff(boxes[a][:3], axis=0), np.diff(boxes[b][:3], axis=0)])
            axes = np.stack([-edges[:, 1], edges[:, 0]], axis=-1)
            pa, pb = boxes[a] @ axes.T, boxes[b] @ axes.T
            count += bool(((pa.max(0) > pb.min(0)) & (pb.max(0) > pa.min(0))).all())
    return count


@pytest.fixture(scope="module")
def run(network: LaneNetwork, tables: TrafficTables) -> tuple[TrafficWorld, list[ActorFrame]]:
    """Three minutes of Town03 with 50 vehicles and 10 walkers."""
    world = TrafficWorld(network, TrafficConfig(vehicles=50, walkers=10, seed=5), tables)
    frames = [world.reset()]
    frames += [world.step(FAR_AWAY) for _ in range(20 * 180)]
    return world, frames


def test_vehicles_never_overlap(run: tuple[TrafficWorld, list[ActorFrame]]) -> None:
    """In three minutes no two vehicle boxes overlap in more than 0.05 % of actor-seconds."""
    world, frames = run
    vehicles = np.flatnonzero(world.catalog.tag != Tag.PEDESTRIAN)
    seconds = frames[::20]
    found = sum(_overlapping(_boxes(f, world.catalog, vehicles), f.position_m[vehicles, 2]) for f in seconds)
    assert found <= 0.0005 * len(seconds) * len(vehicles)


def test_traffic_flows(run: tuple[TrafficWorld, list[ActorFrame]]) -> None:
    """Nobody stands for 150 s, and the mean speed is above a quarter of the usual limit of 50 km/h."""
    world, frames = run
    vehicles = np.flatnonzero(world.catalog.tag != Tag.PEDESTRIAN)
    speed = np.array([f.speed_mps[vehicles] for f in frames])
    travelled = np.array([f.travelled_m[vehicles] for f in frames])
    assert (travelled[-1] - travelled[-3000] > 5.0).all()
    assert speed.mean() > 0.25 * 13.9


def test_motion_is_continuous(run: tuple[TrafficWorld, list[ActorFrame]]) -> None:
    """Nobody jumps: each step covers the distance that the speed says, within what a lane's joint adds."""
    _, frames = run
    for before, after in itertools.pairwise(frames):
        moved = np.linalg.norm(after.position_m - before.position_m, axis=1)
        fastest = np.maximum(before.speed_mps, after.speed_mps) * 0.05
        assert (moved < fastest * 1.25 + 0.06).all()


def test_red_lights_are_obeyed(network: LaneNetwork, tables: TrafficTables) -> None:
    """No vehicle's front passes a stop line whose heads all show red."""
    world = TrafficWorld(network, TrafficConfig(vehicles=50, walkers=0, seed=9, warm_up_s=0.0), tables)
    world.reset()
    vehicles = world._vehicles
    half = 0.5 * vehicles.drivers.length_m
    stops = {
        lane: (stop, [k for k, head in enumerate(network.signals) if lane in head.lanes])
        for head in network.signals
        for lane, stop in zip(head.lanes, head.stop_station_m, strict=True)
    }
    passed = 0
    for step in range(20 * 100):
        lane, front = vehicles.plan[:, 0].copy(), vehicles.station_m + half
        states = world.signals(step * STEP_NS)
        world.step(FAR_AWAY)
        for v in range(len(lane)):
            if int(lane[v]) not in stops or vehicles.plan[v, 0] != lane[v]:
                continue
            line, heads = stops[int(lane[v])]
            if front[v] < line <= vehicles.station_m[v] + half[v]:
                passed += 1
                assert not (states[heads] == SignalState.RED).all(), f"vehicle {v} at step {step}"
    assert passed > 10


def test_walkers_stay_on_the_pavement(
    network: LaneNetwork, run: tuple[TrafficWorld, list[ActorFrame]]
) -> None:
    """Every walker stands within half a width of a sidewalk's centre line."""
    world, frames = run
    walkers = np.flatnonzero(world.catalog.tag == Tag.PEDESTRIAN)
    for frame in frames[::200]:
        near = network.nearest(frame.position_m[walkers], types=("sidewalk",))
        width = network.width_m(near.lane, near.station_m)
        assert (np.abs(near.offset_m) <= 0.5 * width + 0.05).all()


def test_same_seed_same_traffic(network: LaneNetwork, tables: TrafficTables) -> None:
    """Two runs of one seed agree in every bit; another seed differs."""
    config = TrafficConfig(vehicles=30, walkers=5, seed=2, warm_up_s=2.0)

    def last(config: TrafficConfig) -> ActorFrame:
        world = TrafficWorld(network, config, tables)
        world.reset()
        return [world.step(FAR_AWAY) for _ in range(200)][-1]

    first, second, other = last(config), last(config), last(replace(config, seed=3))
    for name in ActorFrame.__slots__:
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    assert first.position_m.tobytes() != other.position_m.tobytes()


def test_traffic_stops_behind_a_standing_ego(network: LaneNetwork, tables: TrafficTables) -> None:
    """An ego parked on a busy lane is never driven into."""
    world = TrafficWorld(network, TrafficConfig(vehicles=60, walkers=0, seed=4, warm_up_s=0.0), tables)
    frame = world.reset()
    vehicles = world._vehicles
    lane = int(np.bincount(vehicles.plan[:, 0]).argmax())
    pose = network.pose(np.array([lane]), np.array([0.8 * network.lanes[lane].length_m]))
    ego = EgoView(
        position_m=tuple(float(v) for v in pose.position_m[0]),
        heading_rad=float(pose.heading_rad[0]),
        speed_mps=0.0,
    )
    frame = world.reset(ego)
    for _ in range(20 * 60):
        frame = world.step(ego)
        gap = np.linalg.norm(frame.position_m[:, :2] - pose.position_m[0, :2], axis=1)
        length = world.catalog.size_m[:, 0]
        turn = np.abs(np.cos(frame.heading_rad - ego.heading_rad))
        same = (turn > 0.9) & (np.abs(_side(frame, pose.position_m[0], ego.heading_rad)) < 1.5)
        assert (gap[same] > 0.5 * (length[same] + 4.7) - 0.1).all()


def _side(frame: ActorFrame, point: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    delta = frame.position_m[:, :2] - point[:2]
    return -np.sin(heading) * delta[:, 0] + np.cos(heading) * delta[:, 1]


def test_too_many_vehicles_are_refused(network: LaneNetwork, tables: TrafficTables) -> None:
    """A number that does not fit is an error that says how many do."""
    world = TrafficWorld(network, TrafficConfig(vehicles=5000, walkers=0), tables)
    with pytest.raises(ConfigError, match="at most"):
        world.reset()
