"""Manoeuvres of the ego car against theory and against figures measured on real cars."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_NS, TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.physics.ego import EgoCar, EgoState
from carlaloc_env.physics.params import VehicleParams
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.timeline.ego_spline import EgoTrack

Height = Callable[[Array, Array], Array]


def sheet(height: Height, *, x_m: Array, y_m: Array) -> tuple[Array, NDArray[np.int64]]:
    """Triangles of a height function over a grid."""
    x, y = np.meshgrid(x_m, y_m, indexing="ij")
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    k = np.arange(len(vertices)).reshape(x.shape)
    a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    return vertices, np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])


def flat(x: Array, y: Array) -> Array:
    return 0.0 * x


@pytest.fixture
def plane() -> Iterator[PhysicsWorld]:
    """A flat road of 5 m triangles."""
    mesh = sheet(flat, x_m=np.arange(-50.0, 1000.0, 5.0), y_m=np.arange(-250.0, 251.0, 5.0))
    with PhysicsWorld(*mesh) as world:
        yield world


def car_at(world: PhysicsWorld, x_m: float = 0.0, heading_rad: float = 0.0) -> EgoCar:
    """The car at rest on the road."""
    car = EgoCar(world)
    car.reset((x_m, 0.0, 0.0), heading_rad)
    return car


def hold(car: EgoCar, ticks: int, **controls: Any) -> None:
    """The same controls for some ticks."""
    for _ in range(ticks):
        car.tick(Controls(**controls))


def drive(
    car: EgoCar, ticks: int, *, speed_mps: float, steer: float = 0.0, track: EgoTrack | None = None
) -> list[EgoState]:
    """Hold a speed for some ticks."""
    total = 0.0
    states = []
    for _ in range(ticks):
        state = car.state()
        error = speed_mps - state.speed_mps
        total += error * TICK_S if abs(error) < 2.0 else 0.0
        pedal = 0.5 * error + 0.2 * total + 0.25
        car.tick(Controls(steer=steer, throttle=min(1.0, max(0.0, pedal)), brake=min(1.0, max(0.0, -pedal))))
        state = car.state()
        states.append(state)
        if track is not None:
            track.append(state.position_m, state.quat_xyzw)
    return states


def accelerations(track: EgoTrack) -> Array:
    """Acceleration of base_link [m/s²] at every tick, as an IMU's spline sees it."""
    stamps = np.arange(2, track.last_tick - 1) * TICK_NS
    return track.motion(stamps).acceleration_world_mps2


def stopping_m(car: EgoCar, speed_mps: float) -> float:
    """Way of a full stop from a speed [m]."""
    drive(car, 2000, speed_mps=speed_mps)
    start = car.state()
    assert start.speed_mps == pytest.approx(speed_mps, abs=0.5)
    for _ in range(3000):
        car.tick(Controls(brake=1.0))
        if car.state().speed_mps < 0.05:
            break
    way = float(car.state().position_m[0] - start.position_m[0])
    return way * (speed_mps / start.speed_mps) ** 2


def test_accelerates_like_a_saloon(plane: PhysicsWorld) -> None:
    """0–100 km/h in 5.5–9 s."""
    car = car_at(plane)
    ticks = 0
    while car.state().speed_mps < 100 / 3.6:
        car.tick(Controls(throttle=1.0))
        ticks += 1
        assert ticks < 2000
    assert 5.5 < ticks * TICK_S < 9.0


def test_full_braking_and_wet_road(plane: PhysicsWorld) -> None:
    """Dry 0.85–1.05 g from 100 km/h; wet takes at least a quarter more."""
    car = car_at(plane)
    dry = stopping_m(car, 100 / 3.6)
    assert 0.85 < (100 / 3.6) ** 2 / (2 * dry) / 9.81 < 1.05
    plane.set_friction(0.75)
    car.reset((0.0, 0.0, 0.0), 0.0)
    wet = stopping_m(car, 100 / 3.6)
    assert 1.25 * dry < wet < 2.0 * dry


def test_brakes_stay_straight_and_do_not_lock(plane: PhysicsWorld) -> None:
    """Anti-lock: the wheels keep turning in a full stop, the car keeps its lane."""
    car = car_at(plane)
    drive(car, 1500, speed_mps=20.0)
    while car.state().speed_mps > 5.0:
        car.tick(Controls(brake=1.0))
        state = car.state()
        assert min(state.wheel_spin_radps) * 0.314 > 0.6 * state.speed_mps
    assert abs(car.state().position_m[1]) < 0.05


def yaw_rate_ratio(car: EgoCar, speed_mps: float, lateral_mps2: float) -> tuple[float, float]:
    """Steady yaw rate over that of the linear single-track model, and lateral acceleration [m/s²]."""
    p: VehicleParams = car.params
    angle = lateral_mps2 * (p.wheelbase_m / speed_mps**2 + p.understeer_s2pm)
    car.reset((300.0, 0.0, 0.0), 0.0)
    drive(car, 1400, speed_mps=speed_mps)
    for k in range(100):
        drive(car, 4, speed_mps=speed_mps, steer=angle / p.steer_max_rad * k / 100)
    states = drive(car, 1400, speed_mps=speed_mps, steer=angle / p.steer_max_rad)[-300:]
    rate = float(np.mean([s.omega_body_radps[2] for s in states]))
    v = float(np.mean([s.speed_mps for s in states]))
    return rate * (p.wheelbase_m + p.understeer_s2pm * v * v) / (v * angle), rate * v


@pytest.mark.parametrize("speed_mps", [10.0, 20.0])
def test_turns_like_the_linear_bicycle_model_then_understeers(plane: PhysicsWorld, speed_mps: float) -> None:
    """Within 5 % up to 0.3 g, then less and less yaw rate per steering angle."""
    car = EgoCar(plane)
    ratios = []
    for wanted in (0.1, 0.2, 0.3):
        ratio, lateral = yaw_rate_ratio(car, speed_mps, wanted * 9.81)
        assert lateral == pytest.approx(wanted * 9.81, rel=0.06)
        assert ratio == pytest.approx(1.0, abs=0.05)
        ratios.append(ratio)
    ratios.append(yaw_rate_ratio(car, speed_mps, 0.55 * 9.81)[0])
    ratios.append(yaw_rate_ratio(car, speed_mps, 0.75 * 9.81)[0])
    assert np.all(np.diff(ratios) < 0.0)
    assert ratios[-1] < 0.93


def test_left_is_positive(plane: PhysicsWorld) -> None:
    """Steer +1 turns the wheels 35° left at a limited rate, and the car to its left."""
    car = car_at(plane)
    car.tick(Controls(steer=1.0))
    assert 0.0 < car.state().road_wheel_rad <= math.radians(600.0 / 12.0) * TICK_S * 1.001
    states = drive(car, 600, speed_mps=3.0, steer=1.0)
    assert states[-1].road_wheel_rad == pytest.approx(math.radians(35.0))
    assert states[-1].position_m[1] > 0.5
    assert states[-1].omega_body_radps[2] > 0.0


def test_load_moves_with_acceleration(plane: PhysicsWorld) -> None:
    """Braking moves m·a·h/L to the front axle."""
    car = EgoCar(plane)
    p = car.params
    car.reset((0.0, 0.0, 0.0), 0.0)
    drive(car, 1500, speed_mps=20.0)
    hold(car, 360, brake=0.2)
    loads, slows = [], []
    for _ in range(160):
        car.tick(Controls(brake=0.2))
        state = car.state()
        loads.append(state.wheel_load_n[0] + state.wheel_load_n[1] - 2 * p.static_load_n[0])
        slows.append(-state.acceleration_mps2)
    expected = p.mass_kg * np.mean(slows) * p.cog_z_m / p.wheelbase_m
    assert np.mean(loads) == pytest.approx(expected, rel=0.05)


def test_straight_road_is_smooth(plane: PhysicsWorld) -> None:
    """20 m/s over flat triangles: the IMU's spline sees less than 0.05 m/s² (here less than 0.01)."""
    car = car_at(plane, heading_rad=0.1)
    drive(car, 2000, speed_mps=20.0)
    track = EgoTrack()
    drive(car, 1000, speed_mps=20.0, track=track)
    assert accelerations(track)[:, 2].std() < 0.01


def test_stands_still(plane: PhysicsWorld) -> None:
    """Standing on its brakes after a stop, the car is as quiet as a rock."""
    car = car_at(plane, heading_rad=0.3)
    drive(car, 800, speed_mps=8.0)
    hold(car, 1400, brake=0.3)
    track = EgoTrack()
    for _ in range(600):
        car.tick(Controls(brake=0.3))
        track.append(car.state().position_m, car.state().quat_xyzw)
    assert accelerations(track).std(axis=0).max() < 2e-3
    moved = track.position_m[-1] - track.position_m[0]
    assert np.abs(moved).max() < 1e-4


@pytest.mark.parametrize("heading_rad", [0.0, 1.2])
def test_handbrake_holds_on_a_slope(heading_rad: float) -> None:
    """60 s parked on 5 %: less than 1 cm."""
    mesh = sheet(lambda x, y: 0.05 * x, x_m=np.arange(-50.0, 51.0, 5.0), y_m=np.arange(-50.0, 51.0, 5.0))
    with PhysicsWorld(*mesh) as world:
        car = EgoCar(world)
        start = car.reset((0.0, 0.0, 0.0), heading_rad).position_m
        hold(car, 12_000, handbrake=True)
        assert np.abs(car.state().position_m - start).max() < 0.01


def test_rolls_away_without_brakes() -> None:
    """The same slope without brakes: g·sin − rolling resistance, drive coupled wheels included."""
    mesh = sheet(lambda x, y: 0.05 * x, x_m=np.arange(-100.0, 51.0, 5.0), y_m=np.arange(-50.0, 51.0, 5.0))
    with PhysicsWorld(*mesh) as world:
        car = EgoCar(world)
        p = car.params
        car.reset((0.0, 0.0, 0.0), 0.0)
        hold(car, 250)
        spinning = 4 * p.wheel_inertia_kgm2 / 0.314**2
        slope = math.atan(0.05)
        pull = p.mass_kg * 9.81 * (math.sin(slope) - p.rolling * math.cos(slope)) / (p.mass_kg + spinning)
        before = car.state().speed_mps
        hold(car, 40)
        after = car.state()
        regeneration = p.regeneration_mps2 * abs(before + after.speed_mps) / 2 / p.regeneration_fade_mps
        assert after.acceleration_mps2 < 0.0
        assert (before - after.speed_mps) / 0.2 == pytest.approx(pull - regeneration, rel=0.1)


@pytest.mark.parametrize("speed_mps", [3.0, 8.0])
def test_mounts_a_kerb(speed_mps: float) -> None:
    """A 0.12 m kerb shakes the car as a real one would, and it drives on 0.12 m higher."""

    def kerb(x: Array, y: Array) -> Array:
        return np.where(x > 30.0, 0.12, 0.0)

    x_m = np.concatenate([np.arange(-20.0, 30.1, 5.0), np.arange(30.02, 80.0, 5.0)])
    with PhysicsWorld(*sheet(kerb, x_m=x_m, y_m=np.arange(-20.0, 21.0, 5.0))) as world:
        car = car_at(world)
        track = EgoTrack()
        ticks = round(30.0 / speed_mps / TICK_S) + 800
        states = drive(car, ticks, speed_mps=speed_mps, track=track)
        assert states[-1].position_m[2] == pytest.approx(0.12, abs=0.005)
        assert abs(states[-1].position_m[1]) < 0.05
        peak = np.abs(accelerations(track)[:, 2]).max()
        assert 2.0 < peak < 40.0
        assert world.contacts() == []


def test_bounce_has_the_ride_frequency(plane: PhysicsWorld) -> None:
    """Dropped by hard braking's end, the body swings at 1.0–1.6 Hz and calms down."""
    car = car_at(plane)
    drive(car, 1200, speed_mps=15.0)
    while car.state().speed_mps > 0.02:
        car.tick(Controls(brake=0.7))
    travel = []
    for _ in range(400):
        car.tick(Controls(brake=0.7))
        travel.append(car.state().wheel_travel_m[0])
    tail = np.array(travel) - np.mean(travel[-40:])
    crossings = np.flatnonzero(np.diff(np.sign(tail[np.abs(tail).argmax() :])))
    assert len(crossings) >= 2
    assert 1.0 < 0.5 / ((crossings[1] - crossings[0]) * TICK_S) < 2.2
    assert np.abs(tail[-60:]).max() < 0.2 * np.abs(tail).max()


def test_reverse(plane: PhysicsWorld) -> None:
    """Reverse drives backwards, no faster than a reverse gear."""
    car = car_at(plane, 100.0)
    hold(car, 2000, throttle=0.8, reverse=True)
    assert -8.5 < car.state().speed_mps < -4.0
    assert car.state().position_m[0] < 70.0
