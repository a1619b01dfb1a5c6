"""Writes new episodes of recorded ones; sources stay as they are."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_TICKS
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.timeline.actors import ActorFrame
from recorder.episode.ego_messages import EgoRow, Event
from recorder.episode.episode import Episode
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.writer import EpisodeWriter


def write_episode(
    out: Path,
    header: EpisodeHeader,
    rows: NDArray[np.void],
    frames: Iterable[ActorFrame],
    signals: NDArray[np.uint8],
    events: Iterable[Event],
    *,
    overwrite: bool,
) -> Episode:
    """A whole episode of a header, rows of the ego, frames and lights of the steps, and events.

    Raises:
        EpisodeError: `out` exists or cannot be written.
    """
    if header.cars:
        raise EpisodeError(f"the drive has {len(header.cars)} cars; edit drives of one car")
    waiting = sorted(events, key=lambda event: event.tick)
    later = enumerate(zip(frames, signals, strict=True))
    with EpisodeWriter(out, header, overwrite=overwrite, keep_cut=False) as writer:
        for tick, row in enumerate(rows):
            if tick % STEP_TICKS == 0 and (following := next(later, None)) is not None:
                step, (frame, heads) = following
                writer.step(step, frame, heads)
            writer.ego(tick, EgoRow.of(row))
            while waiting and waiting[0].tick <= tick:
                event = waiting.pop(0)
                writer.event(event.tick, event.kind, event.data)
        for step, (frame, heads) in later:
            writer.step(step, frame, heads)
        for event in waiting:
            writer.event(event.tick, event.kind, event.data)
    return Episode.load(out)
