"""Traffic levels end to end: what LiDARs see of vehicles when a drive is replayed at each level."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from shared_fixtures.small_towns import KERBSIDE, straight_road

from recorder.drive.record import RecordConfig, record
from recorder.generation.replay import ReplayConfig, replay

VEHICLES = (10, 11, 13, 15, 18, 252, 253, 255, 257, 258)
"""SemanticKITTI's labels of vehicles, standing and moving."""
RIG = """\
name: small
sensors:
- {kind: lidar, name: lidar, columns: 400, mount: {position_m: [0.3, 0.0, 1.8]}, outputs: [cloud, semantic]}
"""


@pytest.fixture(scope="module")
def sequences(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A second in a street with cars in its parking lanes, replayed at three levels."""
    for needed in ("pybullet", "open3d"):
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
    record(RecordConfig(map=str(town), out=drive, duration_s=1.0, seed=5, traffic=traffic))
    result = replay(
        ReplayConfig(
            episode=drive,
            out=folder / "data",
            map=town,
            traffic=("dynamic", "static", "empty"),
            rig=str(rig),
            formats=("kitti",),
            preview=False,
            workers=1,
        )
    )
    return {path.name.split("_")[1]: path for path in result.sequences}


def movers(folder: Path) -> float:
    """Share of points on movers, as the sequence tells it."""
    shares = yaml.safe_load((folder / "sequence.yaml").read_text())["movers"]
    return float(shares["lidar_semantic"])


def vehicle_points(folder: Path) -> tuple[int, int]:
    """Number of points on vehicles, and of all points."""
    labels = [np.fromfile(path, "<u4") & 0xFFFF for path in sorted(folder.rglob("*.label"))]
    found = np.concatenate(labels)
    return int(np.isin(found, VEHICLES).sum()), len(found)


def test_static_shows_parked_cars_and_empty_none(sequences: dict[str, Path]) -> None:
    seen = {level: vehicle_points(folder)[0] for level, folder in sequences.items()}
    assert seen["empty"] == 0
    assert 0 < seen["static"] < seen["dynamic"]


def test_movers_are_what_dynamic_has_beyond_static(sequences: dict[str, Path]) -> None:
    """Traffic alone counts: nothing at the other two levels."""
    assert movers(sequences["static"]) == 0.0
    assert movers(sequences["empty"]) == 0.0
    vehicles, points = vehicle_points(sequences["dynamic"])
    assert 0.0 < movers(sequences["dynamic"]) < vehicles / points
