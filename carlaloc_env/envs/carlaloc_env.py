"""The Gymnasium environment: follow a route through a town among traffic, seen by a rig of sensors."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gymnasium.utils import EzPickle

from carlaloc_env.core.clock import STEP_TICKS
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.envs.base_env import text_of
from carlaloc_env.envs.task.ackermann import motion_of
from carlaloc_env.envs.task.agent_views import agent_view
from carlaloc_env.envs.task.episode_start import EpisodeStart, route_of
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.envs.task_env import TaskEnv
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.traffic_config import TrafficConfig, traffic_of_town
from carlaloc_env.weather.schedule import Weather, weather_of

KEEP_NS = 2_000_000_000
"""How much of the past a live run keeps at least [ns]; twice that at most."""


class CarlaLocEnv(TaskEnv):
    """Follow a route through a town among traffic, to its end.

    Its page is docs/environments.md.
    """

    world: DrivingWorld

    def __init__(
        self,
        map: str | Path = "Town03",
        rig: str | Path | SensorRig | Mapping[str, Any] = "paper",
        action: str = "continuous",
        weather: str | Path | Weather | Mapping[str, Any] = "ClearNoon",
        traffic: str | float | Mapping[str, Any] = "dynamic",
        route: str | Sequence[Sequence[float]] = "town",
        start: str | float = 0.0,
        frame_skip: int = 1,
        task: TaskConfig | Mapping[str, float] | None = None,
        info: Sequence[str] | None = None,
        quality: str = "medium",
        render_mode: str | None = None,
    ) -> None:
        """Make a world; arguments are explained in docs/environments.md.

        Raises:
            ConfigError: an argument is unknown or out of range; the message names the nearest one.
            MapError: there is no such town.
        """
        EzPickle.__init__(
            self, map, rig, action, weather, traffic, route, start, frame_skip, task, info, quality,
            render_mode,
        )  # fmt: skip
        super().__init__(
            rig=rig, action=action, frame_skip=frame_skip, task=task, info=info, quality=quality,
            render_mode=render_mode,
        )  # fmt: skip
        self.weather = weather_of(weather)
        self._default_weather, self._default_traffic = self.weather, traffic
        self._named = {"town": str(map), "weather": text_of(weather), "traffic": text_of(traffic)}
        asked = EpisodeStart.of({"route": route, "start": start})
        self._route, self._start = asked.route, asked.start
        self._town = load_town(map)
        self._enter(traffic_of_town(self._town, traffic, 0))
        self.observation_space = self._view.space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin a new episode; the same seed and options give the same one.

        Args:
            seed: Seed of route, traffic and noise; a fresh one is drawn from the last when left out.
            options: `route`, `start`, `spawn`, `goal`, `weather`, `traffic`, for this episode only.

        Raises:
            ConfigError: the seed is no whole number of 0 or more, or an option is unknown or does not fit.
            MapError: no route leads where it is asked to.
            ClosedError: the environment has been closed.
            RenderError: the rig has cameras, and OpenGL is missing or lost by a fork.
        """
        start = EpisodeStart.of({"route": self._route, "start": self._start, **(options or {})})
        self._begin(seed)
        self.check_drawing()
        drive_seed = int(self.np_random.integers(2**31))
        self.driven = route_of(start, self._town, self.np_random)
        """Route of this episode."""
        level = self._default_traffic if start.traffic is None else start.traffic
        traffic = traffic_of_town(self._town, level, drive_seed)
        self.weather = start.weather or self._default_weather
        if traffic.parked_cars != self.world.traffic_config.parked_cars:
            self.world.close()
            self.stage.close()
            self._enter(traffic)
        self.stage.weather, self.stage.seed = self.weather, drive_seed
        self.world.reset(drive_seed, self.listener, route=self.driven.route, traffic=traffic)
        given = {name: value for name, value in (options or {}).items() if value is not None}
        changed = {name: text_of(given[name]) for name in given.keys() & self._named.keys()}
        self._episode = {**self._named, **changed, "route": start.route_text, "drive_seed": drive_seed}
        return self._begin_episode()

    def _advance(self, action: Any) -> list[Contact]:
        if self.world.now_ns % KEEP_NS == 0:
            self.world.forget_before(self.world.now_ns - KEEP_NS)
        controls = self._actions.controls(action, motion_of(self.world))
        return [contact for _ in range(STEP_TICKS) for contact in self.world.tick(controls)]

    def close(self) -> None:
        """Give physics, window and GPU memory back; may be called twice."""
        self.world.close()
        super().close()

    def _enter(self, traffic: TrafficConfig) -> None:
        """A new world: where cars are parked, they are part of the town."""
        self.world = DrivingWorld(self._town, traffic)
        self.stage = SensorStage(self.world.town, seed=0, weather=self.weather, quality=self._quality)
        self._view = agent_view(self.rig, self.world, self.stage)
