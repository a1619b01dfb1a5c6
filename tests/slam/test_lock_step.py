"""The rule of lock-step by nodes in a time of their own: slow, lagging, stalling, silent ones."""

import math
from collections.abc import Callable

import pytest

from recorder.slam.ros1.lock_step import QUIET_S, LockStep, SilentError

PATIENCE_S = 2.0


class TimedNode:
    """Takes a time for each input, and then answers up to an input, or not.

    Args:
        takes_s: Time for input k [s].
        answers: Newest input that is answered when input k is done; None: no pose.
        computes: Whether it shows that it is at work; else it seems to rest.
    """

    def __init__(
        self,
        takes_s: Callable[[int], float],
        answers: Callable[[int], int | None] = lambda k: k,
        *,
        computes: bool = True,
    ) -> None:
        self.takes_s, self.answers, self.computes = takes_s, answers, computes
        self.time_s, self.latest_s = 0.0, -math.inf
        self.queue: list[int] = []
        self.done_s = math.inf
        self.most_waiting = 0

    def get(self, k: int) -> None:
        if not self.queue:
            self.done_s = self.time_s + self.takes_s(k)
        self.queue.append(k)
        self.most_waiting = max(self.most_waiting, len(self.queue) - 1)

    def now_s(self) -> float:
        return self.time_s

    def look(self, limit_s: float) -> bool:
        until = self.time_s + limit_s
        if self.done_s > until:
            self.time_s = until
            return not (self.queue and self.computes)
        self.time_s = self.done_s
        newest = self.answers(self.queue.pop(0))
        if newest is not None:
            self.latest_s = max(self.latest_s, float(newest))
        self.done_s = self.time_s + self.takes_s(self.queue[0]) if self.queue else math.inf
        return False


def fed(node: TimedNode, inputs: int) -> LockStep:
    steps = LockStep(node, patience_s=PATIENCE_S, silence_s=60.0)
    for k in range(inputs):
        node.get(k)
        steps.sent(float(k))
    steps.finish()
    return steps


def test_a_node_that_computes_is_waited_for_as_long_as_it_does() -> None:
    node = TimedNode(lambda k: 15.0 if k == 50 else 0.3)
    steps = fed(node, 100)
    assert (steps.lag, steps.open, node.most_waiting) == (0, 0, 0)


@pytest.mark.parametrize("lag", [1, 3])
def test_a_constant_lag_costs_a_few_waits(lag: int) -> None:
    """In 1000 inputs, where one wait for each would cost 2000 s."""
    node = TimedNode(lambda k: 0.1, lambda k: k - lag if k >= lag else None)
    steps = fed(node, 1000)
    assert node.most_waiting == 0
    assert steps.lag == pytest.approx(lag, abs=1)
    assert node.time_s - 1000 * 0.1 < 12 * PATIENCE_S + 1000 * 0.08


def test_a_node_that_answers_every_second_input_costs_a_few_waits() -> None:
    node = TimedNode(lambda k: 0.1, lambda k: k if k % 2 else None)
    fed(node, 1000)
    assert node.most_waiting == 0
    assert node.time_s - 1000 * 0.1 < 10 * PATIENCE_S + 500 * 0.08


def test_a_stall_is_forgotten() -> None:
    """A node that sleeps for 5 s, as it seems: some inputs wait for it then, and none a few inputs later."""
    node = TimedNode(lambda k: 5.0 if k == 20 else 0.1, computes=False)
    steps = fed(node, 25)
    assert 1 <= node.most_waiting <= 3
    assert steps.lag >= 1
    for k in range(25, 300):
        node.get(k)
        steps.sent(float(k))
        if k == 200:
            node.most_waiting = 0
    assert (steps.lag, steps.open, node.most_waiting) == (0, 0, 0)


def test_a_node_that_begins_late_or_loses_its_way_is_not_waited_for_in_full() -> None:
    node = TimedNode(lambda k: 0.05, lambda k: k if 100 <= k < 150 or k >= 200 else None)
    steps = fed(node, 300)
    assert (steps.lag, steps.open, node.most_waiting) == (0, 0, 0)
    assert node.time_s < 300 * 0.05 + 6 * PATIENCE_S + 150 * (QUIET_S + 0.03)


def test_a_node_that_hangs_is_named() -> None:
    node = TimedNode(lambda k: math.inf if k == 20 else 0.1)
    with pytest.raises(SilentError, match="no pose for 60 s"):
        fed(node, 100)
    assert node.time_s == pytest.approx(62, abs=2)
