"""Starts and watches the process of a feed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.text_files import last_line
from recorder.streaming.feed import SHARES, FeedJob
from recorder.streaming.frames import FrameJob, Key

LOG = "feed.log"
"""File with a feed's output."""


class RunningFeed:
    """The process of a feed, ended at the latest with the context.

    Args:
        job: The frames.
        lanes: Which version each system of each lane gets.
        out: Folder of its files.
        cores: Cores that it may use; empty: all.
    """

    def __init__(
        self, job: FrameJob, lanes: Sequence[Sequence[Key]], out: Path, cores: tuple[int, ...] = ()
    ) -> None:
        self._out, self._made_s = out, 0.0
        self.shared = (0, 0)
        """Instants that were measured, and frames that were made of them; known when it has ended."""
        out.mkdir(parents=True, exist_ok=True)
        pairs = [[Pipe() for _ in lane] for lane in lanes]
        self.connections: list[list[Connection]] = [[there for there, _ in lane] for lane in pairs]
        """The systems' ends, by lane."""
        self._parent, other = Pipe()
        given = tuple(
            tuple((here.fileno(), key) for (_, here), key in zip(pair, lane, strict=True))
            for pair, lane in zip(pairs, lanes, strict=True)
        )
        ends = [other, *(here for lane in pairs for _, here in lane)]
        with (out / LOG).open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "recorder.streaming.feed", str(other.fileno())],
                stdout=log,
                stderr=subprocess.STDOUT,
                pass_fds=[end.fileno() for end in ends],
                start_new_session=True,
            )
        # Ends that stay open here would keep a dead feed's listeners waiting.
        for end in ends:
            end.close()
        if cores and hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(self._process.pid, cores)
        # A feed that could not start has closed its end; `wait` raises its error.
        with suppress(OSError):
            self._parent.send(FeedJob(frames=job, lanes=given, out=out))

    def __enter__(self) -> RunningFeed:
        return self

    def __exit__(self, *_: object) -> None:
        for end in (self._parent, *(end for lane in self.connections for end in lane)):
            with suppress(OSError):
                end.close()
        self._process.kill()
        self._process.wait()

    def made_s(self, wait_s: float) -> float:
        """Length of the drive that has been made [s]; waits at most `wait_s` for news."""
        until = time.monotonic() + wait_s
        try:
            while self._parent.poll(max(until - time.monotonic(), 0.0)):
                self._made_s = self._parent.recv()
        except (EOFError, OSError):
            # It has ended; a caller in a loop must not spin.
            time.sleep(wait_s)
        return self._made_s

    def wait(self) -> dict[str, float]:
        """Wait until it has ended; return the share of movers of each labelled stream.

        Raises:
            EvaluationError: it has failed; the message is its last line.
        """
        status = self._process.wait()
        if status:
            log = self._out / LOG
            raise EvaluationError(last_line(log) or f"the feed ended with {status}; see {log}")
        feed_summary = json.loads((self._out / SHARES).read_text(encoding="utf-8"))
        self.shared = (int(feed_summary["shared"][0]), int(feed_summary["shared"][1]))
        return dict(feed_summary["movers"])
