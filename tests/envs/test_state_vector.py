"""The state vector and the bird's-eye view against geometry done another way."""

from collections.abc import Iterator

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import MakeEnv

from carlaloc_env.core.ego import EGO_FRONT_M, EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.envs.task import birds_eye_view
from carlaloc_env.envs.task.birds_eye_view import (
    AHEAD_M,
    CHANNELS,
    PX_M,
    SIZE_PX,
    BirdsEyeView,
)
from carlaloc_env.envs.task.road_users import Ego, first_in_path
from carlaloc_env.envs.task.state_vector import NEIGHBOURS, ROUTE_AHEAD_M, SIGHT_M, corner_speeds, state_names
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.traffic.signals import SignalState

GO = np.array([0.0, 0.45], np.float32)


@pytest.fixture(scope="module")
def env() -> Iterator[CarlaLocEnv]:
    """Town03 among traffic, with the truth about all others."""
    made = CarlaLocEnv(map="Town03", rig="bev", info=("truth", "objects"))
    yield made
    made.close()


def _told(vector: np.ndarray) -> dict[str, float]:
    return dict(zip(state_names(), vector.tolist(), strict=True))


def _steps(env: CarlaLocEnv, seed: int, steps: int) -> tuple[dict[str, np.ndarray], dict[str, object]]:
    observation, info = env.reset(seed=seed)
    for _ in range(steps):
        observation, _, ended, _, info = env.step(GO)
        assert not ended
    return observation, info


@pytest.mark.parametrize(("seed", "steps"), [(1, 5), (2, 40), (3, 60)])
def test_neighbours_are_those_of_the_truth(env: CarlaLocEnv, seed: int, steps: int) -> None:
    """Complex numbers in place of sines and cosines."""
    observation, info = _steps(env, seed, steps)
    objects, truth = info["objects"], info["truth"]
    told = _told(observation["state"])
    state = env.world.state
    turn = np.exp(-1j * state.heading_rad)
    centre = complex(*state.position_m[:2]) + (EGO_REAR_M + 0.5 * EGO_SIZE_M[0]) / turn
    at = objects.position_m[:, 0] + 1j * objects.position_m[:, 1]
    relative = (at - centre) * turn
    level = np.abs(objects.position_m[:, 2] - objects.size_m[:, 2] / 2 - truth.position_m[2]) < 3.0
    order = [n for n in np.argsort(np.abs(relative)) if level[n] and abs(relative[n]) < 49.0][:NEIGHBOURS]
    assert len(order) >= 2
    for number, n in enumerate(order):
        place = complex(told[f"neighbour_{number}_forward"], told[f"neighbour_{number}_left"]) * 50.0
        # The middle of a box leans with the ground that it stands on.
        assert place == pytest.approx(relative[n], abs=0.1)
        on_foot = objects.tag[n] == Tag.PEDESTRIAN
        assert told[f"neighbour_{number}_is_walker"] == float(on_foot)
        assert told[f"neighbour_{number}_length"] * 15.0 == pytest.approx(objects.size_m[n, 0], abs=1e-5)
        moved = complex(*objects.velocity_mps[n, :2]) * turn - state.speed_mps
        velocity = complex(
            told[f"neighbour_{number}_forward_velocity"], told[f"neighbour_{number}_left_velocity"]
        )
        assert velocity * 20.0 == pytest.approx(moved, abs=0.35)


def test_the_car_and_its_route_are_those_of_the_world(env: CarlaLocEnv) -> None:
    observation, _ = _steps(env, 2, 40)
    told, world = _told(observation["state"]), env.world
    assert told["speed"] * 40.0 == pytest.approx(world.state.speed_mps, abs=1e-4)
    assert told["lateral_offset"] * 5.0 == pytest.approx(world.route_offset_m, abs=1e-4)
    assert told["to_go"] == pytest.approx(
        min((world.route.length_m - world.route_s_m) / 1000.0, 1.0), abs=1e-4
    )
    here = world.route.at(world.route_s_m)
    error = np.arctan2(told["heading_error_sin"], told["heading_error_cos"])
    assert error == pytest.approx(wrap_angle(world.state.heading_rad - here.heading_rad[0]), abs=2e-3)
    turn = np.exp(-1j * world.state.heading_rad)
    for number, ahead_m in enumerate(ROUTE_AHEAD_M):
        point = world.route.at(world.route_s_m + ahead_m)
        expected = (complex(*point.position_m[0, :2]) - complex(*world.state.position_m[:2])) * turn / ahead_m
        found = complex(told[f"route_forward_{number}"], told[f"route_left_{number}"])
        assert found == pytest.approx(expected, abs=5e-3)


def test_gap_and_light_are_what_a_driver_sees(env: CarlaLocEnv) -> None:
    """`DriverView` samples the route by the metre; crossing traffic, which it also heeds, comes nearer."""
    compared = lights = 0
    for seed in range(4):
        env.reset(seed=seed)
        for _ in range(6):
            for _ in range(15):
                observation, _, ended, _, _ = env.step(GO)
                if ended:
                    break
            if ended:
                break
            told, view = _told(observation["state"]), env.world.driver_view()
            gap_m = told["gap"] * SIGHT_M
            if view.leader_gap_m is not None and gap_m < SIGHT_M - 1.0:
                assert gap_m > view.leader_gap_m - 1.5
                compared += abs(gap_m - view.leader_gap_m) < 1.5
            if view.stop_line_distance_m is not None and abs(view.stop_line_distance_m) < SIGHT_M - 1.0:
                assert told["light_distance"] * SIGHT_M == pytest.approx(view.stop_line_distance_m, abs=0.1)
                red, yellow = view.signal_state == SignalState.RED, view.signal_state == SignalState.YELLOW
                assert (told["light_red"], told["light_yellow"]) == (float(red), float(yellow))
                lights += 1
    assert compared >= 5
    assert lights >= 5


@pytest.mark.parametrize("closed", [False, True])
def test_a_gap_is_exact_between_samples(closed: bool) -> None:
    """Along a straight line the gap is a difference of places, wherever both are between the samples."""
    rng, step_m = np.random.default_rng(0), 0.5
    route = np.stack([np.arange(400) * step_m, np.zeros(400), np.zeros(400)], axis=1)
    for ego_m, away_m, length_m in zip(
        rng.uniform(0.0, 80.0, 40), rng.uniform(12.0, 90.0, 40), rng.uniform(2.0, 9.0, 40), strict=True
    ):
        row = int(ego_m / step_m)
        gap_m, speed_mps = first_in_path(
            route, np.zeros(400), row, ego_m - row * step_m, step_m, closed,
            np.array([[ego_m + away_m, 0.3, 0.0]], np.float32), np.zeros(1, np.float32),
            np.full(1, 4.0, np.float32), np.array([[length_m, 1.8]]), SIGHT_M,
            Ego(x=ego_m, y=0.0, z=0.0, cos=1.0, sin=0.0, speed_mps=9.0),
        )  # fmt: skip
        assert gap_m == pytest.approx(away_m - 0.5 * length_m - EGO_FRONT_M, abs=1e-4)
        assert speed_mps == 4.0


def test_room_and_braking_are_those_of_uniform_deceleration(env: CarlaLocEnv) -> None:
    """At the nearer of leader and red line: braking so for 2 d / v s takes the closing speed v away."""
    gaps = lines = 0
    for seed in range(12):
        env.reset(seed=seed, options={"start": "anywhere"})
        for _ in range(25):
            observation, _, ended, _, _ = env.step(2.0 * GO)
            told = _told(observation["state"])
            gap_m, line_m = told["gap"] * SIGHT_M, told["light_distance"] * SIGHT_M
            stop = line_m > 0.0 and bool(told["light_red"] or told["light_yellow"])
            room_m = min(gap_m, line_m) if stop else gap_m
            assert told["room"] == pytest.approx(np.clip(room_m / 20.0, -1.0, 1.0), abs=1e-5)
            braking_mps2, wanted = told["braking"] * 8.0, [0.0]
            closing = [(told["gap_closing"] * 20.0, gap_m)]
            closing += [(told["speed"] * 40.0, line_m)] if stop else []
            for speed_mps, distance_m in closing:
                if speed_mps > 0.0:
                    time_s = 2.0 * max(distance_m, 0.5) / speed_mps
                    wanted.append(speed_mps / time_s)
            assert braking_mps2 == pytest.approx(min(max(wanted), 8.0), rel=2e-3, abs=1e-3)
            limit_mps = told["speed_limit"] * 40.0
            assert told["safe_speed"] == pytest.approx(_safe_share(told, limit_mps, stop), rel=2e-3, abs=2e-3)
            gaps, lines = gaps + (room_m == gap_m < SIGHT_M - 1.0), lines + (stop and room_m == line_m)
            if ended:
                break
    assert gaps >= 10
    assert lines >= 10


def _safe_share(told: dict[str, float], limit_mps: float, stop: bool) -> float:
    """The highest of many speeds that uniform braking of 2.5 m/s² takes away a metre before what is ahead."""
    v = np.linspace(0.0, limit_mps, 4000)
    leader_mps = max(told["speed"] * 40.0 - told["gap_closing"] * 20.0, 0.0)
    safe = np.maximum(v - leader_mps, 0.0) ** 2 / 5.0 <= max(told["gap"] * SIGHT_M - 1.0, 0.0)
    if stop:
        safe &= v**2 / 5.0 <= max(told["light_distance"] * SIGHT_M - 1.0, 0.0)
    return float(v[safe].max()) / limit_mps


def test_corner_speeds_are_those_of_a_car_that_brakes_in_time(env: CarlaLocEnv) -> None:
    """Braking at 2.5 m/s² from the corner speed at any point, no later curve takes more than 2 m/s²."""
    route = env.world.route
    speeds, curvature = corner_speeds(route), np.abs(route.curvature_radpm)
    number = len(speeds)
    for first in range(0, number, 37):
        ahead = np.arange(min(200, number))
        rows = (first + ahead) % number if route.closed else np.minimum(first + ahead, number - 1)
        left = np.maximum(speeds[first] ** 2 - 2.0 * 2.5 * route.step_m * ahead, 0.0)
        taken = left * curvature[rows]
        assert taken.max() <= 2.0 + 1e-6
        assert taken.max() == pytest.approx(2.0, rel=0.01) or speeds[first] > 20.0


def test_a_loop_begun_elsewhere_stays_whole(env: CarlaLocEnv) -> None:
    _, whole = env.reset(seed=1)
    quarter = env.world.route.at(0.25 * whole["route_length_m"])
    _, info = env.reset(seed=1, options={"start": 0.25})
    assert info["route_length_m"] == whole["route_length_m"]
    assert abs(info["route_s_m"]) < 1.0
    np.testing.assert_allclose(env.world.state.position_m[:2], quarter.position_m[0, :2], atol=0.6)
    turned = wrap_angle(env.world.state.heading_rad - quarter.heading_rad[0])
    assert turned == pytest.approx(0.0, abs=0.03)


def test_a_straight_road_from_above(make_env: MakeEnv) -> None:
    """One lane of 3.5 m whose middle the car follows: rows, columns and areas are plain arithmetic."""
    env = make_env(rig="bev")
    observation, _ = env.reset(seed=0)
    picture = observation["bev"]
    road, lanes, route = (picture[..., CHANNELS.index(name)] for name in ("road", "lanes", "route"))
    # The lane begins at the car's start and runs 300 m ahead of it.
    start_row = AHEAD_M / PX_M
    ahead = road[: int(start_row) - 2]
    assert np.abs(ahead.astype(bool).sum(axis=1) - 3.5 / PX_M).max() < 1.01
    columns = np.flatnonzero(road[10])
    assert columns.mean() + 0.5 == pytest.approx(SIZE_PX / 2, abs=0.6)
    assert np.abs(np.flatnonzero(lanes[10]) + 0.5 - SIZE_PX / 2).max() == pytest.approx(1.75 / PX_M, abs=1.0)
    assert route[10, SIZE_PX // 2] == 255
    assert not picture[..., CHANNELS.index("actors")].any()


def test_what_lies_off_the_picture_from_above_is_not_drawn(
    env: CarlaLocEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pieces of lanes and road users beyond its edges are left out, and every byte stays."""
    view, seen, drawn = BirdsEyeView(env.world.town.network), birds_eye_view._seen, [0, 0]

    def all_near(ego: Ego, middles_m: np.ndarray, corners_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        away = np.abs(middles_m - np.array(ego[:3]))
        rows = np.flatnonzero((away < [60.0, 60.0, 4.0]).all(axis=1))
        dx, dy = np.moveaxis(corners_m[rows].astype(np.float64) - ego[:2], -1, 0)
        ahead, left = ego.cos * dx + ego.sin * dy, ego.cos * dy - ego.sin * dx
        pixels = np.stack([SIZE_PX / 2 - left / PX_M, (AHEAD_M - ahead) / PX_M], axis=-1) - 0.5
        drawn[0], drawn[1] = drawn[0] + len(rows), drawn[1] + len(seen(ego, middles_m, corners_m)[1])
        return np.rint(16.0 * pixels).astype(np.int32), rows

    for seed in range(6):
        env.reset(seed=seed, options={"start": "anywhere"})
        few = view.draw(env.world)
        with monkeypatch.context() as patched:
            patched.setattr(birds_eye_view, "_seen", all_near)
            np.testing.assert_array_equal(few, view.draw(env.world))
    assert 0 < drawn[1] < 0.5 * drawn[0]


def test_road_users_from_above_stand_where_the_vector_says(env: CarlaLocEnv) -> None:
    seen = 0
    for seed in range(8):
        observation, _ = env.reset(seed=seed, options={"route": "random"})
        told, actors = _told(observation["state"]), observation["bev"][..., CHANNELS.index("actors")]
        for number in range(NEIGHBOURS):
            ahead = told[f"neighbour_{number}_forward"] * 50.0 + EGO_REAR_M + 0.5 * EGO_SIZE_M[0]
            left = told[f"neighbour_{number}_left"] * 50.0
            row, column = (AHEAD_M - ahead) / PX_M, SIZE_PX / 2 - left / PX_M
            inside = 3 < row < SIZE_PX - 3 and 3 < column < SIZE_PX - 3
            if told[f"neighbour_{number}_is_vehicle"] and inside:
                assert actors[int(row), int(column)] == 255
                seen += 1
    assert seen >= 3
