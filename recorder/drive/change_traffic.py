"""Simulates the traffic of a drive anew: the ego keeps its path, the others see it and give way."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.clock import STEP_NS, STEP_TICKS
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.core.transforms import quat_to_matrix
from carlaloc_env.driving.driven_car import ego_view
from carlaloc_env.scenery.street.parked_cars import rectangle
from carlaloc_env.timeline.actor_quantisation import on_grid
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.world import TrafficWorld
from recorder.episode.edit import rewrite_traffic
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_of


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
        self._size_m = catalog.size_m[:, :2].astype(np.float64)
        self.steps = 0

    def count(self, ego: EgoView, frame: ActorFrame) -> None:
        away_m = frame.position_m.astype(np.float64) - np.array(ego.position_m)
        near = (np.hypot(away_m[:, 0], away_m[:, 1]) < 20.0) & (np.abs(away_m[:, 2]) < 2.5)
        mine = rectangle(np.zeros(2), ego.heading_rad, *EGO_SIZE_M[:2])
        self.steps += any(
            mine.intersects(rectangle(away_m[k, :2], float(frame.heading_rad[k]), *self._size_m[k]))
            for k in np.flatnonzero(near)
        )
