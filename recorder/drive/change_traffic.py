"""Simulates the traffic of a drive anew: the ego keeps its path, the others see it and give way."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.clock import STEP_NS, STEP_TICKS
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.core.transforms import quat_to_matrix
from carlaloc_env.driving.driven_car import ego_view
from carlaloc_env.timeline.actor_quantisation import on_grid
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.world import TrafficWorld
from recorder.episode.edit import write_episode
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
    half_m = 0.5 * world.catalog.size_m[:, :2].astype(np.float64)
    touches: list[bool] = []
    count = len(episode.steps)
    signals = np.stack([world.signals(step * STEP_NS) for step in range(count)])

    def frames() -> Iterator[ActorFrame]:
        for step in range(count):
            # Traffic runs a step ahead of the drive: it has seen the ego just after the step before.
            tick = (step - 1) * STEP_TICKS + 1 if step > 1 else 0
            view = _view(episode.ego[min(tick, len(episode.ego) - 1)])
            frame = on_grid(world.reset(view) if step == 0 else world.step(view))
            view = _view(episode.ego[min(step * STEP_TICKS, len(episode.ego) - 1)])
            touches.append(_is_touching(view, frame, half_m))
            if step % 100 == 0:
                progress(step * STEP_NS * 1e-9, count * STEP_NS * 1e-9)
            yield frame

    history = (*header.history, f"traffic seed {seed} instead of {header.seed} of {source.name}")
    new = replace(header, catalog=world.catalog, seed=seed, traffic=asdict(config), history=history)
    events = [event for event in episode.events if event.kind != "collision"]
    written = write_episode(out, new, episode.ego, frames(), signals, events, overwrite=overwrite)
    return OtherTraffic(path=str(written.path), touching_s=sum(touches) * STEP_NS * 1e-9)


def _view(row: np.void) -> EgoView:
    R = quat_to_matrix(row["quat_xyzw"])
    heading = float(elementary.arctan2(R[1, 0], R[0, 0]))
    return ego_view(row["position_m"], heading, float(row["speed_mps"]))


def _is_touching(ego: EgoView, frame: ActorFrame, half_m: Array) -> bool:
    """Whether the box of an actor, half as long and wide as given, (N, 2), overlaps the ego's."""
    delta = frame.position_m.astype(np.float64) - np.array(ego.position_m)
    near = (np.hypot(delta[:, 0], delta[:, 1]) < 20.0) & (np.abs(delta[:, 2]) < 2.5)
    heading_rad = frame.heading_rad[near].astype(np.float64)
    return bool(_overlap(delta[near, :2], heading_rad, half_m[near], ego.heading_rad).any())


def _overlap(delta_m: Array, heading_rad: Array, half_m: Array, ego_heading_rad: float) -> Mask:
    """Whether rectangles overlap the ego's: no axis of either separates them, (N,)."""
    result = np.ones(len(delta_m), bool)
    turn = heading_rad - ego_heading_rad
    c, s = np.abs(elementary.cos(turn)), np.abs(elementary.sin(turn))
    ego_half_m = np.broadcast_to(0.5 * np.array(EGO_SIZE_M[:2]), half_m.shape)
    for heading, own, other in (
        (np.full(len(delta_m), ego_heading_rad), ego_half_m, half_m),
        (heading_rad, half_m, ego_half_m),
    ):
        along = delta_m[:, 0] * elementary.cos(heading) + delta_m[:, 1] * elementary.sin(heading)
        across = delta_m[:, 1] * elementary.cos(heading) - delta_m[:, 0] * elementary.sin(heading)
        result &= np.abs(along) < own[:, 0] + c * other[:, 0] + s * other[:, 1]
        result &= np.abs(across) < own[:, 1] + s * other[:, 0] + c * other[:, 1]
    return result
