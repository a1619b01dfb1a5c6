"""The ego is among others: it meets, follows and is passed, and gets on all the same, without a fault."""

from __future__ import annotations

import pytest

from benchmarks.traffic_near_ego import NearTraffic, drive

pytest.importorskip("pybullet", reason="the ego drives in PyBullet")


def check(found: NearTraffic) -> None:
    """No collision and no broken rule."""
    assert found.collisions == 0
    assert found.violations == ()


@pytest.mark.timeout(300)
@pytest.mark.parametrize(("town", "moving"), [("Town05", 4.5), ("Town03", 4.5)])
def test_a_stretch_among_others(town: str, moving: float) -> None:
    """The first 40 s."""
    found = drive(town, seed=0, duration_s=40.0)
    check(found)
    assert found.moving_50 >= moving
    assert found.length_m > 120.0


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_whole_routes_among_others() -> None:
    """The routes of three towns: at least eight actors move within 50 m and three within 25 m on the mean."""
    found = [drive(town, seed=seed) for town in ("Town03", "Town05", "Town10") for seed in (0, 1)]
    for one in found:
        check(one)
    assert sum(one.moving_50 for one in found) / len(found) >= 8.0
    assert sum(one.moving_25 for one in found) / len(found) >= 3.0


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_a_junction_comes_loose_again() -> None:
    """Three who wait for each other: one merges before the ego, which stands and has the right of way."""
    found = drive("Town07", seed=4, duration_s=250.0)
    check(found)
    assert found.length_m > 740.0
