"""Traffic levels end to end: what sensors see of vehicles when a drive is replayed at each level."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from shared_fixtures.worlds.small_towns import KERBSIDE, straight_road

from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS, Tag
from recorder.drive.record import RecordConfig, record
from recorder.replaying.replay import ReplayConfig, replay

VEHICLES = (10, 11, 13, 15, 18, 252, 253, 255, 257, 258)
"""SemanticKITTI's labels of vehicles, standing and moving."""
RIG = """\
name: small
sensors:
- {kind: lidar, name: lidar, columns: 400, mount: {position_m: [0.3, 0.0, 1.8]}, outputs: [cloud, semantic]}
- kind: camera
  name: left
  rate_hz: 10
  mount: {position_m: [2.6, 0.0, 1.6], axes: optical}
  pinhole: {width_px: 160, height_px: 90, fx_px: 80, fy_px: 80, cx_px: 80, cy_px: 45}
  outputs: [semantic]
"""
PARKED_OR_DRIVEN = [int(tag) for tag in DYNAMIC_TAGS if tag not in (Tag.PEDESTRIAN, Tag.RIDER)]
"""CARLA's tags of vehicles."""


@pytest.fixture(scope="module")
def sequences(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Four tenths of a second in a street with cars in its parking lanes, replayed at three levels."""
    for needed in ("pybullet", "open3d", "moderngl"):
        pytest.importorskip(needed, reason=f"{needed} is not installed")
    folder = tmp_path_factory.mktemp("levels")
    road = straight_road(1, (-150.0, 0.0, 0.0), 300.0, ((0.0, 0.0, 0.0, 0.0, 0.0),), KERBSIDE)
    town, rig = folder / "kerbside.xodr", folder / "rig.yaml"
    town.write_text(
        '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="7" name="k"/>' + road + "</OpenDRIVE>"
    )
    town.with_name("town.toml").write_text('[town]\nname = "kerbside"\ndefault_zone = "downtown"\n')
    rig.write_text(RIG)
    drive = folder / "drive.mcap"
    traffic = "dynamic,vehicles=8,walkers=0"
    record(RecordConfig(map=str(town), out=drive, duration_s=0.4, seed=5, traffic=traffic))
    config = ReplayConfig(
        episode=drive, out=folder / "data", map=town, traffic=("dynamic", "static", "empty"), rig=str(rig),
        formats=("kitti", "rosbag1"), topics="standard", preview=False, workers=1,
    )  # fmt: skip
    result = replay(config)
    return {path.name.split("_")[1]: path for path in result.sequences}


def movers(folder: Path, stream: str = "lidar_semantic") -> float:
    """Share of points or pixels on movers, as the sequence tells it."""
    shares = yaml.safe_load((folder / "sequence.yaml").read_text())["movers"]
    return float(shares[stream])


def vehicle_pixels(folder: Path) -> tuple[int, int]:
    """Number of pixels on vehicles, and of all pixels."""
    with AnyReader([folder / f"{folder.name}.bag"]) as bag:
        wanted = [c for c in bag.connections if c.topic == "/camera/left/semantic"]
        tags = [bag.deserialize(raw, c.msgtype).data for c, _, raw in bag.messages(wanted)]
    found = np.concatenate(tags)
    return int(np.isin(found, PARKED_OR_DRIVEN).sum()), len(found)


def vehicle_points(folder: Path) -> tuple[int, int]:
    """Number of points on vehicles, and of all points."""
    labels = [np.fromfile(path, "<u4") & 0xFFFF for path in sorted(folder.rglob("*.label"))]
    found = np.concatenate(labels)
    return int(np.isin(found, VEHICLES).sum()), len(found)


def test_static_shows_parked_cars_and_empty_none(sequences: dict[str, Path]) -> None:
    seen = {level: vehicle_points(folder)[0] for level, folder in sequences.items()}
    assert seen["empty"] == 0
    assert 0 < seen["static"] < seen["dynamic"]


def test_cameras_see_the_same_levels(sequences: dict[str, Path]) -> None:
    seen = {level: vehicle_pixels(folder) for level, folder in sequences.items()}
    assert seen["empty"][0] == 0
    assert 0 < seen["static"][0] <= seen["dynamic"][0]
    assert movers(sequences["static"], "semantic_left") == movers(sequences["empty"], "semantic_left") == 0.0
    assert movers(sequences["dynamic"], "semantic_left") <= seen["dynamic"][0] / seen["dynamic"][1]


def test_movers_are_what_dynamic_has_beyond_static(sequences: dict[str, Path]) -> None:
    """Traffic alone counts: nothing at the other two levels."""
    assert movers(sequences["static"]) == 0.0
    assert movers(sequences["empty"]) == 0.0
    vehicles, points = vehicle_points(sequences["dynamic"])
    assert 0.0 < movers(sequences["dynamic"]) < vehicles / points
