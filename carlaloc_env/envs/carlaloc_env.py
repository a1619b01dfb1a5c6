"""The Gymnasium environment: follow a route through a town among traffic, seen by a rig of sensors."""

import json
from collections.abc import Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_TICKS
from carlaloc_env.core.errors import ActionError, ConfigError, unknown_name
from carlaloc_env.core.opengl_process import check_opengl
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.envs.base_env import BaseEnv, plain
from carlaloc_env.envs.human_window import HumanWindow, view_from_seat
from carlaloc_env.envs.task.ackermann import Motion
from carlaloc_env.envs.task.actions import action_kind
from carlaloc_env.envs.task.agent_views import agent_view, rig_of
from carlaloc_env.envs.task.episode_start import EpisodeStart, route_of
from carlaloc_env.envs.task.referee import COSTS, Referee, Verdict
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.render.views import check_quality
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Sample, SampleList
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.ground_truth import objects_at, truth_at
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.traffic_config import TrafficConfig, traffic_of_town
from carlaloc_env.weather.schedule import Weather, weather_of

KEEP_NS = 2_000_000_000
"""How much of the past a live run keeps at least [ns]; twice that at most."""
INFO = ("ego", "samples", "truth", "objects", "visibility")
"""What `info` can hold beside the task, each for its time."""


class CarlaLocEnv(BaseEnv):
    """Follow a route through a town among traffic, to its end.

    Its page is docs/environments.md.
    """

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
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(unknown_name("render mode", str(render_mode), self.metadata["render_modes"]))
        whole = isinstance(frame_skip, Integral) and not isinstance(frame_skip, bool)
        if not whole or not 1 <= frame_skip <= 200:
            raise ConfigError(f"frame_skip is {frame_skip!r}; give 1 to 200 steps of 50 ms")
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": self.metadata["render_fps"] / int(frame_skip)}
        self.task = TaskConfig.of(task)
        self.weather = weather_of(weather)
        self._default_weather, self._default_traffic = self.weather, traffic
        self._named = {"town": str(map), "weather": _text(weather), "traffic": _text(traffic)}
        asked = EpisodeStart.of({"route": route, "start": start})
        self._route, self._start = asked.route, asked.start
        self._frame_skip = int(frame_skip)
        self._actions = action_kind(action)
        self._quality = check_quality(quality)
        self._rig = rig_of(rig, quality)
        self._info_parts = _info_parts(info, of_sensors=isinstance(self._rig, SensorRig))
        self._town = load_town(map)
        self._enter(traffic_of_town(self._town, traffic, 0))
        self.observation_space = self._view.space
        self.action_space: spaces.Space[Any] = self._actions.space
        self._referee: Referee | None = None
        self._episode: dict[str, str] = {}
        self._window: HumanWindow | None = None

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
        route = route_of(start, self._town, self.np_random)
        level = self._default_traffic if start.traffic is None else start.traffic
        traffic = traffic_of_town(self._town, level, drive_seed)
        self.weather = start.weather or self._default_weather
        if traffic.parked_cars != self.world.traffic_config.parked_cars:
            self.world.close()
            self.stage.close()
            self._enter(traffic)
        self.stage.weather, self.stage.seed = self.weather, drive_seed
        self.world.reset(drive_seed, route=route, traffic=traffic)
        given = {name: value for name, value in (options or {}).items() if value is not None}
        changed = {name: _text(given[name]) for name in given.keys() & self._named.keys()}
        self._episode = {**self._named, **changed, "route": start.route_text}
        self._referee = Referee(self.world, self.task)
        observation = self._view.reset(self.world)
        self._show()
        return observation, self._info(Verdict(), [], self._view.samples)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive for 50 ms times the frame skip, or until the episode ends.

        Raises:
            ActionError: the action is not of the space; nothing has moved.
            ClosedError: the environment has been closed.
        """
        self._check_open("step")
        if self._referee is None:
            raise ActionError("step before reset; call reset() first")
        verdict = Verdict()
        contacts: list[Contact] = []
        samples: list[Sample] = []
        for _ in range(self._frame_skip):
            controls = self._actions.controls(action, self._motion())
            touched = [contact for _ in range(STEP_TICKS) for contact in self.world.tick(controls)]
            contacts += touched
            verdict = verdict.then(self._referee.judge(touched))
            self._view.follow(self.world)
            samples += self._view.samples
            if self.world.now_ns % KEEP_NS == 0:
                self.world.forget_before(self.world.now_ns - KEEP_NS)
            if verdict.ended_by or verdict.truncated_by:
                break
        observation = self._view.observe(self.world, self._referee.standing_s)
        self._show()
        ended, over = verdict.ended_by is not None, verdict.truncated_by is not None
        return observation, verdict.reward, ended, over, self._info(verdict, contacts, samples)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """A 640×360 picture from the driver's seat, sRGB (360, 640, 3); None where a window shows it.

        Raises:
            ActionError: there has been no reset.
            ClosedError: the environment has been closed.
            RenderError: OpenGL is missing on this machine.
        """
        self._check_open("render")
        if self.render_mode != "rgb_array":
            return None
        if self._referee is None:
            raise ActionError("render before reset; call reset() first")
        return view_from_seat(self.stage, self.world, self.weather)

    def close(self) -> None:
        """Give physics, window and GPU memory back; may be called twice."""
        self._closed = True
        self.world.close()
        self.stage.close()
        if self._window is not None:
            self._window.close()
            self._window = None

    def check_drawing(self) -> None:
        """Refuse cameras in a process that cannot draw, before anything that takes long.

        Raises:
            RenderError: see `check_opengl`.
        """
        if isinstance(self._rig, SensorRig) and self._rig.of_kind("camera"):
            check_opengl()

    @property
    def rig(self) -> SensorRig | str:
        """The rig, or ``state`` or ``bev``."""
        return self._rig

    def _enter(self, traffic: TrafficConfig) -> None:
        """A new world: where cars are parked, they are part of the town."""
        self.world = DrivingWorld(self._town, traffic)
        self.stage = SensorStage(self.world.town, seed=0, weather=self.weather, quality=self._quality)
        self._view = agent_view(self._rig, self.world, self.stage)

    def _motion(self) -> Motion:
        route = self.world.route
        limit_mps = float(route.speed_limit_mps[route.row_at(self.world.route_s_m)])
        return Motion(speed_mps=self.world.state.speed_mps, speed_limit_mps=limit_mps)

    def _show(self) -> None:
        """Show what the driver sees, in `render_mode` human."""
        if self.render_mode != "human":
            return
        if self._window is None:
            self._window = HumanWindow((640, 360), self.metadata["render_fps"])
        self._window.show(view_from_seat(self.stage, self.world, self.weather))

    def _info(self, verdict: Verdict, contacts: list[Contact], samples: list[Sample]) -> dict[str, Any]:
        world, arrived = self.world, verdict.ended_by == "goal"
        driven = world.route_s_m / world.route.length_m
        info: dict[str, Any] = {
            "reward_terms": verdict.terms,
            "cost": verdict.cost,
            "cost_terms": {name: float(verdict.terms[name] < 0.0) for name in COSTS},
            "is_success": arrived,
            "ended_by": verdict.ended_by or verdict.truncated_by,
            "stamp_ns": world.now_ns,
            "route_s_m": world.route_s_m,
            "route_length_m": world.route.length_m,
            "route_completion": 1.0 if arrived else min(max(driven, 0.0), 1.0),
            "route_offset_m": world.route_offset_m,
            "contacts": contacts,
            **self._episode,
        }
        if "ego" in self._info_parts:
            info["ego"] = world.state
        if "samples" in self._info_parts:
            info["samples"] = SampleList(samples)
        if "truth" in self._info_parts:
            info["truth"] = truth_at(world.timeline, [world.now_ns], np.eye(4))[0]
        if not self._info_parts.isdisjoint(("objects", "visibility")):
            rays = self.stage.rays() if "visibility" in self._info_parts else None
            info["objects"] = objects_at(world.timeline, world.now_ns, rays=rays)
        return info


def _text(value: Any) -> str:
    """An option as text, with JSON for data: Gymnasium's vectors join values of one type alone."""
    data = plain(value)
    return data if isinstance(data, str) else json.dumps(data, default=str)


def _info_parts(info: Sequence[str] | None, *, of_sensors: bool) -> frozenset[str]:
    """What `info` holds beside the task.

    Raises:
        ConfigError: there is no such part.
    """
    if info is None:
        return frozenset(("samples", "truth", "objects") if of_sensors else ())
    for name in info:
        if name not in INFO:
            raise ConfigError(unknown_name("part of info", str(name), INFO))
    return frozenset(info)
