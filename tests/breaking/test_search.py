"""The search finds a border that is known."""

import json
from pathlib import Path
from typing import Any

import pytest
from shared_fixtures.drives.straight_drives import RIG, StraightDrive

from carlaloc_env.core.errors import ConfigError
from recorder.cli.main import main
from recorder.laboratory.search_space import (
    Range,
    distance,
    ranges_of,
    setting_at,
)
from recorder.laboratory.sweep import Setting
from recorder.replaying.condition_file import ConditionFile

FRAGILE = """
import numpy as np
from recorder.evaluation.align import Alignment
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.system import System
SYSTEM = System(name="fragile", title="fragile", what="a test", needs=("lidar",),
                runner="x:run", frame="lidar", alignment=Alignment.NONE)
def run(sequence, clock):
    # It knows where it is, unless more than 40 % of its points are gone.
    truth, poses = read_tum(sequence.truth_file("lidar")), []
    for number, scan in enumerate(sequence.scans()):
        if len(scan.ring) < 0.6 * 32 * 200 * {returns}:
            raise RuntimeError("too few points")
        T = np.eye(4)
        T[:3, 3] = truth.position_m[10 * number]
        poses.append((scan.stamp_ns, T))
    return poses
"""


def test_distances_are_shares_of_ranges() -> None:
    fog = Range.parse("fog_visibility_m=2000:20:log")
    assert [fog.value(share) for share in (0.0, 0.5, 1.0)] == pytest.approx([2000.0, 200.0, 20.0])
    late = Range.parse("fault.lidar.time_offset_ms=0:200")
    assert late.value(0.25) == 50.0
    assert distance({"a": 0.3, "b": 0.4}) == pytest.approx(0.5)
    setting = setting_at(Setting(), (fog, late), {late.name: 0.25})
    assert (setting.weather, setting.faults.label) == ("ClearNoon", "lidar.time_offset_ms=50")
    assert setting_at(Setting(), (Range.parse("traffic=0:1"),), {}).traffic == "static"
    names = [one.name for one in ranges_of(("lidar", "imu"), weather=True)]
    assert {"traffic", "fog_visibility_m", "fault.lidar.drop_share", "fault.imu.gyro_bias_radps"} <= set(
        names
    )


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("traffic=0:4", "searched up to 1"),
        ("trafic=0:1", "did you mean 'traffic'"),
        ("traffic=0", "NAME=NEUTRAL:WORST"),
        ("fault.lidar.drop_share=0:0", "two finite values"),
    ],
)
def test_wrong_ranges_are_named(word: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Range.parse(word)


@pytest.mark.soak
def test_the_search_finds_the_border(
    straight_drive: StraightDrive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Points are lost at random: the system breaks where 40 % of them are, whatever the other quantities."""
    pytest.importorskip("optuna", reason="the search needs the extra `search`")
    rig, method = tmp_path / "rig.yaml", tmp_path / "fragile.py"
    rig.write_text(RIG.partition("- {kind: imu}")[0])
    method.write_text(FRAGILE.format(returns=0.7))
    words = [
        "break", str(method), str(straight_drive.episode), "--map", str(straight_drive.town),
        "--rig", str(rig), "--out", str(tmp_path / "out"), "--stretch", "1", "--stretches", "1",
        "--tries", "6", "--json",
        "--over", "fault.lidar.point_drop_share=0:0.99", "--over", "fault.lidar.time_jitter_ms=0:5",
    ]  # fmt: skip
    assert main(words) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    low, high = (found[name]["values"]["fault.lidar.point_drop_share"] for name in ("passes", "broken"))
    assert list(found["broken"]["values"]) == ["fault.lidar.point_drop_share"]
    assert 0.0 < high - low < 0.99 / 16
    condition = ConditionFile.read(tmp_path / "out" / "broken.yaml")
    assert condition.faults == {"lidar": {"point_drop_share": high}}
    assert {Path(file).suffix for file in found["files"]} == {".csv", ".yaml", ".bag", ".mp4"}
    benchmark = [
        "benchmark", str(straight_drive.episode), "--map", str(straight_drive.town), "--rig", str(rig),
        "--methods", str(method), "--out", str(tmp_path / "again"), "--clouds", "raw",
    ]  # fmt: skip
    assert main([*benchmark, "--condition", str(tmp_path / "out" / "broken.yaml")]) == 1
    assert main([*benchmark, "--condition", str(tmp_path / "out" / "passes.yaml")]) == 0
