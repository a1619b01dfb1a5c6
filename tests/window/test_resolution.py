"""Live pictures are as large as the machine can draw in time."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from recorder.window.resolution import BUDGET_S, SIZES_PX, LiveResolution


def drive(resolution: LiveResolution, cost_s: Callable[[int], float], pictures: int) -> list[tuple[int, int]]:
    """Sizes of so many pictures; `cost_s` tells what one of so many pixels takes."""
    sizes = []
    for _ in range(pictures):
        sizes.append(resolution.size_px)
        resolution.took(cost_s(sizes[-1][0] * sizes[-1][1]))
    return sizes


def test_a_fast_machine_keeps_the_largest() -> None:
    assert set(drive(LiveResolution(), lambda _: 0.9 * BUDGET_S, 100)) == {SIZES_PX[0]}


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_slow_machine_settles_at_the_largest_in_time(share: float) -> None:
    """A fixed part and one per pixel: the size that stays is in time, the next larger is not."""
    largest = SIZES_PX[0][0] * SIZES_PX[0][1]

    def cost_s(pixels: int) -> float:
        return BUDGET_S * 1.3 * (share + (1.0 - share) * pixels / largest)

    last = drive(LiveResolution(), cost_s, 200)[-50:]
    assert len(set(last)) == 1
    index = SIZES_PX.index(last[0])
    assert index == len(SIZES_PX) - 1 or cost_s(last[0][0] * last[0][1]) <= BUDGET_S
    assert cost_s(SIZES_PX[index - 1][0] * SIZES_PX[index - 1][1]) > 0.8 * BUDGET_S


def test_one_slow_picture_changes_nothing() -> None:
    resolution = LiveResolution()
    drive(resolution, lambda _: 0.5 * BUDGET_S, 30)
    resolution.took(2.0 * BUDGET_S)
    assert set(drive(resolution, lambda _: 0.5 * BUDGET_S, 30)) == {SIZES_PX[0]}


def test_it_grows_again_when_there_is_time() -> None:
    resolution = LiveResolution()
    drive(resolution, lambda _: 3.0 * BUDGET_S, 60)
    assert resolution.size_px == SIZES_PX[-1]
    drive(resolution, lambda _: 0.2 * BUDGET_S, 60)
    assert resolution.size_px == SIZES_PX[0]
