"""Traffic: car following in equilibrium, speed tables, signals as formulas, seeds, a standing ego."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.map.config import SignalTiming
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.signals import SignalPlan, SignalState
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.tables.lane_tables import (
    COMFORT_BRAKING_MPS2,
    LATERAL_ACCELERATION_MPS2,
    SLOWEST_BEND_MPS,
    allowed_speeds,
)
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.car_following import idm_plus
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.world import TrafficWorld

FAR_AWAY = EgoView(position_m=(1e5, 1e5, 0.0), heading_rad=0.0, speed_mps=0.0)


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    """Town03's lanes."""
    return load_town("Town03").network


@pytest.fixture(scope="module")
def tables(network: LaneNetwork) -> TrafficTables:
    """What traffic knows of Town03."""
    return TrafficTables(network)


LAW = (1.2, 2.0, 1.4, 2.0)
"""Headway [s], standstill gap [m], acceleration and braking [m/s²]."""


@pytest.mark.parametrize("speed", [3.0, 8.0, 13.0])
def test_equilibrium_gap_is_standstill_gap_plus_headway(speed: float) -> None:
    """In equilibrium behind a leader of equal speed the gap is s0 + v·T, exactly."""
    assert idm_plus(speed, 20.0, 2.0 + 1.2 * speed, speed, *LAW) == pytest.approx(0.0, abs=1e-12)
    assert idm_plus(speed, 20.0, 1.5 + 1.2 * speed, speed, *LAW) < 0
    assert idm_plus(speed, speed, np.inf, speed, *LAW) == pytest.approx(0.0, abs=1e-12)


def test_a_following_car_settles_at_the_equilibrium_gap() -> None:
    """A car that comes up behind a leader at 8 m/s settles at s0 + v·T without touching it."""
    gap, speed, closest = 60.0, 14.0, 60.0
    for _ in range(4000):
        a = idm_plus(speed, 14.0, gap, 8.0, *LAW)
        gap += (8.0 - speed) * 0.05
        speed += a * 0.05
        closest = min(closest, gap)
    assert gap == pytest.approx(2.0 + 1.2 * 8.0, abs=0.05)
    assert closest > 8.0


def test_speed_tables_keep_lateral_acceleration(network: LaneNetwork) -> None:
    """No lane may be driven faster than its limit or than its bend allows."""
    v, tables = allowed_speeds(network), network.tables
    assert (v <= tables.speed_limit_mps + 1e-9).all()
    # Kinks tighter than any car can turn are driven through at walking pace.
    bend = np.abs(tables.curvature_radpm)
    assert (v * v * bend <= LATERAL_ACCELERATION_MPS2 + 1e-6)[v > SLOWEST_BEND_MPS].all()
    assert LATERAL_ACCELERATION_MPS2 <= 3.0


def test_speed_tables_leave_room_to_brake(network: LaneNetwork) -> None:
    """From every sample to the next, v² falls by no more than comfortable braking takes off."""
    v, tables = allowed_speeds(network), network.tables
    for first, count, step in zip(tables.first, tables.count, tables.step_m, strict=True):
        own = v[first : first + count]
        assert (own[:-1] ** 2 - own[1:] ** 2 <= 2.0 * COMFORT_BRAKING_MPS2 * step + 1e-6).all()


def test_signal_groups_of_a_junction_are_never_open_together(network: LaneNetwork) -> None:
    """Heads of different phases never show green or yellow at once; every head gets its green."""
    timing = SignalTiming(green_s=15.0, yellow_s=3.0, all_red_s=2.0)
    plan = SignalPlan.from_network(network, timing)
    sequence = {(j.id, c.id): c.sequence for j in network.xodr.junctions for c in j.controllers}
    states = np.array([plan.at(k * 500_000_000).state for k in range(2 * 240)])
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
    states = np.array([plan.at(k * STEP_NS).state[0] for k in range(20 * 400)])
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


def test_protected_left_turns_have_a_green_of_their_own(network: LaneNetwork) -> None:
    """Phases that hold left turns alone are green for `left_green_s`, all others for `green_s`."""
    timing = SignalTiming(green_s=15.0, left_green_s=6.0, yellow_s=3.0, all_red_s=2.0)
    plan = SignalPlan.from_network(network, timing)
    states = np.array([plan.at(k * STEP_NS).state for k in range(20 * 200)])
    kinds = set()
    for index, head in enumerate(network.signals):
        green = states[:, index] == SignalState.GREEN
        edges = np.flatnonzero(np.diff(green.astype(int)))
        runs = {round((b - a) * 0.05, 1) for a, b in itertools.pairwise(edges) if green[a + 1]}
        lanes = np.array(head.junction_lanes)
        length = np.array([network.lanes[n].length_m for n in lanes])
        turn = network.pose(lanes, length).heading_rad - network.pose(lanes, 0.0 * length).heading_rad
        left = bool((np.mod(turn + np.pi, 2.0 * np.pi) - np.pi > 0.5).all())
        kinds.add((left, next(iter(runs))))
        assert len(runs) == 1
    assert (False, 15.0) in kinds
    assert (True, 6.0) in kinds


def test_time_until_green_agrees_with_the_states(network: LaneNetwork) -> None:
    """After the announced time each head is green, and just before it is not."""
    plan = SignalPlan.from_network(network, SignalTiming())
    for second in range(0, 120, 7):
        waits = plan.at(second * 1_000_000_000).until_green_s
        for head in range(len(network.signals)):
            at = round((second + waits[head]) * 1e9)
            assert plan.at(at).state[head] == SignalState.GREEN
            if waits[head] > 0.0:
                assert plan.at(at - 1_000_000).state[head] != SignalState.GREEN


def test_an_offset_shifts_every_cycle(network: LaneNetwork) -> None:
    """The state at t with an offset is the state at t less the offset without it."""
    plain = SignalPlan.from_network(network, SignalTiming())
    later = SignalPlan.from_network(network, SignalTiming(offset_s=7.5))
    for second in range(0, 200, 3):
        shifted = later.at(round((second + 7.5) * 1e9)).state
        assert (shifted == plain.at(second * 1_000_000_000).state).all()


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
    world.reset()
    lane = int(np.bincount(world._vehicles.fleet.plan[:-1, 0]).argmax())
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
    with pytest.raises(ConfigError, match=r"--traffic dynamic,vehicles=\d+$"):
        world.reset()
