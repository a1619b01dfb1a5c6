"""A running ROS 1 node as the player sees it: its poses, whether it rests, and that it is there.

Runs under the system's Python and imports nothing of ours.
"""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import genpy.dynamic
import rospy

_GONE_S = 1.0
"""How long a node may be without connections before it counts as ended [s]."""
_DIED = "REQUIRED process ["
"""Words with which roslaunch reports that a required node has ended."""
_FAREWELL = ("No processes to monitor", "shutting down processing monitor", "killing on exit")
"""Words with which roslaunch ends, whatever the reason."""
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_WORKS = 0.3
"""Share of the time that a node at rest may compute: some ask for news without end."""


class GoneError(Exception):
    """A node has ended."""


class Printed:
    """Output of a command: handed on to our own, its last lines kept."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._lines: deque[str] = deque(maxlen=20)
        self._died: list[str] = []
        self._reader = threading.Thread(target=self._read, args=(process.stdout,), daemon=True)
        self._reader.start()

    def _read(self, stream: Any) -> None:
        for raw in stream:
            sys.stdout.buffer.write(raw)
            sys.stdout.buffer.flush()
            line = _COLOURS.sub("", raw.decode(errors="replace")).strip()
            if _DIED in line:
                self._died = [line[line.index(_DIED) :], *list(self._lines)[-1:]]
            if line.strip("=") and not any(word in line for word in _FAREWELL):
                self._lines.append(line)

    @property
    def required_died(self) -> bool:
        """Whether roslaunch has reported that a required node ended; it may take long to end the others."""
        return bool(self._died)

    def last(self) -> str:
        """The last line, or of roslaunch which node died and the last line before."""
        self._reader.join(0.5)
        return ": ".join(self._died or list(self._lines)[-1:]) or "it printed nothing"


class Node:
    """A running node as lock-step sees it: its poses, whether it rests, and that it is there."""

    def __init__(self, poses: str, command: Sequence[str]) -> None:
        self._command, self._topic = command[0], poses
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self._printed = Printed(self._process)
        self._arrived = threading.Condition()
        self._taken, self._seen = 0, False
        self._ticks, self._looked_s, self._there_s = 0, time.monotonic(), time.monotonic()
        self._kinds: dict[str, Any] = {}
        self.latest_s = -math.inf
        self.messages: list[Any] = []
        self._poses = rospy.Subscriber(poses, rospy.AnyMsg, self._take, queue_size=None)
        self.input: Any = None
        """Publisher of what it is fed with."""

    def _take(self, raw: Any) -> None:
        head = raw._connection_header
        if head["type"] not in self._kinds:
            made = genpy.dynamic.generate_dynamic(head["type"], head["message_definition"])
            self._kinds[head["type"]] = made[head["type"]]
        message = self._kinds[head["type"]]().deserialize(raw._buff)
        with self._arrived:
            self.messages.append(message)
            self.latest_s = message.header.stamp.to_sec()
            self._arrived.notify()

    def now_s(self) -> float:
        """Time on the clock [s]."""
        return time.monotonic()

    def look(self, limit_s: float) -> bool:
        """Wait for a new pose that long at most [s]; whether the node was at rest.

        Raises:
            GoneError: it has ended.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: len(self.messages) > self._taken, limit_s)
            self._taken = len(self.messages)
        self.check()
        return self._rests()

    def check(self) -> None:
        """Make sure that it runs.

        Raises:
            GoneError: it has ended, with the last line that it printed.
        """
        status = self._process.poll()
        if status is not None or self._printed.required_died:
            how = "ended" if status is None else f"ended with {status}"
            raise GoneError(f"{self._command} {how}: {self._printed.last()}")
        self._seen = self._seen or self._poses.get_num_connections() > 0
        reads = self.input is None or self.input.get_num_connections() > 0
        if reads and (not self._seen or self._poses.get_num_connections() > 0):
            self._there_s = time.monotonic()
        elif time.monotonic() - self._there_s > _GONE_S:
            lost = f"publishes {self._topic}" if reads else f"reads {self.input.name}"
            raise GoneError(f"the node that {lost} has ended: {self._printed.last()}")

    def _rests(self) -> bool:
        """Whether none of its threads wanted to run, and they hardly did since it was last asked."""
        ticks, wants, now_s = 0, False, time.monotonic()
        for pid in (self._process.pid, *_below(self._process.pid)):
            for task in Path(f"/proc/{pid}/task").glob("*/stat"):
                try:
                    words = task.read_text().rpartition(") ")[2].split()
                except OSError:
                    continue
                wants = wants or words[0] not in "SIZX"
                ticks += int(words[11]) + int(words[12])
        used_s = (ticks - self._ticks) / os.sysconf("SC_CLK_TCK")
        worked = used_s > _WORKS * (now_s - self._looked_s)
        self._ticks, self._looked_s = ticks, now_s
        return not wants and not worked


def _below(pid: int) -> list[int]:
    pids: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children = [int(word) for word in task.read_text().split()]
        except OSError:
            continue
        for child in children:
            pids += [child, *_below(child)]
    return pids
