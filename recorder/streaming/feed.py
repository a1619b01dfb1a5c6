"""Process that makes frames ahead and hands them to systems, whose lanes take turns on their cores."""

import json
import os
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from queue import Full, Queue

from carlaloc_env.core.errors import CarlaLocError
from recorder.dataset.feed_readings import NEXT, STAMPS
from recorder.episode.episode import Episode
from recorder.streaming.frames import FrameJob, FrameMaker, Key, frame_stamps_ns, inertial_samples

AHEAD = 8
"""Frames that are made ahead."""
SHARES = "movers.json"
"""File with the share of movers of each labelled stream and `Feed.shared`, written at the end."""
_LOOK_S = 0.2
"""Time between two checks for remaining listeners [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Listener:
    """A system that gets frames; one that has ended is left out from then on."""

    connection: Connection
    """Its connection."""
    key: Key
    """Version of the frames that it gets."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FeedJob:
    """Job of a feed's process: frames, listeners and an output folder."""

    frames: FrameJob
    """The frames."""
    lanes: tuple[tuple[tuple[int, Key], ...], ...]
    """Systems by lane: file descriptor of the connection, and version of the frames."""
    out: Path
    """Folder for `SHARES`."""


class Feed:
    """Hands frames to the listeners of some lanes while they are made.

    The systems of a lane take turns: a system works on a frame until it asks for the next. So no two systems
    compete for the lane's cores, and a frame's time is that of a single system.

    Args:
        job: The frames.
        lanes: Listeners by lane.
    """

    def __init__(self, job: FrameJob, lanes: Sequence[Sequence[Listener]]) -> None:
        self._job, self._lock = job, threading.Lock()
        self._timeline = Episode.load(job.recipe.episode, car=job.recipe.car).timeline()
        self._answers: dict[object, bytes] = {}
        self.shared = (0, 0)
        """Instants that were measured, and frames that were made of them."""
        self._lanes = [_Lane(listeners, self._answer) for listeners in lanes]

    def run(self, report: Callable[[float], None]) -> dict[str, float]:
        """Make all frames; return the shares of movers, empty if no listener stayed to the end.

        Args:
            report: Called at each frame with the part of the drive made so far [s].

        Raises:
            CarlaLocError: a frame cannot be made.
        """
        maker = FrameMaker(self._job)
        try:
            for done_s, versions in maker.frames():
                # A frame that several conditions share is a single object.
                bytes_of = {id(frame): bytes(ForkingPickler.dumps(frame)) for frame in versions.values()}
                packed = {key: bytes_of[id(frame)] for key, frame in versions.items()}
                has_listeners = [lane.put(packed) for lane in self._lanes]
                if not any(has_listeners):
                    return {}
                report(done_s)
            for lane in self._lanes:
                lane.finish()
            self.shared = maker.shared
            return maker.mover_shares()
        finally:
            maker.close()

    def _answer(self, request: str, key: Key) -> bytes:
        imu, faults = self._job.imu, self._job.faults_of(key)
        # Inertial samples are the same in conditions whose IMU has the same faults.
        answer_key = (request, key[1], faults if request == STAMPS or imu is None else faults.of(imu))
        with self._lock:
            if answer_key not in self._answers:
                answer = (
                    frame_stamps_ns(self._job, self._timeline.end_ns, key)
                    if request == STAMPS
                    else inertial_samples(self._job, self._timeline, key)
                )
                self._answers[answer_key] = bytes(ForkingPickler.dumps(answer))
            return self._answers[answer_key]


class _Lane:
    """Hands each frame to the listeners in turn."""

    def __init__(self, listeners: Sequence[Listener], answer: Callable[[str, Key], bytes]) -> None:
        self._listeners, self._answer = list(listeners), answer
        self._frames: Queue[dict[Key, bytes] | None] = Queue(AHEAD)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, versions: dict[Key, bytes] | None) -> bool:
        """Add a frame (None: the end) as soon as there is room; False: no listener is left."""
        while self._thread.is_alive():
            try:
                self._frames.put(versions, timeout=_LOOK_S)
                return True
            except Full:
                continue
        return False

    def finish(self) -> None:
        """Send the end to all listeners, and wait for them."""
        self.put(None)
        self._thread.join()

    def _run(self) -> None:
        while self._listeners:
            versions = self._frames.get()
            self._listeners = [listener for listener in self._listeners if self._give(listener, versions)]
            if versions is None:
                return

    def _give(self, listener: Listener, versions: dict[Key, bytes] | None) -> bool:
        """Hand over a frame and wait until it has been worked on; False: the listener has ended."""
        connection = listener.connection
        if versions is not None and listener.key not in versions:
            return True  # a fault has lost this frame
        try:
            while (request := connection.recv()) != NEXT:
                connection.send_bytes(self._answer(request, listener.key))
            connection.send_bytes(_END if versions is None else versions[listener.key])
            if versions is not None:
                connection.poll(None)
        except (EOFError, OSError):
            return False
        return True


_END = bytes(ForkingPickler.dumps(None))
"""Sent in place of a frame after the last."""


def main(parent_fd: int) -> int:
    """Run the `FeedJob` that the benchmark sends; an error is the last line on stderr.

    Args:
        parent_fd: File descriptor of a connection to the benchmark; the feed ends when the other end does.
    """
    parent = Connection(parent_fd)
    job: FeedJob = parent.recv()
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    lanes = [[Listener(connection=Connection(fd), key=key) for fd, key in lane] for lane in job.lanes]
    try:
        feed = Feed(job.frames, lanes)
        shares = feed.run(parent.send)
    except CarlaLocError as error:
        print(error, file=sys.stderr)  # noqa: T201
        return 1
    summary = {"movers": shares, "shared": feed.shared}
    (job.out / SHARES).write_text(json.dumps(summary), encoding="utf-8")
    return 0


def _end_with(parent: Connection) -> None:
    """End this process as soon as the benchmark has ended, however that came."""
    with suppress(EOFError, OSError):
        parent.recv()
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
