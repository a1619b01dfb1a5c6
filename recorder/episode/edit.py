"""Makes new episodes of recorded ones: cut, join, drop actors, other traffic; sources stay as they are."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_TICKS, TICK_HZ, TICK_S
from carlaloc_env.core.errors import ConfigError, EpisodeError, unknown_name
from carlaloc_env.core.transforms import quat_conjugate, quat_multiply, quat_to_rotvec, rotvec_to_quat
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.actors import ActorFrame
from recorder.episode.actor_messages import actor_frames
from recorder.episode.ego_messages import EgoRow, Event
from recorder.episode.episode import Episode
from recorder.episode.traffic_level import TrafficLevel
from recorder.episode.writer import EpisodeHeader, EpisodeWriter

STANDING_MPS = 0.02
"""Slower than this is a standstill [m/s]."""
STANDING_S = 1.0
"""Standstill that both sides of a joint need [s]."""
JOINT_M, JOINT_DEG = 0.05, 0.3
"""How far apart two standing cars may be to be joined [m], [deg]."""


def cut_episode(source: Path, out: Path, start_s: float, end_s: float, *, overwrite: bool = False) -> Episode:
    """A stretch of a drive as a separate drive, in whole 50 ms steps.

    Raises:
        EpisodeError: the stretch is not inside the drive, or `out` exists.
    """
    episode = Episode.load(source)
    first, last = round(start_s * TICK_HZ / STEP_TICKS), round(end_s * TICK_HZ / STEP_TICKS)
    steps = min(len(episode.steps) - 1, (len(episode.ego) - 1) // STEP_TICKS)
    if not 0 <= first < last <= steps:
        raise EpisodeError(
            f"{source} lasts {steps * STEP_TICKS * TICK_S:.2f} s; give 0 <= start < end within it, "
            f"not {start_s:g} to {end_s:g}"
        )
    a, b = first * STEP_TICKS, last * STEP_TICKS
    # One tick and one step more, which interpolation at the very end asks for.
    rows, kept = episode.ego[a : b + 2], episode.steps[first : last + 2]
    events = [replace(event, tick=event.tick - a) for event in episode.events if a <= event.tick <= b]
    header = _edited(episode.header, f"cut {start_s:g} to {end_s:g} s of {source.name}")
    return _write(out, header, rows, actor_frames(kept), kept["signals"], events, overwrite=overwrite)


def join_episodes(first: Path, second: Path, out: Path, *, overwrite: bool = False) -> Episode:
    """Two drives as one, joined where the car stands still; the others jump there.

    The second drive's first second, a standstill, is eased from where the first one ended.

    Raises:
        EpisodeError: maps or actors differ, a side does not stand, or the places differ by more than
            `JOINT_M` or `JOINT_DEG`.
    """
    a, b = Episode.load(first), Episode.load(second)
    if a.header.town_hash != b.header.town_hash:
        raise EpisodeError(f"{first} and {second} were driven in different towns; join drives in one town")
    same = np.array_equal(a.header.catalog.id, b.header.catalog.id)
    if not same or a.header.catalog.model != b.header.catalog.model:
        raise EpisodeError(
            f"{first} and {second} have different actors; take them out of both first: "
            "carlaloc edit actors E.mcap --drop all"
        )
    steps = min(len(a.steps) - 1, (len(a.ego) - 1) // STEP_TICKS)
    head, head_frames = a.ego[: steps * STEP_TICKS], a.steps[:steps]
    tail = b.ego.copy()
    _must_stand(head[-round(STANDING_S * TICK_HZ) :], f"the end of {first}")
    _must_stand(tail[: round(STANDING_S * TICK_HZ)], f"the beginning of {second}")
    _ease(tail, head[-1], first, second)
    events = [e for e in a.events if e.kind != "end"]
    events.append(Event(tick=len(head), kind="joint", data={"with": second.name}))
    events += [replace(e, tick=e.tick + len(head)) for e in b.events]
    header = _edited(a.header, f"joined {first.name} and {second.name} at {len(head) * TICK_S:.3f} s")
    frames = [*actor_frames(head_frames), *actor_frames(b.steps)]
    signals = np.concatenate([head_frames["signals"], b.steps["signals"]])
    return _write(out, header, np.concatenate([head, tail]), frames, signals, events, overwrite=overwrite)


def drop_actors(source: Path, out: Path, drop: Sequence[str], *, overwrite: bool = False) -> Episode:
    """The same drive without some of the others.

    Args:
        source: The episode.
        out: New episode.
        drop: ``all``, ``vehicles``, ``walkers``, model names, or instance ids.
        overwrite: Whether an older `out` is replaced.

    Raises:
        ConfigError: no actor has such a name or id.
    """
    episode = Episode.load(source)
    catalog = episode.header.catalog
    walks = catalog.tag == Tag.PEDESTRIAN
    kinds = {"all": np.ones(len(catalog), bool), "vehicles": ~walks, "walkers": walks}
    models = np.array(catalog.model, dtype=object)
    gone = np.zeros(len(catalog), bool)
    for name in drop:
        if name in kinds:
            gone |= kinds[name]
        elif name.isdigit() and int(name) in catalog.id:
            gone |= catalog.id == int(name)
        elif name in catalog.model:
            gone |= models == name
        else:
            raise ConfigError(unknown_name("actor", name, [*kinds, *set(catalog.model)]))
    return _keep(episode, source, out, np.flatnonzero(~gone), f"dropped {', '.join(drop)} of", overwrite)


def thin_actors(source: Path, out: Path, fraction: float, *, overwrite: bool = False) -> Episode:
    """The same drive with some of the others, chosen as a replay's traffic level chooses them.

    Raises:
        ConfigError: the fraction is not between 0 and 1.
    """
    episode = Episode.load(source)
    level = TrafficLevel(name="thinned", fraction=fraction)
    kept = level.select(episode.timeline()).catalog.id
    index = np.flatnonzero(np.isin(episode.header.catalog.id, kept))
    return _keep(episode, source, out, index, f"kept {fraction:g} of the actors of", overwrite)


def _keep(
    episode: Episode, source: Path, out: Path, index: NDArray[np.intp], what: str, overwrite: bool
) -> Episode:
    header = _edited(episode.header, f"{what} {source.name}")
    header = replace(header, catalog=episode.header.catalog.take(index))
    frames = (frame.take(index) for frame in actor_frames(episode.steps))
    signals = episode.steps["signals"]
    return _write(out, header, episode.ego, frames, signals, episode.events, overwrite=overwrite)


def rewrite_traffic(
    source: Path,
    out: Path,
    header: EpisodeHeader,
    frames: Iterable[ActorFrame],
    signals: NDArray[np.uint8],
    what: str,
    *,
    overwrite: bool = False,
) -> Episode:
    """The same drive among others; `header` holds their catalogue and configuration."""
    episode = Episode.load(source)
    events = [event for event in episode.events if event.kind != "collision"]
    edited = _edited(header, f"{what} of {source.name}")
    return _write(out, edited, episode.ego, frames, signals, events, overwrite=overwrite)


def _edited(header: EpisodeHeader, what: str) -> EpisodeHeader:
    return replace(header, history=(*header.history, what))


def _write(
    out: Path,
    header: EpisodeHeader,
    rows: NDArray[np.void],
    frames: Iterable[ActorFrame],
    signals: NDArray[np.uint8],
    events: Iterable[Event],
    *,
    overwrite: bool,
) -> Episode:
    waiting = sorted(events, key=lambda event: event.tick)
    later = enumerate(zip(frames, signals, strict=True))
    with EpisodeWriter(out, header, overwrite=overwrite, keep_cut=False) as writer:
        for tick, row in enumerate(rows):
            if tick % STEP_TICKS == 0 and (found := next(later, None)) is not None:
                writer.step(found[0], *found[1])
            writer.ego(tick, EgoRow.of(row))
            while waiting and waiting[0].tick <= tick:
                event = waiting.pop(0)
                writer.event(event.tick, event.kind, event.data)
        for step, (frame, heads) in later:
            writer.step(step, frame, heads)
        for event in waiting:
            writer.event(event.tick, event.kind, event.data)
    return Episode.load(out)


def _must_stand(rows: NDArray[np.void], where: str) -> None:
    speed = np.abs(rows["speed_mps"]).max() if len(rows) >= round(STANDING_S * TICK_HZ) else np.inf
    if speed > STANDING_MPS:
        raise EpisodeError(
            f"the car does not stand for {STANDING_S:g} s at {where}; cut it at a standstill first: "
            "carlaloc edit cut E.mcap --start S --end S"
        )


def _ease(tail: NDArray[np.void], end: Any, first: Path, second: Path) -> None:
    """Move the first second of `tail` so that it begins at `end` and is itself again after it."""
    shift = end["position_m"] - tail["position_m"][0]
    turn = quat_to_rotvec(quat_multiply(end["quat_xyzw"], quat_conjugate(tail["quat_xyzw"][0])))
    away_m, away_deg = float(np.linalg.norm(shift)), float(np.degrees(np.linalg.norm(turn)))
    if away_m > JOINT_M or away_deg > JOINT_DEG:
        raise EpisodeError(
            f"the end of {first} and the beginning of {second} are {away_m:.3f} m and {away_deg:.2f}° apart; "
            f"a joint allows {JOINT_M:g} m and {JOINT_DEG:g}°"
        )
    count = round(STANDING_S * TICK_HZ)
    u = np.arange(count) / count
    left = 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    tail["position_m"][:count] += left[:, None] * shift
    turned = quat_multiply(rotvec_to_quat(left[:, None] * turn), tail["quat_xyzw"][:count])
    tail["quat_xyzw"][:count] = turned
