"""Several agents in one town: a PettingZoo `ParallelEnv` whose cars see and touch each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gymnasium import spaces
from gymnasium.utils.seeding import np_random

from carlaloc_env.core.clock import STEP_TICKS
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import ActionError, ConfigError, MissingDependencyError
from carlaloc_env.driving.driven_car import DrivenCar
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.envs.task.ackermann import motion_of
from carlaloc_env.envs.task.actions import action_kind
from carlaloc_env.envs.task.agent_views import agent_view, rig_of
from carlaloc_env.envs.task.episode_start import OPTIONS, EpisodeStart, car_routes
from carlaloc_env.envs.task.referee import Referee, Verdict
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.envs.task_env import task_info
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.render.views import check_quality
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import SampleList
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.traffic_config import traffic_of_town
from carlaloc_env.weather.schedule import Weather, weather_of

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise MissingDependencyError(
        "several agents need PettingZoo: pip install 'carlaloc-env[pettingzoo]'"
    ) from error

MOST_CARS = 16
"""Cars of an environment at most."""
_KEEP_NS = 2_000_000_000
"""How much of the past is kept at least [ns]; twice that at most."""
_PARKED = Controls(brake=1.0)


class CarsEnv(ParallelEnv[str, Any, Any]):  # type: ignore[misc]
    """Agents ``car_1`` … in one town, each with route, reward and ends as in `CarlaLocEnv`.

    Its page is docs/environments.md. An agent whose episode has ended leaves the town.
    """

    metadata: dict[str, Any] = {"name": "carlaloc_cars_v0", "render_modes": []}  # noqa: RUF012
    render_mode = None

    def __init__(
        self,
        map: str | Path = "Town03",
        cars: int = 4,
        rig: str | Path | SensorRig | Mapping[str, Any] = "state",
        action: str = "continuous",
        weather: str | Path | Weather | Mapping[str, Any] = "ClearNoon",
        traffic: str | float | Mapping[str, Any] = "dynamic",
        route: str | Sequence[Sequence[float]] = "town",
        start: str | float = 0.0,
        overlap: float = 0.5,
        frame_skip: int = 1,
        task: TaskConfig | Mapping[str, float] | None = None,
        quality: str = "medium",
    ) -> None:
        """Make a world; arguments are explained in docs/environments.md.

        Raises:
            ConfigError: an argument is unknown or out of range.
            MapError: there is no such town.
        """
        if not 1 <= cars <= MOST_CARS or not 0.0 <= overlap <= 1.0:
            raise ConfigError(
                f"{cars} cars, overlap {overlap:g}; give 1 to {MOST_CARS}, and a share from 0 to 1"
            )
        if not 1 <= frame_skip <= 200:
            raise ConfigError(f"frame_skip is {frame_skip!r}; give 1 to 200 steps of 50 ms")
        self.task, self._overlap, self._frame_skip = TaskConfig.of(task), overlap, int(frame_skip)
        self._rig, self._actions = rig_of(rig, quality), action_kind(action)
        self._action_spaces = [action_kind(action).space for _ in range(cars)]
        self._weather, self._level = weather_of(weather), traffic
        self._asked = {"route": route, "start": start}
        EpisodeStart.of(self._asked)
        self._town = load_town(map)
        self.possible_agents = [f"car_{number}" for number in range(1, cars + 1)]
        self.agents: list[str] = []
        self._number = {agent: number for number, agent in enumerate(self.possible_agents)}
        self.world = DrivingWorld(self._town, traffic_of_town(self._town, traffic, 0), cars=cars)
        self._stages = [
            SensorStage(self.world.town, seed=0, weather=self._weather, quality=check_quality(quality))
            for _ in self.possible_agents
        ]
        self._views = [
            agent_view(self._rig, car, stage)
            for car, stage in zip(self.world.cars, self._stages, strict=True)
        ]
        self._rng, _ = np_random(None)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Space of an agent's observations."""
        return self._views[self._number[agent]].space

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Space of an agent's actions; a separate one for each agent, for seeds."""
        return self._action_spaces[self._number[agent]]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin a new episode with all cars; the same seed and options give the same one.

        Args:
            seed: Seed of routes, traffic and noise; a fresh one is drawn from the last when left out.
            options: `route`, `start`, `spawn`, `goal`, for this episode only; others are ignored, as
                PettingZoo wants it.

        Raises:
            ConfigError: an option does not fit.
            MapError: no route leads where it is asked to.
        """
        given = {name: value for name, value in (options or {}).items() if name in OPTIONS[:4]}
        start = EpisodeStart.of({**self._asked, **given})
        if seed is not None:
            self._rng, _ = np_random(seed)
        drive_seed, cars = int(self._rng.integers(2**31)), self.world.cars
        routes = car_routes(start, self._town, self._rng, len(cars), self._overlap)
        for stage in self._stages:
            stage.seed = int(self._rng.integers(2**31))
        traffic = traffic_of_town(self._town, self._level, drive_seed)
        self.world.reset(drive_seed, routes=[driven.route for driven in routes], traffic=traffic)
        self.agents = list(self.possible_agents)
        self._referees = [Referee(car, self.task) for car in cars]
        self._drive_seed = drive_seed
        observations = {agent: self._views[k].reset(cars[k]) for agent, k in self._number.items()}
        return observations, {agent: self._info(k, Verdict(), []) for agent, k in self._number.items()}

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Drive all live cars for 50 ms times the frame skip.

        Raises:
            ActionError: an action is not of the space, or a live agent has none; nothing has moved.
        """
        live = {self._number[agent]: agent for agent in self.agents}
        for agent in self.agents:
            if agent not in actions:
                raise ActionError(f"{agent} has no action; give one for each of env.agents")
        verdicts = dict.fromkeys(live, Verdict())
        contacts: dict[int, list[Contact]] = {k: [] for k in live}
        for _ in range(self._frame_skip):
            touched = self._advance(actions, live)
            for k in live:
                if verdicts[k].ended_by is None:
                    contacts[k] += touched[k]
                    verdicts[k] = verdicts[k].then(self._referees[k].judge(touched[k]))
                    self._views[k].follow(self.world.cars[k])
        cars = self.world.cars
        observations = {
            a: self._views[k].observe(cars[k], self._referees[k].standing_s) for k, a in live.items()
        }
        infos = {agent: self._info(k, verdicts[k], contacts[k]) for k, agent in live.items()}
        ended = {agent: verdicts[k].ended_by is not None for k, agent in live.items()}
        over = {a: not ended[a] and verdicts[k].truncated_by is not None for k, a in live.items()}
        rewards = {agent: verdicts[k].reward for k, agent in live.items()}
        for k, agent in live.items():
            if ended[agent] or over[agent]:
                self.world.leave(k)
        self.agents = [agent for agent in self.agents if not ended[agent] and not over[agent]]
        return observations, rewards, ended, over, infos

    def close(self) -> None:
        """Give physics and GPU memory back; may be called twice."""
        self.world.close()
        for stage in self._stages:
            stage.close()

    def _advance(self, actions: Mapping[str, Any], live: Mapping[int, str]) -> dict[int, list[Contact]]:
        """Drive for 50 ms; contacts of each live car."""
        world = self.world
        touched: dict[int, list[Contact]] = {k: [] for k in live}
        if world.now_ns % _KEEP_NS == 0:
            world.forget_before(world.now_ns - _KEEP_NS)
        controls = [
            self._actions.controls(actions[live[k]], motion_of(car)) if k in live else _PARKED
            for k, car in enumerate(world.cars)
        ]
        for _ in range(STEP_TICKS):
            world.tick(*controls)
            for k in live:
                touched[k] += world.cars[k].contacts
        return touched

    def _info(self, k: int, verdict: Verdict, contacts: list[Contact]) -> dict[str, Any]:
        car: DrivenCar = self.world.cars[k]
        info = task_info(car, verdict, contacts)
        if self._views[k].samples:
            info["samples"] = SampleList(self._views[k].samples)
        return {**info, "drive_seed": self._drive_seed}


parallel_env = CarsEnv
"""Its name for users, as PettingZoo's own modules have it."""
