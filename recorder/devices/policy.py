"""A policy at the wheel: a Python file that defines ``RIG``, ``ACTION`` and ``act(observation)``."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

from carlaloc_env.core.clock import STEP_TICKS
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import DeviceError
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.envs.task.ackermann import motion_of
from carlaloc_env.envs.task.actions import action_kind
from carlaloc_env.envs.task.agent_views import AgentView, agent_view, rig_of
from carlaloc_env.envs.task.referee import STANDING_MPS, STEP_S
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.sensor_stage import SensorStage

NAMES = ("RIG", "ACTION", "act")
"""Names that a policy's file defines."""


class PolicyDriver:
    """Drives as an agent in an environment does: an action for every 50 ms, of the observation then.

    Args:
        path: The file. ``RIG`` is a rig as an environment takes it, ``ACTION`` a kind of actions, and
            ``act(observation)`` returns one.

    Raises:
        DeviceError: the file is missing, does not run, or defines too little.
        ConfigError: the rig or the kind of actions is unknown.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise DeviceError(f"cannot read the policy {path}; give a .py file that is there")
        try:
            names = runpy.run_path(str(path))
        except Exception as error:
            raise DeviceError(f"{path} does not run: {type(error).__name__}: {error}") from error
        if missing := [name for name in NAMES if name not in names]:
            raise DeviceError(f"{path} defines no {', '.join(missing)}; a policy defines {', '.join(NAMES)}")
        self.name = path.name
        self.action = str(names["ACTION"])
        """Kind of actions."""
        self._act, self._actions = names["act"], action_kind(self.action)
        self._rig = rig_of(names["RIG"], "medium")
        self._world: TaskWorld | None = None
        self._last_tick, self._standing_s = -1, 0.0
        self._controls = Controls()

    def sit_in(self, world: TaskWorld, stage: SensorStage) -> None:
        """Take a seat in a world, which may be reset later on."""
        self._world, self._stage = world, stage

    def read(self, view: DriverView) -> Controls:
        """Controls for the coming tick; a tick that is not later than the last begins a new drive.

        Raises:
            DeviceError: the policy failed, or returned what is no action of its kind.
        """
        world = self._world
        if world is None:
            raise DeviceError(f"{self.name} has no world to see; call sit_in first")
        if is_new := view.tick <= self._last_tick or self._last_tick < 0:
            self._view: AgentView = agent_view(self._rig, world, self._stage)
        self._last_tick = view.tick
        if is_new or view.tick % STEP_TICKS == 0:
            observation = self._observe(world, is_new=is_new)
            try:
                self._controls = self._actions.controls(self._act(observation), motion_of(world))
            except Exception as error:
                raise DeviceError(f"{self.name}: act failed: {type(error).__name__}: {error}") from error
        return self._controls

    def close(self) -> None:
        """Do nothing: there is no device to release."""

    def _observe(self, world: TaskWorld, *, is_new: bool) -> Any:
        if is_new:
            self._standing_s = 0.0
            return self._view.reset(world)
        stands = abs(world.state.speed_mps) < STANDING_MPS
        self._standing_s = self._standing_s + STEP_S if stands else 0.0
        self._view.follow(world)
        return self._view.observe(world, self._standing_s)
