"""Learn to drive Town01's route from the scripted driver: copy its drives, then correct the copy (DAgger).

A copy of recorded drives alone fails in states that the driver never met: too fast behind a queue, beside
the lane. So the pupil drives, and the teacher supplies its own action at every step (Ross, Gordon,
Bagnell: A Reduction of Imitation Learning ..., AISTATS 2011). Needs the extra `learn`.
"""

import sys
from pathlib import Path

import numpy as np

try:
    import torch
except ImportError as error:
    raise SystemExit(f"{error}: pip install 'carlaloc[learn]'") from error

from learning.pupil import Pupil
from learning.town01_route import make_env, ride
from learning.unseen import score


def main(
    out: Path, shown: int = 12, beside: int = 70, scored: int = 50, time_limit_s: float = 600.0
) -> dict[str, float]:
    """Learn, save the network, and return mean route completions over unseen seeds."""
    torch.set_num_threads(1)
    env, found = make_env(time_limit_s), {}
    rides = [ride(env, seed, None, route=route_of(seed)) for seed in range(shown)]
    pupil = Pupil()
    pupil.sight.fit(torch.as_tensor(np.concatenate([one.seen for one in rides])))
    pupil.learn(rides, passes=40)
    found["copy"] = score(env, "copy", pupil, scored)
    for seed in range(shown, shown + beside):
        rides.append(ride(env, seed, pupil, route=route_of(seed)))
        pupil.learn(rides, passes=6)
        print(f"ride {seed}: {rides[-1].completion:.2f} of the route, {rides[-1].ended_by}", flush=True)
    pupil.learn(rides, passes=20, rate=1e-4)
    pupil.save(out)
    found |= {"pupil": score(env, "pupil", pupil, scored), "teacher": score(env, "teacher", None, scored)}
    env.close()
    return found


def route_of(seed: int) -> str:
    """The town's route, or in every third drive another one."""
    return "random" if seed % 3 == 2 else "town"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
