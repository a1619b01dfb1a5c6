"""Learn to drive from scratch: PPO of Stable-Baselines3 on the task's own reward.

`python examples/19_learn_from_nothing.py out` learns Town01's route and scores it over unseen seeds. In every
town: `--towns Town01 Town03 Town04 Town06 Town10 --route random --begin-with out/agent.pt`.
"""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

try:
    import torch
    from stable_baselines3.common.callbacks import ConvertCallback, EveryNTimesteps
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv
except ImportError as error:
    raise SystemExit(f"{error}: pip install 'carlaloc[learn]'") from error

from learning.agent import act, load, new_agent, save
from learning.drive_env import MILD, drive_env, logged
from learning.score import UNSEEN, by_agent, report


def main(
    out: Path, towns: Sequence[str] = ("Town01",), route: str = "town", sees: str = "state", seed: int = 0,
    steps: int = 250_000, abreast: int = 8, processes: bool = False, begin_with: Path | None = None,
    without: Sequence[str] = (), scored: int = 50, time_limit_s: float = 100.0, **parameters: float,
) -> float:  # fmt: skip
    """Learn from drives abreast, save the agent, and return its route completion in the first town."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    kind: dict[str, Any] = {name: name not in without for name in ("ackermann", "apart")}
    kind |= {"route": route, "sees": sees, "start": 0.0 if "starts" in without else "anywhere"}
    task = {"time_limit_s": time_limit_s, **({} if "mild" in without else MILD)}
    drives = partial(logged, towns=towns, urge="urge" not in without, task=task, **kind)
    makers = [partial(drives, out / f"rides_{n}") for n in range(abreast)]
    envs = SubprocVecEnv(makers) if processes else DummyVecEnv(makers)
    agent = new_agent(envs, seed, verbose=1, **parameters)
    if begin_with is not None:
        load(agent, begin_with)
    keep = ConvertCallback(lambda *_: bool(save(agent, out / "agent.pt")))  # true: go on
    agent.learn(steps, EveryNTimesteps(20_000, keep))
    save(agent, out / "agent.pt")
    scoring = drive_env(towns[:1], **kind | {"start": 0.0, "task": {"time_limit_s": 6.0 * time_limit_s}})
    return report(towns[0], [by_agent(scoring, partial(act, agent), one) for one in UNSEEN[:scored]])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(argument_default=argparse.SUPPRESS)
    parser.add_argument("out", type=Path)
    numbers = dict.fromkeys(("steps", "seed", "abreast", "scored"), int)
    for name, kind in {**numbers, "begin-with": Path, "route": str}.items():
        parser.add_argument(f"--{name}", type=kind)
    parser.add_argument("--processes", action="store_true")
    parser.add_argument("--sees", choices=("state", "bev", "nothing"))
    parser.add_argument("--towns", nargs="+")
    parser.add_argument("--without", nargs="+", choices=("starts", "ackermann", "apart", "mild", "urge"))
    main(**vars(parser.parse_args()))
