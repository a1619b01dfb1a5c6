"""Improve the pupil of example 11 by PPO (Stable-Baselines3) on the task's own reward.

The pupil drives without a teacher, with a little noise, and keeps to actions that earned more. It begins as
a copy, since PPO from nothing needs far more than some hours of two cores. Needs the extra `learn`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch
from gymnasium.wrappers import TransformReward
from stable_baselines3.common.monitor import Monitor

from learning.ppo import give_back, let_policy_learn, ppo_of
from learning.pupil import Pupil
from learning.town01_route import make_env
from learning.unseen import score


def main(
    copy: Path,
    out: Path,
    steps: int = 100_000,
    scored: int = 50,
    time_limit_s: float = 600.0,
    rollout: int = 2048,
) -> list[float]:
    """Learn for a number of actions, save the pupil, and return its scores before and after."""
    torch.set_num_threads(1)
    pupil, env = Pupil.load(copy), make_env(time_limit_s)
    found = [score(env, "before", pupil, scored)]
    told = Monitor(env, str(out.with_suffix("")), info_keywords=("route_completion", "ended_by"))
    ppo = ppo_of(pupil, TransformReward(told, lambda reward: 0.05 * float(reward)), rollout)
    # At first the critic alone learns: its guesses would spoil the pupil.
    for learns, count in ((False, steps // 5), (True, steps)):
        let_policy_learn(ppo, learns)
        ppo.learn(count, reset_num_timesteps=not learns)
    give_back(ppo, pupil)
    pupil.save(out)
    found.append(score(env, "after", pupil, scored))
    env.close()
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
