"""Share of movers: counted over labelled samples, written with a sequence, shown by `carlaloc info`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import cloud_of

from carlaloc_env.samples import PointCloud, SemanticImage
from carlaloc_env.scene.mesh import EGO_INSTANCE
from recorder.cli.main import main
from recorder.replaying.sample_counts import SampleCounts

SEQUENCE = """\
name: ClearNoon_dynamic
weather: {name: ClearNoon}
traffic: {name: dynamic}
rig: paper
epoch_ns: 1672531200000000000
samples: {imu: 200, lidar_semantic: 20}
movers: {lidar_semantic: 0.0521, semantic_left: 0.125}
"""


def cloud(instance: list[int] | None) -> PointCloud:
    """A sweep of four points."""
    return cloud_of(np.zeros((4, 3)), labelled=instance is not None, instance=instance or 0)


def test_points_and_pixels_on_traffic_are_counted() -> None:
    """Neither scenery, parked cars and the ego itself, nor clouds without labels."""
    share = SampleCounts()
    share.count(cloud([0, 17, EGO_INSTANCE, EGO_INSTANCE + 1]))
    share.count(cloud([EGO_INSTANCE + 3, EGO_INSTANCE + 1, 5, 5]))
    share.count(cloud(None))
    picture = np.full((2, 4), EGO_INSTANCE + 9, np.uint32)
    picture[0] = 3
    at: dict[str, Any] = {"sensor": "semantic_left", "frame_id": "camera_left", "stamp_ns": 0}
    share.count(SemanticImage(tag=np.zeros((2, 4), np.uint8), instance=picture, **at))
    assert share.shares() == {"lidar_semantic": pytest.approx(3 / 8), "semantic_left": pytest.approx(0.5)}


def test_info_shows_the_movers_of_a_sequence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sequence.yaml").write_text(SEQUENCE)
    assert main(["info", str(tmp_path)]) == 0
    assert "lidar_semantic 5.2 %, semantic_left 12.5 %" in capsys.readouterr().out
    assert main(["info", str(tmp_path / "sequence.yaml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["movers"]["semantic_left"] == 0.125


@pytest.mark.parametrize("text", [None, "- a list", "name: {", "name: x\n"])
def test_a_folder_without_a_whole_sequence_is_named(
    text: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is not None:
        (tmp_path / "sequence.yaml").write_text(text)
    assert main(["info", str(tmp_path)]) == 1
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    assert str(tmp_path) in error
