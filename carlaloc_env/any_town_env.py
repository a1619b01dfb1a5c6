"""An environment that draws town, route, weather and traffic anew for every episode."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from carlaloc_env.core.errors import ActionError, ClosedError, ConfigError
from carlaloc_env.driving_env import DrivingEnv
from carlaloc_env.env import check_seed

TOWNS = ("Town01", "Town03", "Town04", "Town05", "Town06", "Town07", "Town10")
"""Towns that are drawn from by default."""
WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
"""Weathers that are drawn from by default: the paper's."""
TRAFFIC = ("static", "0.5", "dynamic")
"""Levels of traffic that are drawn from by default."""
ROUTES = ("town", "random")
"""Routes that are drawn from by default."""
DRAWN = ("town", "weather", "traffic", "route")
"""What is drawn, in this order."""


class AnyTownEnv(gymnasium.Env[Any, Any], EzPickle):
    """Every episode another town, route, weather and level of traffic, drawn by the seed.

    The page of this family is docs/environments.md.
    """

    metadata: ClassVar[dict[str, Any]] = DrivingEnv.metadata  # type: ignore[misc]

    def __init__(
        self,
        towns: Sequence[str] = TOWNS,
        weathers: Sequence[str] = WEATHERS,
        traffic: Sequence[str | float] = TRAFFIC,
        routes: Sequence[str] = ROUTES,
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
            settings: Arguments of `DrivingEnv`.

        Raises:
            ConfigError: a choice is empty, or an argument is none of `DrivingEnv`'s.
            MapError: there is no such town.
        """
        EzPickle.__init__(self, towns, weathers, traffic, routes, kept_towns, **settings)
        self._choices: dict[str, tuple[Any, ...]] = {
            "town": tuple(towns),
            "weather": tuple(weathers),
            "traffic": tuple(traffic),
            "route": tuple(routes),
        }
        for name, choice in self._choices.items():
            if not choice:
                raise ConfigError(f"AnyTown has no {name} to draw; give at least one")
        if kept_towns < 1:
            raise ConfigError(f"kept_towns is {kept_towns}; give 1 or more")
        self._settings, self._kept_towns = settings, kept_towns
        self.render_mode = settings.get("render_mode")
        self._towns: OrderedDict[str, DrivingEnv] = OrderedDict()
        self._now: DrivingEnv | None = None
        self._closed = False
        first = self._town(self._choices["town"][0])
        self.observation_space, self.action_space = first.observation_space, first.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Draw an episode and begin it.

        Args:
            seed: Seed of all that is drawn, and of the episode.
            options: `town`, `weather`, `traffic`, `route` say what is not to be drawn this time; others are
                those of `DrivingEnv.reset`.

        Raises:
            ConfigError: the seed or an option does not fit.
        """
        self._check_open("reset")
        check_seed(seed)
        super().reset(seed=None if seed is None else int(seed))
        drawn = self._draw(options or {})
        town = drawn.pop("town")
        self._now = self._town(str(town))
        observation, info = self._now.reset(seed=int(self.np_random.integers(2**31)), options=drawn)
        return observation, {**info, "town": town}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """As `DrivingEnv.step`."""
        self._check_open("step")
        if self._now is None:
            raise ActionError("step before reset; call reset() first")
        return self._now.step(action)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """As `DrivingEnv.render`."""
        self._check_open("render")
        if self._now is None:
            raise ActionError("render before reset; call reset() first")
        return self._now.render()

    def close(self) -> None:
        """Give everything back; may be called twice."""
        self._closed = True
        for env in self._towns.values():
            env.close()
        self._towns.clear()

    def _draw(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """What is drawn, and what is given in its place."""
        drawn = dict(given)
        for name in DRAWN:
            choice = self._choices[name]
            # Drawn also where it is given: what comes after does not depend on that.
            one = choice[int(self.np_random.integers(len(choice)))]
            if name == "route" and ("spawn" in given or "goal" in given):
                continue
            drawn.setdefault(name, one)
        return drawn

    def _town(self, name: str) -> DrivingEnv:
        if name not in self._towns:
            while len(self._towns) >= self._kept_towns:
                _, oldest = self._towns.popitem(last=False)
                oldest.close()
            self._towns[name] = DrivingEnv(map=name, **self._settings)
        self._towns.move_to_end(name)
        return self._towns[name]

    def _check_open(self, call: str) -> None:
        if self._closed:
            raise ClosedError(f"{call} after close; make a new environment with gymnasium.make()")
