"""The seven drives of the paper's Table III by the scripted driver, among all the traffic of each town."""

from pathlib import Path

import pytest

from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.episode.summary import summarise

TABLE = {
    "Town01": (678.0, False),
    "Town03": (970.0, True),
    "Town04": (2108.0, True),
    "Town05": (473.0, False),
    "Town06": (266.0, False),
    "Town07": (747.0, False),
    "Town10": (1115.0, True),
}
"""Length of the ego's route [m], and whether it ends where it began."""


@pytest.mark.soak
@pytest.mark.parametrize("town", sorted(TABLE))
def test_drives_are_those_of_the_paper(town: str, tmp_path: Path) -> None:
    """Lengths within 1 %, loops closed within 5 m and 10°, nothing hit and no rule broken."""
    record(RecordConfig(map=town, out=tmp_path / "drive.mcap", seed=1))
    summary = summarise(Episode.load(tmp_path / "drive.mcap"))
    length_m, loop = TABLE[town]
    assert summary.driven_m == pytest.approx(length_m, rel=0.01)
    if loop:
        assert summary.closure_m < 5.0
        assert summary.closure_deg < 10.0
    assert summary.meets_table
    assert summary.collisions == 0
    assert summary.violations == {}
