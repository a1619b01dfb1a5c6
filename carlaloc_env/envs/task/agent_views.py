"""Observations of agents: the state vector, the bird's-eye view, or the sensors of a rig."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from gymnasium import spaces

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.envs.observer import Observer
from carlaloc_env.envs.task.birds_eye_view import BirdsEyeView, birds_eye_space
from carlaloc_env.envs.task.state_vector import StateVector, state_space
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.rigs.memory import check_memory
from carlaloc_env.rigs.presets import RIGS, rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Sample
from carlaloc_env.sensor_stage import SensorStage

AGENT_RIGS = ("state", "bev")
"""What agents see without sensors: the state vector, and the bird's-eye view with it."""


class AgentView(Protocol):
    """View that an agent has of a drive."""

    space: spaces.Space[Any]
    """Space of the observations."""
    samples: list[Sample]
    """Samples of sensors in the last step."""

    def reset(self, world: TaskWorld) -> Any:
        """The first observation of a drive."""

    def follow(self, world: TaskWorld) -> None:
        """Take note of a step of 50 ms; called for every step, also for those without an observation."""

    def observe(self, world: TaskWorld, standing_s: float) -> Any:
        """The observation now."""


class StateView:
    """The state vector alone (`rig="state"`), or with the bird's-eye view (`rig="bev"`)."""

    def __init__(self, world: TaskWorld, *, from_above: bool) -> None:
        self.samples: list[Sample] = []
        self._above = BirdsEyeView(world.town.network) if from_above else None
        self.space: spaces.Space[Any] = state_space()
        if from_above:
            self.space = spaces.Dict({"state": state_space(), "bev": birds_eye_space()})
        self._state: StateVector | None = None

    def reset(self, world: TaskWorld) -> Any:
        """The first observation of a drive."""
        self._state = StateVector(world)
        return self.observe(world, 0.0)

    def follow(self, world: TaskWorld) -> None:
        """Take note of a step of 50 ms."""
        assert self._state is not None
        self._state.follow()

    def observe(self, world: TaskWorld, standing_s: float) -> Any:
        """The observation now."""
        assert self._state is not None
        state = self._state.observe(standing_s)
        return state if self._above is None else {"state": state, "bev": self._above.draw(world)}


class SensorView:
    """The newest samples of a rig's sensors."""

    def __init__(self, rig: SensorRig, stage: SensorStage) -> None:
        self.samples: list[Sample] = []
        self._config, self._stage = rig, stage
        self._rig = rig.build(stage)
        self._observer = Observer(self._rig)
        self.space: spaces.Space[Any] = self._observer.space
        self._begin_ns, self._before_ns = 0, -1

    def reset(self, world: TaskWorld) -> Any:
        """The first observation of a drive."""
        self._rig = self._config.build(self._stage)
        self._observer.reset()
        self._begin_ns = world.now_ns
        self._before_ns = world.now_ns - 1
        self.follow(world)
        return self.observe(world, 0.0)

    def follow(self, world: TaskWorld) -> None:
        """Take note of a step of 50 ms: measure it."""
        samples = self._rig.measure(world.timeline, self._before_ns, world.now_ns)
        # A sweep that began before the drive, where that begins late, is left out as in a replay.
        self.samples = [sample for sample in samples if sample.stamp_ns >= self._begin_ns]
        self._observer.add(self.samples)
        self._before_ns = world.now_ns

    def observe(self, world: TaskWorld, standing_s: float) -> Any:
        """The observation now."""
        return self._observer.newest()


def rig_of(rig: str | Path | SensorRig | Mapping[str, Any], quality: str) -> str | SensorRig:
    """Meaning of a rig: `state` and `bev` as they are; a rig's name, its YAML file or plain data as a rig.

    Raises:
        ConfigError: there is no such rig, or its pictures of a quality need more memory than there is.
    """
    if isinstance(rig, str) and rig in AGENT_RIGS:
        return rig
    if isinstance(rig, Mapping):
        rig = SensorRig.from_mapping(rig, bases=RIGS)
    elif not isinstance(rig, SensorRig):
        rigs = {*RIGS, *AGENT_RIGS}
        if str(rig) not in rigs and Path(rig).suffix not in (".yaml", ".yml"):
            raise ConfigError(unknown_name("rig", str(rig), rigs) + ", or a .yaml file")
        rig = rig_by_name(rig)
    check_memory(rig, quality=quality)
    return rig


def agent_view(rig: str | SensorRig, world: TaskWorld, stage: SensorStage) -> AgentView:
    """View of an agent with a rig, as `rig_of` gives it."""
    if isinstance(rig, SensorRig):
        return SensorView(rig, stage)
    return StateView(world, from_above=rig == "bev")
