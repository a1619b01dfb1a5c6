"""What environments of living and of recorded drives share: views, the referee, info, pictures."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import ActionError, ConfigError, unknown_name
from carlaloc_env.core.opengl_process import check_opengl
from carlaloc_env.envs.base_env import BaseEnv
from carlaloc_env.envs.human_window import HumanWindow, view_from_seat
from carlaloc_env.envs.task.actions import action_kind
from carlaloc_env.envs.task.agent_views import AgentView, rig_of
from carlaloc_env.envs.task.referee import COSTS, Referee, Verdict
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.render.views import check_quality
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Sample, SampleList
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.ground_truth import objects_at, truth_at
from carlaloc_env.weather.schedule import Weather

INFO = ("ego", "samples", "truth", "objects", "visibility")
"""What `info` can hold beside the task, each for its time."""


class TaskEnv(BaseEnv):
    """Steps of a drive, as an agent sees them and a referee judges them.

    Args:
        rig: What is seen.
        action: Kind of actions.
        frame_skip: Steps of 50 ms per action.
        task: Rewards, costs and ends.
        info: Parts of `info`.
        quality: Effort per picture.
        render_mode: ``rgb_array``, ``human`` or None.

    Raises:
        ConfigError: an argument is unknown or out of range; the message names the nearest one.
    """

    world: TaskWorld
    """The drive."""
    stage: SensorStage
    """What sensors see beside it."""
    weather: Weather
    """Weather of this episode."""
    _view: AgentView

    def __init__(
        self,
        *,
        rig: str | Path | SensorRig | Mapping[str, Any],
        action: str,
        frame_skip: int,
        task: TaskConfig | Mapping[str, float] | None,
        info: Sequence[str] | None,
        quality: str,
        render_mode: str | None,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(unknown_name("render mode", str(render_mode), self.metadata["render_modes"]))
        whole = isinstance(frame_skip, Integral) and not isinstance(frame_skip, bool)
        if not whole or not 1 <= frame_skip <= 200:
            raise ConfigError(f"frame_skip is {frame_skip!r}; give 1 to 200 steps of 50 ms")
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": self.metadata["render_fps"] / int(frame_skip)}
        self.task = TaskConfig.of(task)
        self._frame_skip = int(frame_skip)
        self.action_kind = action
        """Kind of actions."""
        self._actions = action_kind(action)
        self.action_space = self._actions.space
        self._quality = check_quality(quality)
        self.rig = rig_of(rig, quality)
        """The rig, or ``state`` or ``bev``."""
        self._info_parts = _info_parts(info, of_sensors=isinstance(self.rig, SensorRig))
        self._referee: Referee | None = None
        self._episode: dict[str, Any] = {}
        self._window: HumanWindow | None = None

    @abstractmethod
    def _advance(self, action: Any) -> list[Contact]:
        """Advance by 50 ms, and return the car's contacts."""

    def _is_over(self) -> bool:
        """Whether there is no step after this one."""
        return False

    def _begin_episode(self) -> tuple[Any, dict[str, Any]]:
        """First observation and info of a world that has just been reset."""
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
        verdict, over = Verdict(), False
        contacts: list[Contact] = []
        samples: list[Sample] = []
        for _ in range(self._frame_skip):
            touched = self._advance(action)
            contacts += touched
            verdict = verdict.then(self._referee.judge(touched))
            self._view.follow(self.world)
            samples += self._view.samples
            ended = verdict.ended_by is not None
            over = not ended and (verdict.truncated_by is not None or self._is_over())
            if ended or over:
                break
        observation = self._view.observe(self.world, self._referee.standing_s)
        self._show()
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
        return view_from_seat(self.stage, self.world.timeline, self.world.now_ns, self.weather)

    def close(self) -> None:
        """Give window and GPU memory back; may be called twice."""
        self._closed = True
        self.stage.close()
        if self._window is not None:
            self._window.close()
            self._window = None

    def check_drawing(self) -> None:
        """Refuse cameras in a process that cannot draw, before anything that takes long.

        Raises:
            RenderError: see `check_opengl`.
        """
        if isinstance(self.rig, SensorRig) and self.rig.of_kind("camera"):
            check_opengl()

    def _show(self) -> None:
        """Show what the driver sees, in `render_mode` human."""
        if self.render_mode != "human":
            return
        if self._window is None:
            self._window = HumanWindow((640, 360), self.metadata["render_fps"])
        self._window.show(view_from_seat(self.stage, self.world.timeline, self.world.now_ns, self.weather))

    def _info(self, verdict: Verdict, contacts: list[Contact], samples: list[Sample]) -> dict[str, Any]:
        world = self.world
        info = {**task_info(world, verdict, contacts), **self._episode}
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


def task_info(world: TaskWorld, verdict: Verdict, contacts: list[Contact]) -> dict[str, Any]:
    """What `info` has of the task after every step: rewards, costs, ends and the way along the route."""
    arrived = verdict.ended_by == "goal"
    driven = world.route_s_m / world.route.length_m
    return {
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
    }


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
