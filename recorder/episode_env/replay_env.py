"""The Gymnasium environment of a recorded drive: its motion again, seen by any rig in any condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ActionError, ConfigError, EpisodeError, unknown_name
from carlaloc_env.envs.base_env import text_of
from carlaloc_env.envs.task.agent_views import agent_view
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.envs.task_env import TaskEnv
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.weather.schedule import Weather, weather_of
from recorder.episode.episode import ControlLog, Episode
from recorder.episode.episode_town import town_of
from recorder.episode.traffic_level import traffic_level
from recorder.episode_env.recorded_world import RecordedWorld

ACTION_KINDS = ("continuous", "controls")
"""Kinds of actions in which a drive can be expressed."""
OPTIONS = ("weather", "start_s")
"""Options of a reset."""


class ReplayEnv(TaskEnv):
    """A recorded drive, step by step; actions change nothing.

    Its page is docs/environments.md.
    """

    world: RecordedWorld

    def __init__(
        self,
        episode: str | Path,
        rig: str | Path | SensorRig | Mapping[str, Any] = "paper",
        action: str | None = None,
        weather: str | Path | Weather | Mapping[str, Any] = "ClearNoon",
        traffic: str | float = "dynamic",
        start_s: float = 0.0,
        frame_skip: int = 1,
        task: TaskConfig | Mapping[str, float] | None = None,
        info: Sequence[str] | None = None,
        quality: str = "medium",
        map: str | Path | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Read a drive.

        Args:
            episode: The drive.
            rig: What is seen.
            action: Kind of the actions in `info`: ``continuous`` or ``controls``; None: that of the drive's
                agent if it is one of these, else ``controls``.
            weather: Weather in which the drive is seen.
            traffic: Traffic that is seen: ``dynamic``, ``static``, ``empty`` or a fraction.
            start_s: Where episodes begin [s], rounded down to 50 ms.
            frame_skip: Steps of 50 ms per action.
            task: Rewards, costs and ends; None: those that the drive was judged by.
            info: Parts of `info`.
            quality: Effort per picture.
            map: Map of the drive, where it names none that is known.
            render_mode: ``rgb_array``, ``human`` or None.

        Raises:
            ConfigError: an argument is unknown or out of range; the message names the nearest one.
            EpisodeError: the drive cannot be read, or its town or route is not known.
        """
        EzPickle.__init__(
            self, episode, rig, action, weather, traffic, start_s, frame_skip, task, info, quality, map,
            render_mode,
        )  # fmt: skip
        drive = Episode.load(episode)
        header = drive.header
        kind = action or (header.action if header.action in ACTION_KINDS else "controls")
        if kind not in ACTION_KINDS:
            raise ConfigError(unknown_name("kind of action", kind, ACTION_KINDS))
        super().__init__(
            rig=rig, action=kind, frame_skip=frame_skip, task=header.task if task is None else task,
            info=info, quality=quality, render_mode=render_mode,
        )  # fmt: skip
        self.weather = self._default_weather = weather_of(weather)
        self._named = {"town": header.map_name, "weather": text_of(weather), "traffic": text_of(traffic)}
        self._named["route"] = text_of(header.route.get("points_m") or "town")
        self._seed, self._path, self._controls = header.seed, drive.path, drive.controls
        self.world = RecordedWorld(drive, town_of(drive, map), traffic_level(str(traffic)))
        self._start_step = self._step_at(start_s)
        self.stage = SensorStage(self.world.town, seed=self._seed, weather=self.weather, quality=quality)
        self._view = agent_view(self.rig, self.world, self.stage)
        self.observation_space = self._view.space
        self._given: list[NDArray[np.float64]] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the drive again.

        Args:
            seed: Seed of the sensors' noise; None: that of the drive.
            options: `weather` and `start_s`, for this episode only.

        Raises:
            ConfigError: the seed or an option does not fit.
            ClosedError: the environment has been closed.
            RenderError: the rig has cameras, and OpenGL is missing or lost by a fork.
        """
        given = {name: value for name, value in (options or {}).items() if value is not None}
        for name in given:
            if name not in OPTIONS:
                raise ConfigError("reset: " + unknown_name("option", str(name), OPTIONS))
        step = self._step_at(given["start_s"]) if "start_s" in given else self._start_step
        weather = weather_of(given["weather"]) if "weather" in given else self._default_weather
        self._begin(seed)
        self.check_drawing()
        self.weather = self.stage.weather = weather
        self.stage.seed = self._seed if seed is None else int(seed)
        self.world.start(step)
        named = {"weather": text_of(given["weather"])} if "weather" in given else {}
        self._episode = {**self._named, **named, "drive_seed": self._seed}
        return self._begin_episode()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Go on by 50 ms times the frame skip, or to the end; `info["action"]` is what the driver did.

        Args:
            action: Anything; it changes nothing.

        Raises:
            ActionError: there has been no reset, or the drive is over.
            EpisodeError: the driver did what this kind of actions cannot express.
        """
        self._given.clear()
        observation, reward, ended, over, info = super().step(action)
        done = np.asarray(np.mean(self._given, axis=0), np.float32)
        if not self.action_space.contains(done):
            raise EpisodeError(f"{self._path}: its controls {done} are no {self.action_kind} action")
        return observation, reward, ended, over, {**info, "action": done}

    def _advance(self, action: Any) -> list[Contact]:
        if self.world.is_over:
            raise ActionError("the drive is over; call reset()")
        self._given.append(_action(self._controls, self.world.driven_ticks(), self.action_kind))
        return self.world.advance()

    def _is_over(self) -> bool:
        return self.world.is_over

    def _step_at(self, start_s: object) -> int:
        last_s = self.world.step_count * STEP_NS * 1e-9
        if not isinstance(start_s, Real) or not 0.0 <= float(start_s) < last_s:
            raise ConfigError(f"start_s is {start_s!r}; give 0 to below the {last_s:g} s of the drive")
        return min(round(float(start_s) * 1e9) // STEP_NS, self.world.step_count - 1)


def _action(controls: ControlLog, ticks: slice, kind: str) -> NDArray[np.float64]:
    """Mean action of the driver in a step.

    Raises:
        EpisodeError: the drive goes backwards, which two numbers cannot express.
    """
    pedals = controls.steer[ticks], controls.throttle[ticks], controls.brake[ticks]
    if kind == "controls":
        levers = controls.reverse[ticks], controls.handbrake[ticks]
        return np.array([float(np.mean(column)) for column in (*pedals, *levers)])
    if controls.reverse[ticks].any():
        raise EpisodeError(
            "the drive goes backwards, which `continuous` cannot express; use --action controls"
        )
    return np.array([pedals[0].mean(), (pedals[1] - pedals[2]).mean()])
