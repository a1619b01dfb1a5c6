"""The score of examples 11 to 13: mean route completion over seeds of traffic that no training uses."""

from collections import Counter

import numpy as np

from carlaloc_env import CarlaLocEnv
from learning.town01_route import Policy, ride

UNSEEN = range(10_000, 10_050)
"""The seeds."""


def score(env: CarlaLocEnv, name: str, policy: Policy | None, count: int) -> float:
    """Mean route completion of a policy, or of the scripted driver, over so many unseen seeds."""
    rides = [ride(env, seed, policy) for seed in UNSEEN[:count]]
    mean = float(np.mean([one.completion for one in rides]))
    print(f"{name}: {mean:.1%} of the route, {dict(Counter(one.ended_by for one in rides))}", flush=True)
    return mean
