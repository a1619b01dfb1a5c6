"""Real time on a fixed tick, on fast machines and on slow ones."""

import pytest

from carlaloc_env.core.clock import TICK_S
from recorder.drive.pacer import MOST_TICKS, Pacer


class Clock:
    """Time that the test sets."""

    def __init__(self) -> None:
        self.now_s = 5.0

    def __call__(self) -> float:
        return self.now_s


def test_pace_is_exact_on_a_fast_machine() -> None:
    clock = Clock()
    pacer, ticks = Pacer(clock), 0
    for _ in range(1000):
        clock.now_s += 0.0167
        ticks += pacer.due()
    assert ticks == pytest.approx(16.7 * 200, abs=2)
    assert pacer.speed == pytest.approx(1.0, abs=0.01)
    assert not pacer.is_slow


def test_slow_machine_slows_the_world_evenly() -> None:
    """Pictures of 100 ms hold ten ticks each: half speed, no bursts, no debt afterwards."""
    clock = Clock()
    pacer, batches = Pacer(clock), []
    for _ in range(100):
        clock.now_s += 0.1
        batches.append(pacer.due())
    assert set(batches) == {MOST_TICKS}
    assert pacer.is_slow
    assert pacer.speed == pytest.approx(0.5, abs=0.01)
    clock.now_s += 0.01
    assert pacer.due() <= 3


@pytest.mark.parametrize(("speed", "warned"), [(0.89, True), (0.91, False), (0.97, False)])
def test_a_driver_is_warned_below_nine_tenths(speed: float, warned: bool) -> None:
    clock = Clock()
    pacer = Pacer(clock)
    for _ in range(100):
        clock.now_s += MOST_TICKS * TICK_S / speed
        pacer.due()
    assert pacer.speed == pytest.approx(speed, abs=0.005)
    assert pacer.is_slow == warned


def test_pause_owes_no_time() -> None:
    clock = Clock()
    pacer = Pacer(clock)
    clock.now_s += 60.0
    pacer.restart()
    assert pacer.due() == 0
