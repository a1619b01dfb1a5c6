"""What cameras must have seen before a stretch: how far it reaches back, and that it is told."""

import logging
from itertools import pairwise
from pathlib import Path

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.rigs.presets import rig_by_name
from recorder.replaying.camera_history import nearest_begin_ns, past_s
from recorder.replaying.options import without_unwritten
from recorder.replaying.replay import replay

S = 1_000_000_000


def cameras_ns(begin_s: float) -> tuple[int, int]:
    return round(begin_s * S), 60 * S


@pytest.mark.parametrize(
    ("begin_s", "seen_s", "better_s"),
    [(0.0, 0.0, None), (0.05, 0.05, 0.05), (3.0, 3.0, 0.05), (10.0, 10.0, 10.05), (10.05, 0.05, 10.05),
     (18.0, 8.0, 20.05)],
)  # fmt: skip
def test_event_pixels_reach_back_to_their_last_beginning(
    begin_s: float, seen_s: float, better_s: float | None
) -> None:
    """They begin anew every ten seconds, but the picture of that moment has events of before."""
    rig, cameras = rig_by_name("flu"), cameras_ns(begin_s)
    assert past_s(rig, cameras, cameras) == pytest.approx(seen_s)
    better_ns = nearest_begin_ns(rig, cameras)
    assert better_ns == (None if better_s is None else round(better_s * S))


def test_exposure_control_reaches_back_and_plain_cameras_do_not() -> None:
    def without_events(name: str) -> float:
        rig = without_unwritten(rig_by_name(name), ("euroc",), "standard")
        return past_s(rig, cameras_ns(13.0), cameras_ns(13.0))

    assert without_events("flu") == 0.0
    assert without_events("real") == pytest.approx(3.0)  # It begins anew every five seconds.


def test_the_past_is_told_and_counted(
    straight_drive: StraightDrive, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A tenth of a second from 1 s on: what is seen before is most of the work."""
    need_opengl()
    told: list[tuple[float, float]] = []
    config = straight_drive.config(
        tmp_path / "data", rig=str(straight_drive.rig), formats=("raw",), start_s=1.0, duration_s=0.1,
        preview=False,
    )  # fmt: skip
    with caplog.at_level(logging.WARNING):
        replay(config, lambda done_s, total_s: told.append((done_s, total_s)))
    assert "must see the 1.00 s before" in caplog.text
    done_s, totals_s = zip(*told, strict=True)
    assert list(totals_s) == pytest.approx([1.0 + 0.1 + 0.01] * len(told))
    assert all(0.0 <= after - before < 0.11 for before, after in pairwise((0.0, *done_s)))
