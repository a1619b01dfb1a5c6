"""An environment that draws town, route, weather and traffic anew for every episode."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from carlaloc_env import TOWNS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.envs.base_env import BaseEnv
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv

WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
"""Weathers that are drawn from by default: the paper's."""
TRAFFIC = ("static", "0.5", "dynamic")
"""Levels of traffic that are drawn from by default."""
ROUTES = ("town", "random")
"""Routes that are drawn from by default."""


class AnyTownEnv(BaseEnv):
    """Every episode another town, route, weather and level of traffic, drawn by the seed.

    Its page is docs/environments.md.
    """

    def __init__(
        self,
        towns: Sequence[str | Path] = TOWNS,
        weathers: Sequence[Any] = WEATHERS,
        traffic: Sequence[Any] = TRAFFIC,
        routes: Sequence[Any] = ROUTES,
        kept_towns: int = 2,
        **settings: Any,
    ) -> None:
        """Make the first town.

        Args:
            towns: Towns, or paths of OpenDRIVE files.
            weathers: Weathers.
            traffic: Levels of traffic.
            routes: `town`, `random`, or both.
            kept_towns: How many towns are held in memory; others are loaded when they are drawn.
            settings: Arguments of `CarlaLocEnv`.

        Raises:
            ConfigError: a choice is empty, or an argument is none of `CarlaLocEnv`'s.
            MapError: there is no such town.
        """
        EzPickle.__init__(self, towns, weathers, traffic, routes, kept_towns, **settings)
        # In the order in which they are drawn.
        self._choices = {"town": towns, "weather": weathers, "traffic": traffic, "route": routes}
        for name, choice in self._choices.items():
            if not len(choice):
                raise ConfigError(f"AnyTown has no {name} to draw; give at least one")
        if kept_towns < 1:
            raise ConfigError(f"kept_towns is {kept_towns}; give 1 or more")
        self._settings, self._kept_towns = settings, kept_towns
        self._towns: OrderedDict[str, CarlaLocEnv] = OrderedDict()
        self.now = first = self._town(str(towns[0]))
        """Environment of the town of this episode."""
        self.render_mode, self.metadata = first.render_mode, first.metadata
        self.observation_space, self.action_space = first.observation_space, first.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Draw an episode and begin it.

        Args:
            seed: Seed of all draws, and of the episode.
            options: `town`, `weather`, `traffic`, `route` replace a draw; the others are those of
                `CarlaLocEnv.reset`.

        Raises:
            ConfigError: the seed or an option does not fit.
            ClosedError: the environment has been closed.
        """
        self._begin(seed)
        self.now.check_drawing()
        drawn = self._draw(options or {})
        self.now = self._town(str(drawn.pop("town")))
        self.now.listener = self.listener
        return self.now.reset(seed=int(self.np_random.integers(2**31)), options=drawn)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """As `CarlaLocEnv.step`."""
        return self.now.step(action)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """As `CarlaLocEnv.render`."""
        return self.now.render()

    def close(self) -> None:
        """Give everything back; may be called twice."""
        self._closed = True
        for env in self._towns.values():
            env.close()
        self._towns.clear()

    def _draw(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Drawn values, replaced by given ones."""
        drawn = dict(given)
        for name, choice in self._choices.items():
            # Drawn also where it is given: what comes after does not depend on that.
            value = choice[int(self.np_random.integers(len(choice)))]
            if name == "route" and ("spawn" in given or "goal" in given):
                continue
            drawn.setdefault(name, value)
        return drawn

    def _town(self, name: str) -> CarlaLocEnv:
        if name not in self._towns:
            while len(self._towns) >= self._kept_towns:
                _, oldest = self._towns.popitem(last=False)
                oldest.close()
            self._towns[name] = CarlaLocEnv(map=name, **self._settings)
        self._towns.move_to_end(name)
        return self._towns[name]
