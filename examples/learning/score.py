"""Scores of agents and of the scripted driver: routes among traffic of seeds that no training uses."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from carlaloc_env import CarlaLocEnv, Referee
from recorder import ScriptedDriver

STEP_TICKS = 10
"""Ticks of 5 ms in a step."""

UNSEEN = range(10_000, 10_050)
"""The seeds."""


class Ride(NamedTuple):
    """How an episode went."""

    completion: float
    driven_m: float
    ended_by: str


def by_agent(env: Any, act: Callable[[Any], Any], seed: int) -> Ride:
    """A ride with actions of an agent."""
    seen, info = env.reset(seed=seed)
    while not info["ended_by"]:
        seen, _, _, _, info = env.step(act(seen))
    return Ride(info["route_completion"], info["route_s_m"], info["ended_by"])


def by_driver(env: CarlaLocEnv, seed: int) -> Ride:
    """A ride of the scripted driver."""
    env.reset(seed=seed)
    world, driver, ended = env.world, ScriptedDriver(seed), None
    referee = Referee(world, env.task)
    while not ended:
        touched = [t for _ in range(STEP_TICKS) for t in world.tick(driver.read(world.driver_view()))]
        verdict = referee.judge(touched)
        ended = verdict.ended_by or verdict.truncated_by
        world.forget_before(world.now_ns - 2_000_000_000)
    done = 1.0 if ended == "goal" else world.route_s_m / world.route.length_m
    return Ride(done, world.route_s_m, ended)


def report(name: str, rides: Iterable[Ride]) -> float:
    """Print the mean route completion, collisions a kilometre and ends, and return the first."""
    completion, driven_m, ended_by = zip(*rides, strict=True)
    ends, mean = Counter(ended_by), float(np.mean(completion))
    rate = ends["collision"] / max(sum(driven_m) * 1e-3, 1e-3)
    print(f"{name}: {mean:.1%} of the route, {rate:.2f} collisions a km, {dict(ends)}", flush=True)
    return mean
