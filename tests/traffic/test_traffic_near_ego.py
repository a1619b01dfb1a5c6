"""The ego is among others: it meets, follows and is passed, and gets on all the same, without a fault."""

from pathlib import Path

import pytest

from benchmarks.traffic_near_ego import SEEDS, drive
from recorder.factory import STANDARD_SEEDS

pytest.importorskip("pybullet", reason="the ego drives in PyBullet")


def test_a_stretch_among_others(tmp_path: Path) -> None:
    """The first 40 s of the standard drive."""
    found = drive(tmp_path, "Town03", STANDARD_SEEDS["Town03"], duration_s=40.0)
    assert found.is_sound
    assert found.moving_50 >= 4.5
    assert found.summary.driven_m > 120.0


@pytest.mark.soak
@pytest.mark.timeout(7200)
def test_whole_routes_among_others(tmp_path: Path) -> None:
    """Ten drives in each of three towns: ten actors move within 50 m and four within 25 m on the mean."""
    found = {
        (town, seed): drive(tmp_path, town, seed) for town in ("Town03", "Town05", "Town10") for seed in SEEDS
    }
    assert sum(one.moving_50 for one in found.values()) / len(found) >= 10.0
    assert sum(one.moving_25 for one in found.values()) / len(found) >= 4.0
    assert all(one.is_sound for one in found.values())


@pytest.mark.soak
def test_a_junction_comes_loose_again(tmp_path: Path) -> None:
    """Three who wait for each other: one merges before the ego, which stands and has the right of way."""
    found = drive(tmp_path, "Town07", seed=4, duration_s=250.0)
    assert found.is_sound
    assert found.summary.driven_m > 740.0
