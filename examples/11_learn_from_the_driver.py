"""Learn to drive Town01's route from the scripted driver, who first drives and then sits beside (DAgger).

A copy of recorded drives alone does not know what to do where the driver never was: too fast behind a queue,
beside the lane. So the pupil takes the wheel, and the teacher says at every action what it would do there
(Ross, Gordon, Bagnell: A Reduction of Imitation Learning ..., AISTATS 2011). Needs the extra `learn`.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import torch
from pupil import Pupil
from town01_route import Policy, make_env, ride

from carlaloc_env.driving_env import DrivingEnv

UNSEEN = range(10_000, 10_050)
"""Seeds of traffic that nobody learns from."""


def main(
    out: Path, shown: int = 12, beside: int = 60, scored: int = 50, time_limit_s: float = 600.0
) -> dict[str, float]:
    """Learn, save the network, and return mean route completions over unseen seeds."""
    torch.set_num_threads(1)
    env, found = make_env(time_limit_s), {}
    rides = [ride(env, seed, None, route=route_of(seed)) for seed in range(shown)]
    pupil = Pupil(rides)
    pupil.learn(rides, passes=40)
    found["copy"] = score(env, "copy", pupil, scored)
    for seed in range(shown, shown + beside):
        rides.append(ride(env, seed, pupil, route=route_of(seed)))
        pupil.learn(rides, passes=6)
        print(f"ride {seed}: {rides[-1].completion:.2f} of the route, {rides[-1].ended_by}", flush=True)
    torch.save({"net": pupil.net.state_dict(), "mean": pupil.mean, "spread": pupil.spread}, out)
    found |= {"pupil": score(env, "pupil", pupil, scored), "teacher": score(env, "teacher", None, scored)}
    env.close()
    return found


def route_of(seed: int) -> str:
    """The town's route, or every third time another one."""
    return "random" if seed % 3 == 2 else "town"


def score(env: DrivingEnv, name: str, policy: Policy | None, count: int) -> float:
    """Mean route completion over unseen seeds."""
    rides = [ride(env, seed, policy) for seed in UNSEEN[:count]]
    mean = float(np.mean([one.completion for one in rides]))
    print(f"{name}: {mean:.1%} of the route, {dict(Counter(one.ended_by for one in rides))}", flush=True)
    return mean


if __name__ == "__main__":
    main(Path(sys.argv[1]))
