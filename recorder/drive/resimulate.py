"""Drives recorded controls through the physics again and compares every tick."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.physics.actor_pool import Contact
from carlaloc_env.physics.ego import EgoState
from carlaloc_env.timeline.timeline import ActorCatalog, ActorFrame
from carlaloc_env.traffic.world import TrafficConfig
from recorder.drive.episode_listener import FIRST_DRIVEN_TICK, ego_row
from recorder.episode.actor_messages import pack_actors
from recorder.episode.episode import Episode, EpisodeWriter
from recorder.episode.town import town_of

_REPORT_TICKS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Resimulation:
    """How a second drive compares with the recorded one."""

    source: str
    """Episode whose controls were driven."""
    ticks: int
    """Ticks compared."""
    first_difference_tick: int | None
    """First tick at which ego or traffic differ by a single bit; None: identical."""
    difference: str
    """What differs there first, empty when nothing does."""
    largest_m: float
    """Largest distance between the two egos [m]."""
    verdict: str
    """The same in one line."""


class _Comparison:
    """A `DriveListener` that holds what happens against an episode, and may record it."""

    def __init__(self, episode: Episode, begin: Callable[[ActorCatalog], EpisodeWriter] | None) -> None:
        self._episode, self._begin = episode, begin
        self.writer: EpisodeWriter | None = None
        self.first: tuple[int, str] | None = None
        self.largest_m = 0.0

    def on_start(self, catalog: ActorCatalog) -> None:
        known = self._episode.header.catalog
        if not (np.array_equal(catalog.id, known.id) and catalog.model == known.model):
            self._differs(0, "the actors")
        self.writer = self._begin(catalog) if self._begin is not None else None

    def on_tick(self, tick: int, state: EgoState, controls: Controls) -> None:
        row = self._episode.ego[tick]
        away = math.dist(row["position_m"], state.position_m)
        self.largest_m = max(self.largest_m, away)
        for name in ("position_m", "quat_xyzw", "velocity_world_mps", "omega_body_radps"):
            if row[name].tobytes() != np.asarray(getattr(state, name), np.float64).tobytes():
                self._differs(tick, f"the ego's {name} ({away:.3g} m apart)")
        if self.writer is not None:
            self.writer.ego(tick, ego_row(state, controls, self._episode.raw_controls.at(tick)))

    def on_step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        known = self._episode.steps
        if step < len(known) and pack_actors(step, frame, signals) != known[step].tobytes():
            self._differs(step * 10, "the traffic or its lights")
        if self.writer is not None:
            self.writer.step(step, frame, signals)

    def on_contact(self, tick: int, contact: Contact) -> None:
        """Contacts follow from the states that are compared."""

    def abandon(self) -> None:
        """Remove what was recorded unless it is whole."""
        if self.writer is not None:
            self.writer.abandon()

    def _differs(self, tick: int, what: str) -> None:
        if self.first is None:
            self.first = (tick, what)


def resimulate(
    source: Path,
    *,
    out: Path | None = None,
    map: str | Path | None = None,
    overwrite: bool = False,
    progress: Callable[[float, float], None] = lambda *_: None,
) -> Resimulation:
    """Drive an episode's controls again.

    On the same machine and versions every bit is the same; elsewhere the first tick that differs is
    reported.

    Args:
        source: The episode.
        out: Episode to write of the second drive; None: only compare.
        map: Map of the drive, name or file; None: the town that the episode names.
        overwrite: Whether an older `out` is replaced.
        progress: Called now and then with the time of the drive that is driven again and its length [s].

    Raises:
        EpisodeError: the episode was edited, its map has changed, or `out` cannot be written.
    """
    episode = Episode.load(source, allow_partial=True)
    header = episode.header
    if header.history:
        raise EpisodeError(
            f"{source} was edited ({header.history[-1]}): its controls no longer lead through it; "
            "drive the original again"
        )
    town = town_of(episode, map)
    begin = None if out is None else lambda _: EpisodeWriter(out, header, overwrite=overwrite, keep_cut=False)
    comparison = _Comparison(episode, begin)
    with ExitStack() as stack:
        world = DrivingWorld(town, from_mapping(TrafficConfig, header.traffic, f"{source}: traffic"))
        stack.callback(world.close)
        stack.callback(comparison.abandon)
        world.reset(episode.header.seed, comparison)
        controls, total = episode.controls, len(episode.ego)
        for tick in range(FIRST_DRIVEN_TICK, total):
            world.tick(controls.at(tick))
            if tick % _REPORT_TICKS == 0:
                progress(tick * TICK_S, total * TICK_S)
        if comparison.writer is not None:
            for event in episode.events:
                comparison.writer.event(event.tick, event.kind, event.data)
            comparison.writer.close()
    return _result(source, episode, comparison)


def _result(source: Path, episode: Episode, comparison: _Comparison) -> Resimulation:
    first = comparison.first
    if first is None:
        verdict = f"identical: {len(episode.ego)} ticks of {source} came out the same, bit for bit"
    else:
        verdict = (
            f"differs from tick {first[0]} ({first[0] * 0.005:.3f} s) on: {first[1]}; at most "
            f"{comparison.largest_m:.3g} m apart in the end{_other_versions(episode.header.versions)}"
        )
    return Resimulation(
        source=str(source),
        ticks=len(episode.ego),
        first_difference_tick=None if first is None else first[0],
        difference="" if first is None else first[1],
        largest_m=comparison.largest_m,
        verdict=verdict,
    )


def _other_versions(recorded: Any) -> str:
    """Which libraries have another version than when the episode was recorded."""
    here = {name: platform.python_version() if name == "python" else version(name) for name in recorded}
    others = [
        f"{name} {recorded[name]} then, {here[name]} now" for name in recorded if recorded[name] != here[name]
    ]
    return f" ({'; '.join(others)})" if others else ""
