"""Wheel encoders with the real physics: rolling, bends, slip."""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.ego import Controls
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.samples import WheelTicks
from carlaloc_env.sensors.vehicle import WheelsConfig
from carlaloc_env.timeline.actors import empty_catalog, empty_frame
from carlaloc_env.timeline.timeline import Timeline

WORLD: Any = SimpleNamespace(seed=3)
RADIUS_M, TRACK_M = 0.311, 1.58


def driven(control: Callable[[int, float], Controls], ticks: int) -> Timeline:
    """The ego on a flat plane under controls that see tick and speed."""
    size = 600.0
    corners = np.array([[-size, -size, 0], [size, -size, 0], [size, size, 0], [-size, size, 0]])
    timeline = Timeline(empty_catalog())
    with PhysicsWorld(corners, np.array([[0, 1, 2], [0, 2, 3]])) as world:
        car = EgoCar(world)
        state = car.reset((0.0, 0.0, 0.0), 0.0)
        for tick in range(ticks):
            timeline.ego.append(state.position_m, state.quat_xyzw)
            controls = control(tick, state.speed_mps)
            timeline.car.append(state.wheel_spin_radps, state.road_wheel_rad, controls)
            car.tick(controls)
            state = car.state()
    for _ in range(ticks // 10 + 1):
        timeline.append_step(empty_frame(), np.zeros(1, np.uint8))
    return timeline


def cruise(steer: float, speed_mps: float = 8.0) -> Callable[[int, float], Controls]:
    def control(tick: int, speed: float) -> Controls:
        pedal = 0.5 * (speed_mps - speed) + 0.3
        return Controls(steer=steer, throttle=min(max(pedal, 0.0), 1.0), brake=min(max(-pedal, 0.0), 1.0))

    return control


def read(timeline: Timeline, config: Any, stamps: list[int]) -> list[Any]:
    samples: list[Any] = config.build(WORLD).measure(timeline, stamps)
    return samples


def test_ticks_add_up_to_the_way() -> None:
    """Twelve seconds of mild driving: ticks times tread against the true way, within 1 %."""
    timeline = driven(cruise(0.0), 2402)
    begin, end = read(timeline, WheelsConfig(), [0, 2400 * TICK_NS])
    assert isinstance(end, WheelTicks)
    way = (end.ticks - begin.ticks) / 96 * 2 * math.pi * RADIUS_M
    motion = timeline.ego_motion([0, 2400 * TICK_NS])
    truth = np.linalg.norm(motion.position_m[1] - motion.position_m[0])
    assert truth > 70.0
    assert way[2:].mean() == pytest.approx(truth, rel=0.01)


def test_ticks_are_whole_and_their_rate_is_that_of_the_wheel() -> None:
    """Each count is the angle in ticks, rounded down from the ring's own beginning."""
    timeline = driven(cruise(0.0), 802)
    stamps = [k * 2 * TICK_NS for k in range(400)]
    samples = read(timeline, WheelsConfig(), stamps)
    ticks = np.array([s.ticks for s in samples])
    angle = timeline.car.at(stamps).wheel_angle_rad * 96 / (2 * math.pi)
    rest = ticks - angle
    assert np.all((rest > -1.0) & (rest <= 1.0))
    assert np.all(rest.max(axis=0) - rest.min(axis=0) <= 1.0)
    rate = np.array([s.rate_radps for s in samples])[300:].mean(axis=0)
    assert rate == pytest.approx(timeline.car.at(stamps[300:]).wheel_spin_radps.mean(axis=0), rel=0.01)


def test_a_bend_shows_in_the_rear_wheels() -> None:
    """Yaw from the difference of the rear wheels over the track width, within 4 % of the true turn."""
    timeline = driven(cruise(0.25, 5.0), 2402)
    a, b = 1200 * TICK_NS, 2400 * TICK_NS
    begin, end = read(timeline, WheelsConfig(), [a, b])
    left, right = ((end.ticks - begin.ticks) * 2 * math.pi * RADIUS_M / 96)[2:]
    heading = np.unwrap(
        [2 * math.atan2(q[2], q[3]) for q in timeline.ego_motion(range(a, b + 1, TICK_NS)).quat_xyzw]
    )
    assert (right - left) / TRACK_M == pytest.approx(heading[-1] - heading[0], rel=0.04)


def test_hard_braking_slips() -> None:
    """Under full brakes the wheels turn slower than the car moves, cruising they do not."""

    def control(tick: int, speed: float) -> Controls:
        return cruise(0.0, 20.0)(tick, speed) if tick < 1600 else Controls(brake=1.0)

    timeline = driven(control, 1702)
    for tick, low, high in ((1590, -0.01, 0.02), (1660, 0.02, 1.0)):
        (wheels,) = read(timeline, WheelsConfig(ticks_per_turn=96_000), [tick * TICK_NS])
        motion = timeline.ego_motion([tick * TICK_NS])
        speed = float(np.linalg.norm(motion.velocity_world_mps))
        slip = 1.0 - RADIUS_M * float(wheels.rate_radps[:2].mean()) / speed
        assert low < slip < high, tick
