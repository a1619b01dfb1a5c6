"""Writes an episode as it happens; all but the last second survives a killed process."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_NS, STEP_TICKS, stamp_ns
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.core.files.atomic_files import part_path
from carlaloc_env.core.files.recordings import check_episode_output, recording_path, repair_command
from carlaloc_env.timeline.actors import ActorFrame
from recorder.episode.actor_messages import ACTORS, pack_actors
from recorder.episode.ego_messages import EVENT, EgoRow, ego_record, pack_ego
from recorder.episode.episode_header import HEADER_RECORD, EpisodeHeader
from recorder.episode.mcap_container import ContainerWriter
from recorder.episode.record_types import payloads_of

T = TypeVar("T")
Packed = tuple[int, int, bytes]
"""Channel, stamp [ns] and bytes of a message."""
FLUSH_NS = 900_000_000
"""Longest stretch of the drive, and of real time, that waits for the disk [ns]."""


class EpisodeWriter(AbstractContextManager["EpisodeWriter"]):
    """Appends ticks, steps and events; gives the file its final name when closed.

    As a context manager it closes the file at the end of the block; an exception inside leaves the
    file under its `.recording` name, readable up to the exception.
    """

    def __init__(
        self,
        path: str | Path,
        header: EpisodeHeader,
        *,
        overwrite: bool = False,
        durable: bool = True,
        keep_cut: bool = True,
    ) -> None:
        """Create the file.

        Args:
            path: Final name, e.g. ``drive.mcap``.
            header: Configuration of the drive.
            overwrite: Whether an older episode of this name is replaced (when the new one is closed).
            durable: Wait for the disk at every flush, so that even a power cut loses no more than the
                last second.
            keep_cut: Whether a cut-off file stays, as a `.recording`. A drive must; an edit of other
                episodes can be made again.

        Raises:
            OutputError: the name is taken, or a recording that was cut off waits under it.
            EpisodeError: the file cannot be created.
        """
        self.path = Path(path)
        self.header = header
        self._keep_cut = keep_cut
        self._part = (recording_path if keep_cut else part_path)(self.path)
        cars = len(header.cars) or 1
        self._next_ticks, self._next_step = [0] * cars, 0
        self._signal_count: int | None = None
        self._rows: list[list[EgoRow]] = [[] for _ in range(cars)]
        self._frames: list[tuple[ActorFrame, NDArray[np.uint8]]] = []
        self._happened: list[Packed] = []
        self._packed_ticks, self._packed_steps = [0] * cars, 0
        self._flushed_ns = 0
        self._flushed_at_s = time.monotonic()
        check_episode_output(self.path, overwrite=overwrite)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not keep_cut:
                self._part.unlink(missing_ok=True)
            self._file = ContainerWriter(self._part, durable=durable)
            self._file.add_metadata(HEADER_RECORD, header.to_metadata())
        except OSError as error:
            raise EpisodeError(f"cannot record to {self._part}: {error.strerror}") from error
        self._egos = [self._file.add_channel(ego_record(0))]
        self._actors = self._file.add_channel(ACTORS)
        self._events = self._file.add_channel(EVENT)
        self._egos += [self._file.add_channel(ego_record(car)) for car in range(1, cars)]
        self._open = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    def ego(self, tick: int, row: EgoRow, car: int = 0) -> None:
        """Append the state of a car after a tick; ticks come without gaps, from 0, one car after the other.

        Raises:
            EpisodeError: a tick was left out, or the disk is full.
        """
        if tick != self._next_ticks[car]:
            raise EpisodeError(f"tick {tick} recorded where {self._next_ticks[car]} was due")
        self._check_open()
        self._next_ticks[car] += 1
        self._rows[car].append(row)
        if tick % STEP_TICKS == 0 and car == len(self._rows) - 1:
            self._flush_in_time(stamp_ns(tick))

    def step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        """Append the actors and signal heads of a 50 ms step; steps come without gaps, from 0.

        Raises:
            EpisodeError: a step was left out, the number of actors or signals changed, or the disk is full.
        """
        if step != self._next_step:
            raise EpisodeError(f"step {step} recorded where {self._next_step} was due")
        if self._signal_count is None:
            self._signal_count = len(signals)
        if len(frame) != len(self.header.catalog) or len(signals) != self._signal_count:
            raise EpisodeError(
                f"step {step} has {len(frame)} actors and {len(signals)} signal heads, "
                f"not {len(self.header.catalog)} and {self._signal_count}"
            )
        self._check_open()
        self._next_step += 1
        self._frames.append((frame, signals))

    def event(self, tick: int, kind: str, data: Mapping[str, object] | None = None) -> None:
        """Append something that happened; `data` holds JSON values."""
        text = json.dumps(dict(data or {}), ensure_ascii=False)
        self._check_open()
        message = EVENT.pack({"tick": tick, "kind": kind, "json": text})
        self._happened.append((self._events, stamp_ns(tick), message))

    def flush(self) -> None:
        """Put everything on the disk now, e.g. while the drive is paused.

        Raises:
            EpisodeError: the disk is full.
        """
        try:
            self._file.close_chunk(self._messages)
        except OSError as error:
            self._open = False
            self._file.abandon()
            safe = "the drive until a second ago is safe there; make it whole with: "
            kept = f"; {safe}{repair_command(self.path)}" if self._keep_cut else ""
            raise EpisodeError(f"cannot keep recording to {self._part}: {error.strerror}{kept}") from error
        self._flushed_at_s = time.monotonic()

    @property
    def size_bytes(self) -> int:
        """Size of the file on the disk so far [bytes]."""
        return self._file.size_bytes

    def close(self, *, into: Path | None = None) -> None:
        """Complete the file and give it its final name; a second call does nothing.

        Args:
            into: Another final name.

        Raises:
            EpisodeError: the disk is full.
        """
        if not self._open:
            return
        self.flush()
        self._open = False
        try:
            self._file.finish()
            self._part.replace(into or self.path)
        except OSError as error:
            raise EpisodeError(f"cannot complete {self._part}: {error.strerror}") from error

    def abandon(self) -> None:
        """Put everything on the disk and leave the file under its `.recording` name, or remove it."""
        if self._open and self._keep_cut:
            self.flush()
        if self._open:
            self._open = False
            self._file.abandon()
        if not self._keep_cut:
            self._part.unlink(missing_ok=True)

    def _check_open(self) -> None:
        if not self._open:
            raise EpisodeError(f"{self._part} is closed; nothing can be added to it")

    def _flush_in_time(self, stamp: int) -> None:
        waited_s = time.monotonic() - self._flushed_at_s
        if stamp - self._flushed_ns >= FLUSH_NS or waited_s * 1e9 >= FLUSH_NS:
            self._flushed_ns = stamp
            self.flush()

    def _messages(self) -> list[Packed]:
        """Messages that wait, in the order of time; ticks and steps are packed together."""
        frames, messages = _taken(self._frames), _taken(self._happened)
        if frames:
            first = self._packed_steps
            self._packed_steps += len(frames)
            steps = enumerate(payloads_of(pack_actors(first, *zip(*frames, strict=True))), start=first)
            messages += [(self._actors, step * STEP_NS, payload) for step, payload in steps]
        for car, waiting in enumerate(self._rows):
            if not (rows := _taken(waiting)):
                continue
            first = self._packed_ticks[car]
            self._packed_ticks[car] += len(rows)
            ticks = enumerate(payloads_of(pack_ego(first, rows)), start=first)
            messages += [(self._egos[car], stamp_ns(tick), payload) for tick, payload in ticks]
        return sorted(messages, key=itemgetter(1))


def _taken(waiting: list[T]) -> list[T]:
    """All items of a list, which is empty afterwards."""
    taken = waiting[:]
    del waiting[: len(taken)]
    return taken
