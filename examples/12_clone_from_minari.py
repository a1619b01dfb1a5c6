"""Clone the scripted driver from a Minari data set of recorded drives, and let the clone drive.

Recorded drives become observations, actions and rewards, for any library that reads Minari. A clone of
recorded drives alone is a beginning; example 11 explains why, and improves it.
Needs the extras `learn` and `minari`.
"""

import sys
from pathlib import Path

import numpy as np

try:
    import minari
    import torch
except ImportError as error:
    raise SystemExit(f"{error}: pip install 'carlaloc[learn,minari]'") from error

from learning.pupil import Pupil
from learning.town01_route import SKIP, Ride, make_env
from learning.unseen import score
from recorder import MinariConfig, RecordConfig, record, write_minari


def main(
    out: Path, drives: int = 12, scored: int = 50, passes: int = 40, duration_s: float | None = None
) -> float:
    """Record, write the data set, learn from it, and return the mean route completion of unseen seeds."""
    torch.set_num_threads(1)
    episodes = [out / f"drive{seed}.mcap" for seed in range(drives)]
    for seed, path in enumerate(episodes):
        record(RecordConfig(map="Town01", out=path, seed=seed, duration_s=duration_s))
    sets = out / "town01-scripted-v0"
    config = MinariConfig(episodes=tuple(episodes), out=sets, rig="state", frame_skip=SKIP)
    found = minari.MinariDataset(write_minari(config).path / "data")
    earned = [episode.rewards.sum() for episode in found.iterate_episodes()]
    print(f"{found.total_episodes} drives, {found.total_steps} actions, mean return {np.mean(earned):.0f}")
    rides = [
        Ride(episode.observations[:-1], episode.actions, 1.0, "goal") for episode in found.iterate_episodes()
    ]
    clone = Pupil()
    clone.sight.fit(torch.as_tensor(np.concatenate([one.seen for one in rides])))
    clone.learn(rides, passes)
    clone.save(out / "clone.pt")
    env = make_env(duration_s or 600.0)
    done = score(env, "clone", clone, scored)
    env.close()
    return done


if __name__ == "__main__":
    main(Path(sys.argv[1]))
