"""Units cover a stretch once, and no byte of a dataset depends on them, on workers or on their order."""

from pathlib import Path

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.clock import STEP_NS
from recorder.dataset.checksums import checksums
from recorder.dataset.layout import FORMATS
from recorder.episode.traffic_level import traffic_level
from recorder.replaying.recipe import units_of
from recorder.replaying.replay import replay

S = 1_000_000_000


@pytest.mark.parametrize("first_s", [0.0, 3.25, 9.95, 10.0, 10.05])
@pytest.mark.parametrize("end_s", [10.1, 30.0, 61.3])
@pytest.mark.parametrize("unit_s", [0.05, 1.0, 10.0, 600.0])
def test_units_cover_a_stretch_once(first_s: float, end_s: float, unit_s: float) -> None:
    levels = [traffic_level("static"), traffic_level("dynamic")]
    span = round(first_s * S), round(end_s * S)
    units = units_of(levels, span, round(unit_s * S))
    assert len({unit.name for unit in units}) == len(units)
    for level in levels:
        spans = [unit.span_ns for unit in units if unit.level == level]
        assert (spans[0][0], spans[-1][1]) == span
        assert [end for _, end in spans[:-1]] == [begin for begin, _ in spans[1:]]
        assert all(0 < end - begin <= unit_s * S + STEP_NS for begin, end in spans)
        # A picture right after the restart of an event camera is the first of its unit.
        assert all((begin - STEP_NS) % round(unit_s * S) == 0 for begin, _ in spans[1:])


LEFT_OUT = ("rosbag1_bz2", "rosbag2_sqlite3", "doppler_icp", "rinex")
"""Two that only pack differently, and two of sensors that few rigs have."""


def test_workers_and_cuts_change_no_byte(straight_drive: StraightDrive, tmp_path: Path) -> None:
    """All formats, two weathers, two levels; event cameras remember across the cuts."""
    need_opengl()

    def sums(name: str, unit_s: float, workers: int) -> dict[str, str]:
        config = straight_drive.config(
            tmp_path / name, rig=str(straight_drive.rig), unit_s=unit_s, workers=workers, topics="full",
            duration_s=0.2, weathers=("ClearNoon", "RainyNight"), traffic=("static", "dynamic"),
            formats=tuple(name for name in FORMATS if name not in LEFT_OUT),
        )  # fmt: skip
        replay(config)
        found = {path.name for path in (tmp_path / name).iterdir()}
        assert found == {"SHA256SUMS", "dataset.yaml", "straight"}
        return checksums(tmp_path / name)

    whole = sums("whole", 10.0, 1)
    wanted = {".bag", ".mcap", ".csv", ".png", ".bin", ".h5", ".mp4", ".jpg", ".ply"}
    assert {Path(name).suffix for name in whole} >= wanted
    assert sums("cut", 0.1, 2) == whole
