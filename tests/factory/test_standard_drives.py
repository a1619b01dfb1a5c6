"""The standard drives of datasets come to their ends as docs/factory.md says."""

from pathlib import Path

import pytest

from recorder.drive.standard_drives import (
    ROUTE_M,
    STANDARD_SEEDS,
    record_drive,
)
from recorder.episode.episode import Episode
from recorder.episode.summary import summarise
from recorder.factory import DatasetConfig
from recorder.replaying.options import ReplayOptions


def test_each_town_of_the_paper_has_a_seed_and_one_seed_can_be_given_for_all(tmp_path: Path) -> None:
    replay = ReplayOptions()
    assert set(STANDARD_SEEDS) == set(ROUTE_M)
    standard = DatasetConfig(out=tmp_path, replay=replay)
    assert [standard.seed_of(town) for town in ROUTE_M] == list(STANDARD_SEEDS.values())
    assert standard.seed_of("a town of my own") == 0
    assert DatasetConfig(out=tmp_path, replay=replay, seed=5).seed_of("Town03") == 5


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_standard_drives_reach_their_ends_unharmed(tmp_path: Path) -> None:
    """They stand as cars in towns do."""
    drives = []
    for town in ROUTE_M:
        record_drive(town, tmp_path / f"{town}.mcap", seed=STANDARD_SEEDS[town])
        drives.append(summarise(Episode.load(tmp_path / f"{town}.mcap")))
        assert drives[-1].driven_m > 0.98 * ROUTE_M[town]
        assert (drives[-1].collisions, drives[-1].violations) == (0, {})
    whole_s = sum(one.duration_s for one in drives)
    standing = sum(one.standing * one.duration_s for one in drives) / whole_s
    assert 0.18 < standing < 0.35
    assert max(one.standing for one in drives) < 0.45
