"""A Gymnasium wrapper that records the episodes of an environment as drives, for replays like any other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.files.recordings import recording_path
from carlaloc_env.envs.any_town_env import AnyTownEnv
from carlaloc_env.envs.base_env import plain, text_of
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.timeline.actors import ActorCatalog
from recorder.drive.drive_header import drive_header
from recorder.drive.episode_listener import EpisodeListener
from recorder.episode.writer import EpisodeWriter

_VIOLATIONS = ("red_light", "off_road")
"""Costs of the task that are violations in the file."""


class RecordDrive(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Records episodes as ``agent-<drive seed>-<episode>.mcap``; the environment behaves as without it.

    A file is complete at the end of its episode, where `info["drive_file"]` names it, or at the next `reset`
    or `close`. Before, its suffix is ``.recording``, of which ``carlaloc info --repair`` makes a whole file.

    Args:
        env: A CarlaLoc environment; other wrappers may be in between.
        path: Files are named after it, e.g. ``agent.mcap``.
        episode_trigger: Which episodes are kept, by their number from 0; None: all.
        overwrite: Whether older files of these names are replaced.

    Raises:
        ConfigError: the environment is none that drives.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        path: str | Path,
        episode_trigger: Callable[[int], bool] | None = None,
        overwrite: bool = False,
    ) -> None:
        RecordConstructorArgs.__init__(
            self, path=str(path), episode_trigger=episode_trigger, overwrite=overwrite
        )
        super().__init__(env)
        if not isinstance(env.unwrapped, CarlaLocEnv | AnyTownEnv):
            raise ConfigError("RecordDrive needs an environment that drives, such as CarlaLoc-Town01-v0")
        self._base, self._path, self._overwrite = env.unwrapped, Path(path), overwrite
        self._is_kept = episode_trigger or (lambda _: True)
        self._number, self._steps = -1, 0
        self._listener = EpisodeListener(self._open)
        self._writer: EpisodeWriter | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Complete the last episode's file, and begin the next one.

        Raises:
            OutputError: there is a file of this name.
        """
        self._end(None)
        self._number, self._steps = self._number + 1, 0
        self._listener = EpisodeListener(self._open)
        self._base.listener = self._listener if self._is_kept(self._number) else None
        try:
            return self.env.reset(seed=seed, options=options)
        finally:
            self._base.listener = None

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive a step, and record it."""
        observation, reward, ended, over, info = self.env.step(action)
        if self._writer is not None:
            self._steps += 1
            for kind in _VIOLATIONS if info["cost"] else ():
                if info["cost_terms"][kind]:
                    self._listener.event(self._now.world.tick_count, kind, {})
            if ended or over:
                info = {**info, "drive_file": str(self._writer.path)}
                self._end(info["ended_by"])
        return observation, float(reward), ended, over, info

    def close(self) -> None:
        """Complete the file, and close the environment."""
        self._end(None)
        super().close()

    @property
    def _now(self) -> CarlaLocEnv:
        """The environment of this episode."""
        return self._base.now if isinstance(self._base, AnyTownEnv) else self._base

    def _open(self, catalog: ActorCatalog) -> EpisodeWriter:
        env = self._now
        rig = env.rig if isinstance(env.rig, str) else plain(env.rig)
        header = drive_header(
            env.world, [env.driven], catalog, devices=["agent"], rig=rig, weather=text_of(env.weather),
            task=asdict(env.task), action=env.action_kind,
        )  # fmt: skip
        name = f"{self._path.stem}-{header.seed}-{self._number}{self._path.suffix}"
        self._writer = EpisodeWriter(
            self._path.with_name(name), header, overwrite=self._overwrite, durable=False
        )
        return self._writer

    def _end(self, ended_by: str | None) -> None:
        """Complete the file; one without a step is removed."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        world = self._now.world
        world.listener = None
        if not self._steps:
            writer.abandon()
            recording_path(writer.path).unlink(missing_ok=True)
            return
        route_m = max(world.route_s_m, 0.0)
        self._listener.event(world.tick_count, "end", {"route_m": route_m, "ended_by": ended_by})
        writer.close()
