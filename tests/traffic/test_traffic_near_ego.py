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
@pytest.mark.parametrize(("town", "moving"), [("Town05", 6.0), ("Town03", 6.0)])
def test_a_stretch_among_others(town: str, moving: float) -> None:
    """The first 40 s."""
    found = drive(town, seed=0, duration_s=40.0)
    check(found)
    assert found.moving_50 >= moving
    assert found.length_m > 200.0
