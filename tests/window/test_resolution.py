"""Live pictures are as large as the machine can draw in time."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from recorder.window.live_resolution import (
    BUDGET_S,
    FIRST_PX,
    SIZES_PX,
    LiveResolution,
)
from recorder.window.window import WINDOW_PX

LARGEST = WINDOW_PX[0] * WINDOW_PX[1]


def drive(resolution: LiveResolution, cost_s: Callable[[int], float], pictures: int) -> list[tuple[int, int]]:
    """Sizes of so many pictures; `cost_s` tells what one of so many pixels takes."""
    sizes = []
    for _ in range(pictures):
        sizes.append(resolution.size_px)
        resolution.took(cost_s(sizes[-1][0] * sizes[-1][1]))
    return sizes


def test_a_fast_machine_draws_every_pixel_of_the_window() -> None:
    """Within a hundred pictures, five seconds, and it stays there."""
    assert drive(LiveResolution(), lambda _: 0.5 * BUDGET_S, 200)[100:] == [WINDOW_PX] * 100


@pytest.mark.parametrize("share", [0.2, 0.5])
@pytest.mark.parametrize("slowness", [1.3, 2.0, 3.0])
def test_a_machine_settles_at_the_largest_in_time(share: float, slowness: float) -> None:
    """A fixed part and one per pixel: the size that stays is in time, a few sizes more are not."""

    def cost_s(pixels: int) -> float:
        return BUDGET_S * slowness * (0.3 * share + (1.0 - 0.3 * share) * pixels / LARGEST)

    last = drive(LiveResolution(), cost_s, 300)[-50:]
    assert len(set(last)) == 1
    index = SIZES_PX.index(last[0])
    assert cost_s(last[0][0] * last[0][1]) <= BUDGET_S
    assert cost_s(SIZES_PX[index - 1][0] * SIZES_PX[index - 1][1]) > 0.8 * BUDGET_S


def test_pictures_of_a_busy_machine_do_not_flicker() -> None:
    """Times that differ by a third from one picture to the next: the size seldom changes."""
    rng = np.random.default_rng(0)
    resolution = LiveResolution()

    def cost_s(pixels: int) -> float:
        return float(BUDGET_S * 3.0 * pixels / LARGEST * rng.lognormal(0.0, 0.3))

    sizes = drive(resolution, cost_s, 1500)[300:]
    changes = sum(a != b for a, b in pairwise(sizes))
    assert changes < 12, "once in five seconds at most"


def test_it_shrinks_at_once_and_grows_again_when_there_is_time() -> None:
    """A size that is far too slow is not left in single steps."""
    resolution = LiveResolution()
    drive(resolution, lambda _: 3.0 * BUDGET_S, 20)
    assert resolution.size_px == SIZES_PX[-1]
    drive(resolution, lambda _: 0.2 * BUDGET_S, 100)
    assert resolution.size_px == SIZES_PX[0]
    assert FIRST_PX in SIZES_PX
