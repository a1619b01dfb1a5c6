"""Score an agent of example 19 in towns that it never saw, and the scripted driver on the same routes.

`python examples/20_drive_unseen_towns.py out/agent.pt Town05 Town07`: the same random routes and traffic.
"""

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

try:
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv
except ImportError as error:
    raise SystemExit(f"{error}: pip install 'carlaloc[learn]'") from error

from learning.agent import act, load, new_agent
from learning.drive_env import drive_env
from learning.score import UNSEEN, by_agent, by_driver, report


def main(
    path: Path, towns: Sequence[str], route: str = "random", scored: int = 50, time_limit_s: float = 600.0
) -> dict[str, tuple[float, float]]:
    """Mean route completions of agent and driver by town."""
    torch.set_num_threads(1)
    found = {}
    for town in towns:
        env = drive_env([town], route=route, task={"time_limit_s": time_limit_s})
        agent = new_agent(DummyVecEnv([lambda env=env: env]))
        load(agent, path)
        seeds = UNSEEN[:scored]
        found[town] = (
            report(f"{town}, agent", [by_agent(env, partial(act, agent), seed) for seed in seeds]),
            report(f"{town}, driver", [by_driver(env.unwrapped, seed) for seed in seeds]),
        )
        env.close()
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
