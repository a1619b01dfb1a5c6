"""Drives recorded controls through the physics again and compares every tick.

The same drive among other traffic: the ego keeps its path, the others are simulated anew.
"""

import math
import platform
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.clock import STEP_NS, STEP_TICKS, TICK_S
from carlaloc_env.core.ego import EGO_SIZE_M, Controls
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.core.transforms import quat_to_matrix
from carlaloc_env.driving.driving_world import DrivingWorld, ego_view
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoState
from carlaloc_env.timeline.actor_quantisation import on_grid
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.world import TrafficWorld
from recorder.drive.listeners import FIRST_DRIVEN_TICK, ego_row
from recorder.episode.actor_messages import pack_actors
from recorder.episode.edit import rewrite_traffic
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_of
from recorder.episode.writer import EpisodeWriter

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
        traffic = from_mapping(TrafficConfig, header.traffic, f"{source}: traffic")
        world = DrivingWorld(town, traffic, ride=header.ride)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherTraffic:
    """Result of a drive among other traffic."""

    path: str
    """The new episode."""
    touching_s: float
    """Time during which another box overlaps the ego's, which cannot give way [s]."""


def change_traffic(
    source: Path,
    out: Path,
    seed: int,
    *,
    factor: float = 1.0,
    map: str | Path | None = None,
    overwrite: bool = False,
    progress: Callable[[float, float], None] = lambda *_: None,
) -> OtherTraffic:
    """Simulate the others anew with another seed; they see and give way to the recorded ego.

    Args:
        source: The episode.
        out: New episode.
        seed: Seed of the new traffic.
        factor: Numbers of vehicles and walkers, as a multiple of the recorded ones.
        map: Map of the drive, name or file; None: the town that the episode names.
        overwrite: Whether an older `out` is replaced.
        progress: Called now and then with the time of the drive that is simulated and its length [s].

    Raises:
        EpisodeError: the episode's map has changed, or `out` exists.
    """
    episode = Episode.load(source)
    header = episode.header
    town = town_of(episode, map)
    old = from_mapping(TrafficConfig, header.traffic, f"{source}: traffic")
    counts = {name: round(factor * getattr(old, name)) for name in ("vehicles", "walkers")}
    config = replace(old, seed=seed, **counts)
    world = TrafficWorld(town.network, config, TrafficTables(town.network, town.route))
    contacts = _ContactCounter(world.catalog)
    count = len(episode.steps)
    signals = np.stack([world.signals(step * STEP_NS) for step in range(count)])

    def frames() -> Iterator[ActorFrame]:
        for step in range(count):
            # Traffic runs a step ahead of the drive: it has seen the ego just after the step before.
            tick = (step - 1) * STEP_TICKS + 1 if step > 1 else 0
            view = _view(episode.ego[min(tick, len(episode.ego) - 1)])
            frame = on_grid(world.reset(view) if step == 0 else world.step(view))
            contacts.count(_view(episode.ego[min(step * STEP_TICKS, len(episode.ego) - 1)]), frame)
            if step % 100 == 0:
                progress(step * STEP_NS * 1e-9, count * STEP_NS * 1e-9)
            yield frame

    new = replace(header, catalog=world.catalog, seed=seed, traffic=asdict(config))
    written = rewrite_traffic(
        source, out, new, frames(), signals, f"traffic seed {seed} instead of {header.seed}",
        overwrite=overwrite,
    )  # fmt: skip
    return OtherTraffic(path=str(written.path), touching_s=contacts.steps * STEP_NS * 1e-9)


def _view(row: np.void) -> EgoView:
    R = quat_to_matrix(row["quat_xyzw"])
    heading = float(elementary.arctan2(R[1, 0], R[0, 0]))
    return ego_view(row["position_m"], heading, float(row["speed_mps"]))


class _ContactCounter:
    """Counts the steps at which an actor's box overlaps the ego's."""

    def __init__(self, catalog: ActorCatalog) -> None:
        self._half = 0.5 * catalog.size_m[:, :2].astype(np.float64)
        self.steps = 0

    def count(self, ego: EgoView, frame: ActorFrame) -> None:
        half = 0.5 * np.array(EGO_SIZE_M[:2])
        position = frame.position_m.astype(np.float64)
        delta = position - np.array(ego.position_m)
        near = (np.hypot(delta[:, 0], delta[:, 1]) < 20.0) & (np.abs(delta[:, 2]) < 2.5)
        index = np.flatnonzero(near)
        hits = _overlap(
            delta[index, :2],
            frame.heading_rad[index].astype(np.float64),
            self._half[index],
            ego.heading_rad,
            half,
        )
        self.steps += bool(hits.any())


def _overlap(
    delta_m: NDArray[np.float64],
    heading_rad: NDArray[np.float64],
    half_m: NDArray[np.float64],
    ego_heading_rad: float,
    ego_half_m: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether rectangles overlap the ego's: no axis of either separates them, (N,)."""
    result = np.ones(len(delta_m), bool)
    turn = heading_rad - ego_heading_rad
    c, s = np.abs(elementary.cos(turn)), np.abs(elementary.sin(turn))
    for heading, own, other in (
        (np.full(len(delta_m), ego_heading_rad), np.broadcast_to(ego_half_m, half_m.shape), half_m),
        (heading_rad, half_m, np.broadcast_to(ego_half_m, half_m.shape)),
    ):
        along = delta_m[:, 0] * elementary.cos(heading) + delta_m[:, 1] * elementary.sin(heading)
        across = delta_m[:, 1] * elementary.cos(heading) - delta_m[:, 0] * elementary.sin(heading)
        result &= np.abs(along) < own[:, 0] + c * other[:, 0] + s * other[:, 1]
        result &= np.abs(across) < own[:, 1] + s * other[:, 0] + c * other[:, 1]
    return result
