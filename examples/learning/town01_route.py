"""Town01's route among its traffic, driven or corrected by the scripted driver, for examples 11 to 13."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import CarlaLocEnv, Referee, StateVector, steer_and_pedal
from recorder import ScriptedDriver

STEP_TICKS = 10
"""Ticks of 5 ms in a step."""
SKIP = 4
"""Steps of 50 ms per action: five actions a second."""
Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""Action, steering and pedal, of an observation."""


class Ride(NamedTuple):
    """Observations of a ride, the scripted driver's actions (done or proposed), and its end."""

    seen: NDArray[np.float32]
    taught: NDArray[np.float32]
    completion: float
    ended_by: str


def make_env(time_limit_s: float = 600.0, **task: float) -> CarlaLocEnv:
    """The environment; episodes are truncated after a time [s]."""
    return CarlaLocEnv("Town01", "state", frame_skip=SKIP, task={"time_limit_s": time_limit_s, **task})


def ride(env: CarlaLocEnv, seed: int, pupil: Policy | None, **options: Any) -> Ride:
    """An episode; without a pupil the scripted driver drives, otherwise it only proposes actions."""
    env.reset(seed=seed, options=options)
    world, teacher, rows, ended = env.world, ScriptedDriver(seed), [], None
    referee, state = Referee(world, env.task), StateVector(world)
    while not ended:
        seen, said = state.observe(referee.standing_s), []
        own = None if pupil is None else steer_and_pedal(pupil(seen))
        for _ in range(SKIP):
            touched = []
            for _ in range(STEP_TICKS):
                controls = teacher.read(world.driver_view())
                said.append((controls.steer, controls.throttle - controls.brake))
                touched += world.tick(own or controls)
            verdict = referee.judge(touched)
            state.follow()
            if ended := verdict.ended_by or verdict.truncated_by:
                break
        rows.append((seen, np.mean(said, axis=0, dtype=np.float32)))
        world.forget_before(world.now_ns - 2_000_000_000)
    seen, taught = map(np.array, zip(*rows, strict=True))
    done = 1.0 if ended == "goal" else world.route_s_m / world.route.length_m
    return Ride(seen, taught, done, ended)
