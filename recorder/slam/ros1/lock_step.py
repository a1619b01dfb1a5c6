"""Decides when a ROS 1 node gets its next input, so that a busy machine drops nothing."""

from __future__ import annotations

import math
from collections import deque
from typing import Protocol

MOST_LAG = 20
"""Longest lag that is learned [inputs]."""
REST_S = 0.05
"""Rest after an input for which no answer is due [s]."""
QUIET_S = 0.1
"""Rest after an input to a node that gives no poses [s]."""
_QUIET_AFTER = 3
"""Waits without any pose after which a node has lost its way."""
_CALM = 10
"""Fewest inputs without a wait in vain before a shorter lag is tried."""
_LOOK_S = 0.02
_SAME_STAMP_S = 1e-4


class SilentError(Exception):
    """A node gave no pose for too long."""


class Answering(Protocol):
    """A node as this rule sees it."""

    latest_s: float
    """Stamp of its latest pose [s]; -inf: it has given none."""

    def now_s(self) -> float:
        """Time on the clock [s]."""

    def look(self, limit_s: float) -> bool:
        """Wait for a new pose that long at most [s]; whether the node was at rest, poses or not."""


class LockStep:
    """Waits for a node after each input.

    A pose answers all inputs up to its stamp. After each input the node has to answer until at most `lag`
    inputs are open; if an answer came and left no more, the next input follows at once, and where none is due
    the node only has to rest for a moment. Patience is counted in time at rest (no thread runs or wants to),
    so that a node that computes is waited for as long as it does. A node that gives no pose at all, for it
    has not begun or has lost its way, is not waited for in full.

    `lag` is learned: 0 at first, one more after each wait in vain, and one less on trial after some inputs
    without such a wait. A trial that fails, of a node that answers every second input or k inputs later,
    doubles the number of inputs before the next; one that holds halves it. So a lag costs few waits, and a
    stall is forgotten.

    Args:
        node: The node.
        patience_s: Time at rest after which no answer is expected any more [s].
        silence_s: Time without any pose after which it counts as hanging [s].
    """

    def __init__(self, node: Answering, *, patience_s: float, silence_s: float) -> None:
        self._node, self._patience_s, self._silence_s = node, patience_s, silence_s
        self._open: deque[float] = deque()
        self._heard_s = math.nan
        self._mute = 0
        self._calm, self._interval, self._on_trial = 0, _CALM, False
        self.lag = 0
        """Inputs that may be open when the next one is sent."""

    @property
    def open(self) -> int:
        """Inputs without an answer."""
        return len(self._open)

    def sent(self, stamp_s: float) -> None:
        """Wait until the node is done with an input that was just sent.

        Raises:
            SilentError: it gave no pose for too long.
        """
        if math.isnan(self._heard_s):
            self._heard_s, waits = self._node.now_s(), True
        else:
            self._answered()
            waits = self._node.latest_s > -math.inf and self._mute < _QUIET_AFTER
        self._open.append(stamp_s)
        due = self.open > self.lag
        patience_s = (self._patience_s if due else REST_S) if waits else QUIET_S
        done = self._wait(patience_s)
        if waits and self._node.latest_s > -math.inf:
            self._learn(in_vain=due and not done)

    def finish(self) -> None:
        """Wait for answers to the last inputs, which a node may never give."""
        while self._open and self._wait(self._patience_s):
            pass

    def _wait(self, patience_s: float) -> bool:
        """Whether an answer came and left at most `lag` inputs open, before it rested that long."""
        rested_s, before_s, came = 0.0, self._node.now_s(), self._answered()
        while not came or self.open > self.lag:
            if rested_s > patience_s:
                self._mute += not came
                return False
            rests = self._node.look(_LOOK_S)
            now_s = self._node.now_s()
            rested_s += (now_s - before_s) * rests
            before_s, came = now_s, self._answered() or came
            if now_s - self._heard_s > self._silence_s:
                raise SilentError(f"no pose for {self._silence_s:g} s")
        return True

    def _answered(self) -> bool:
        """Whether poses have answered open inputs since it was last asked."""
        before = self.open
        while self._open and self._open[0] <= self._node.latest_s + _SAME_STAMP_S:
            self._open.popleft()
        if self.open < before:
            self._heard_s, self._mute = self._node.now_s(), 0
        return self.open < before

    def _learn(self, *, in_vain: bool) -> None:
        self._calm += 1
        if in_vain:
            # Waits without any pose were none of a lag.
            lost = self._mute >= _QUIET_AFTER
            self.lag = max(self.lag + 1 - _QUIET_AFTER, 0) if lost else min(self.lag + 1, MOST_LAG)
            self._calm, self._interval, self._on_trial = 0, self._interval * 2, False
        elif self._calm >= self._interval:
            if self._on_trial:
                self._interval = max(self._interval // 2, _CALM)
            self._on_trial, self._calm, self.lag = self.lag > 0, 0, max(self.lag - 1, 0)
