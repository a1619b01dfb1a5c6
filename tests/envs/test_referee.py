"""The referee: what is earned and what ends an episode, on roads where both are known."""

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import MakeEnv

from carlaloc_env.core.ego import EGO_FRONT_M
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.traffic.signals import SignalState

GO = np.array([0.0, 0.6], np.float32)
REST = np.array([0.0, -1.0], np.float32)


def test_the_end_of_the_route_is_a_success(make_env: MakeEnv) -> None:
    """100 m but for the last two are earned metre by metre, and the end once."""
    env = make_env(task={"speeding_per_mps_s": 0.0, "time_limit_s": 60.0})
    env.reset(seed=0, options={"spawn": (20.0, 0.0), "goal": (120.0, 0.0)})
    terms: dict[str, float] = {}
    for _ in range(600):
        _, _, ended, over, info = env.step(GO)
        terms = {name: terms.get(name, 0.0) + value for name, value in info["reward_terms"].items()}
        if ended or over:
            break
    assert (ended, over, info["is_success"], info["ended_by"]) == (True, False, True, "goal")
    assert terms["progress"] == pytest.approx(98.0, abs=1.0)
    assert info["route_completion"] == 1.0
    assert terms["goal"] == TaskConfig().goal
    assert info["cost"] == 0.0


def test_speeding_costs_more_than_it_gains(make_env: MakeEnv) -> None:
    """Over a limit of 50 km/h, as OpenDRIVE says where a road has none: gains less costs fall with speed."""
    env = make_env()
    env.reset(seed=0)
    for _ in range(400):
        _, _, ended, _, info = env.step(np.array([0.0, 1.0], np.float32))
        speed = env.world.state.speed_mps
        if speed > 16.0 or ended:
            break
    excess = speed - float(env.world.route.speed_limit_mps[0])
    assert excess > 0.5
    assert info["reward_terms"]["speeding"] == pytest.approx(-1.5 * excess * 0.05, rel=1e-6)


def test_leaving_the_road_ends_the_episode(make_env: MakeEnv) -> None:
    env = make_env()
    env.reset(seed=0)
    for _ in range(200):
        _, _, ended, _, info = env.step(np.array([0.5, 0.5], np.float32))
        if ended:
            break
    assert info["ended_by"] == "off_road"
    assert info["cost_terms"] == {"red_light": 0.0, "collision": 0.0, "off_road": 1.0}
    # The lane is 3.5 m wide and the car 1.85 m: it is off when its middle is 2.7 m from the lane's.
    assert abs(info["route_offset_m"]) == pytest.approx(1.75 + 0.925, abs=0.8)


def test_standing_and_time_truncate(make_env: MakeEnv) -> None:
    for limit, word, seconds in (("standing_limit_s", "standing", 1.0), ("time_limit_s", "time", 1.5)):
        env = make_env(task={limit: seconds})
        env.reset(seed=0)
        for _ in range(60):
            _, _, ended, over, info = env.step(REST)
            if over:
                break
        assert (ended, over, info["ended_by"]) == (False, True, word)
        assert info["stamp_ns"] * 1e-9 == pytest.approx(seconds, abs=0.11)


def test_a_car_run_into_is_a_collision(make_env: MakeEnv) -> None:
    """Full throttle through Town01 meets somebody; the touch is in `info` with the impulse that ended it."""
    env = make_env(map="Town01", traffic="dynamic", task={"off_road": 0.0, "off_route_m": 1000.0})
    env.reset(seed=3)
    for _ in range(600):
        _, reward, ended, _, info = env.step(np.array([0.0, 0.5], np.float32))
        if ended:
            break
    assert info["ended_by"] == "collision"
    assert max(contact.impulse_ns for contact in info["contacts"]) > TaskConfig().collision_impulse_ns
    assert info["cost_terms"]["collision"] == 1.0
    assert reward < -TaskConfig().collision + 1.0


def test_a_stop_line_passed_at_red_costs_once(make_env: MakeEnv) -> None:
    """Every light of the route is passed by a car without others; lights alone tell which were red."""
    env = make_env(map="Town01", task={"speeding_per_mps_s": 0.0})
    spent, expected, passed = 0.0, 0, 0
    lines_m: list[float] = []
    for line in range(4):
        env.reset(seed=1)
        lines = env.world.stop_lines
        if line >= len(lines.s_m):
            break
        before_m = lines.s_m[line] - EGO_FRONT_M - 14.0
        begin = env.world.route.at(before_m).position_m[0, :2]
        end = env.world.route.position_m[-1, :2]
        env.reset(seed=1, options={"spawn": tuple(begin), "goal": tuple(end)})
        lines_m = env.world.stop_lines.s_m.tolist()
        for _ in range(260):
            before = env.world.route_s_m + EGO_FRONT_M
            _, _, ended, _, info = env.step(np.array([0.0, 0.35], np.float32))
            after = env.world.route_s_m + EGO_FRONT_M
            for number, at in enumerate(lines_m):
                if before < at <= after:
                    heads = env.world.stop_lines.heads[number]
                    expected += int(env.world.signals()[heads].max()) == SignalState.RED
                    passed += 1
            spent -= info["reward_terms"]["red_light"]
            if ended or passed > line:
                break
    assert passed >= 2
    assert expected >= 1
    assert spent == pytest.approx(expected * TaskConfig().red_light)
