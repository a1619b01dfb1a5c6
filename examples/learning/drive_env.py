"""The environment in which examples 19 and 20 drive, as Stable-Baselines3 takes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gymnasium.wrappers import TransformReward
from stable_baselines3.common.monitor import Monitor

from carlaloc_env.envs.any_town_env import AnyTownEnv
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from learning.others import cut_apart
from learning.urged import Urged

SKIP = 4
"""Steps of 50 ms per action: five actions a second."""
REWARD = 0.05
"""Factor on rewards, so that the values of states are of order 1."""
MILD = {"collision": 20.0, "off_road": 10.0, "red_light": 30.0}
"""Costs in training: with the task's own, a car that knows nothing earns most by standing still."""


def drive_env(
    towns: Sequence[str], *, route: str = "town", gentle: bool = True, apart: bool = True, **settings: Any
) -> Any:
    """Drives among traffic at noon, in a town or in one of several.

    Args:
        towns: The towns.
        route: `town` or `random`.
        gentle: Actions of the kind `ackermann`, in place of wheel and pedals.
        apart: Observe the car and its road as `own`, and the others apart from it as `others`.
        settings: Further arguments of `CarlaLocEnv`.
    """
    settings = {"rig": "state", "frame_skip": SKIP, "action": ("continuous", "ackermann")[gentle], **settings}
    if len(towns) == 1:
        env: Any = CarlaLocEnv(map=towns[0], route=route, **settings)
    else:
        drawn: dict[str, Any] = {"traffic": ("dynamic",), "weathers": ("ClearNoon",), "routes": (route,)}
        env = AnyTownEnv(towns, kept_towns=len(towns), **drawn, **settings)
    return cut_apart(env) if apart else env


def logged(file: Path, towns: Sequence[str], *, urge: bool = True, **kind: Any) -> Any:
    """The same with a log of rides, `<file>.monitor.csv`, and with rewards times `REWARD`, `Urged` or not."""
    env: Any = Monitor(drive_env(towns, **kind), str(file), info_keywords=("route_completion", "ended_by"))
    return TransformReward(Urged(env) if urge else env, lambda reward: REWARD * float(reward))

