"""The environment in which examples 19 and 20 drive, as Stable-Baselines3 takes it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from gymnasium.wrappers import TransformReward
from stable_baselines3.common.monitor import Monitor

from carlaloc_env import AnyTownEnv, CarlaLocEnv
from learning.eyes import with_eyes
from learning.others import cut_apart
from learning.urged import Urged

SKIP = 4
"""Steps of 50 ms per action: five actions a second."""
REWARD = 0.05
"""Factor on rewards, so that the values of states are of order 1."""
MILD = {"collision": 30.0, "off_road": 30.0, "red_light": 30.0}
"""Costs in training: milder, or standing pays most; equal, or one violation is used to avoid another."""


def drive_env(
    towns: Sequence[str], *, route: str = "town", sees: str = "state", ackermann: bool = True,
    apart: bool = True, bare: Callable[[Any], Any] = lambda env: env, **settings: Any,
) -> Any:  # fmt: skip
    """Drives among traffic at noon, in a town or in one of several.

    Args:
        towns: The towns.
        route: `town` or `random`.
        sees: `state`, the vector; `bev`, the picture from above; `nothing`, that picture in black.
        ackermann: Actions of this kind, in place of wheel and pedals.
        apart: Observe the car and its road as `own`, and the others separately as `others`.
        bare: A wrapper of the environment as it is before its observations are cut.
        settings: Further arguments of `CarlaLocEnv`.
    """
    rig, action = "state" if sees == "state" else "bev", "ackermann" if ackermann else "continuous"
    settings = {"rig": rig, "action": action, "frame_skip": SKIP, **settings}
    if len(towns) == 1:
        env: Any = bare(CarlaLocEnv(map=towns[0], route=route, **settings))
    else:
        drawn: dict[str, Any] = {"traffic": ("dynamic",), "weathers": ("ClearNoon",), "routes": (route,)}
        env = bare(AnyTownEnv(towns, kept_towns=len(towns), **drawn, **settings))
    if sees != "state":
        return with_eyes(env, blind=sees == "nothing")
    return cut_apart(env) if apart else env


def logged(file: Path, towns: Sequence[str], *, urge: bool = True, **kind: Any) -> Any:
    """The same with a log of rides, `<file>.monitor.csv`, and with rewards times `REWARD`, `Urged` or not."""

    def bare(env: Any) -> Any:
        env = Monitor(env, str(file), info_keywords=("route_completion", "ended_by"))
        return TransformReward(Urged(env) if urge else env, lambda reward: REWARD * float(reward))

    return drive_env(towns, bare=bare, **kind)
