"""The standard drives of datasets come to their ends as docs/factory.md says."""

from pathlib import Path

import pytest

from benchmarks.traffic_near_ego import drive
from recorder.factory import ROUTE_M, STANDARD_SEEDS, DatasetConfig
from recorder.replaying.plan import ReplayOptions

PACE_MPS = {
    "Town01": 5.5, "Town03": 7.0, "Town04": 16.0, "Town05": 7.0, "Town06": 8.0, "Town07": 6.0, "Town10": 4.2,
}  # fmt: skip
"""Least mean speed of each [m/s]; three of the towns are posted with 30 km/h."""


def test_each_town_of_the_paper_has_a_seed_and_one_seed_can_be_given_for_all(tmp_path: Path) -> None:
    replay = ReplayOptions()
    assert set(STANDARD_SEEDS) == set(ROUTE_M)
    standard = DatasetConfig(out=tmp_path, replay=replay)
    assert [standard.seed_of(town) for town in ROUTE_M] == list(STANDARD_SEEDS.values())
    assert standard.seed_of("a town of my own") == 0
    assert DatasetConfig(out=tmp_path, replay=replay, seed=5).seed_of("Town03") == 5


@pytest.mark.soak
@pytest.mark.parametrize("town", STANDARD_SEEDS)
def test_a_standard_drive_reaches_its_end_unharmed(town: str) -> None:
    found = drive(town, STANDARD_SEEDS[town])
    assert found.length_m > 0.98 * ROUTE_M[town]
    assert found.speed_mps > PACE_MPS[town]
    assert (found.collisions, found.violations) == (0, ())
