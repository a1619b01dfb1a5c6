"""Options that a replay sets for all cameras of a rig."""

import argparse
from pathlib import Path

import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.cli.commands import replay as command
from recorder.dataset.layout import FORMATS
from recorder.replaying import sequence_writers
from recorder.replaying.conditions import Recipe
from recorder.replaying.replay import ReplayConfig, rig_of


def cameras(config: ReplayConfig) -> list[CameraConfig]:
    return [sensor for sensor in rig_of(config).sensors if isinstance(sensor, CameraConfig)]


def test_drops_and_wind_reach_every_camera_and_nothing_else() -> None:
    plain = ReplayConfig(episode=Path("a.mcap"), out=Path("out"))
    assert rig_of(plain) == rig_by_name("paper")
    changed = ReplayConfig(episode=Path("a.mcap"), out=Path("out"), lens_drops=True, leaf_wind_mps=8.0)
    assert {(c.lens_drops, c.leaf_wind_mps) for c in cameras(changed)} == {(True, 8.0)}
    others = [s for s in rig_of(changed).sensors if not isinstance(s, CameraConfig)]
    assert others == [s for s in rig_by_name("paper").sensors if not isinstance(s, CameraConfig)]
    with pytest.raises(ConfigError, match="leaf_wind_mps"):
        rig_of(ReplayConfig(episode=Path("a.mcap"), out=Path("out"), leaf_wind_mps=90.0))


def test_a_rig_file_may_ask_for_them_too(tmp_path: Path) -> None:
    file = tmp_path / "wet.yaml"
    file.write_text(
        "name: wet\nsensors:\n  - {kind: camera, name: front, lens_drops: true, leaf_wind_mps: 5}\n"
    )
    (camera,) = cameras(ReplayConfig(episode=Path("a.mcap"), out=Path("out"), rig=str(file)))
    assert camera.lens_drops
    assert camera.leaf_wind_mps == 5.0


def test_the_command_line_knows_them() -> None:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    arguments = parser.parse_args(["a.mcap", "--out", "out", "--lens-drops", "--leaf-wind", "6.5"])
    assert arguments.lens_drops
    assert arguments.leaf_wind == 6.5


def test_every_named_format_has_its_writer() -> None:
    """Names stand apart from writers, so that a wrong one is reported before these are imported."""
    for name in FORMATS:
        recipe = Recipe(
            episode=Path(), town=Path(), conditions=(), rig=rig_by_name("dsec"), camera_ns=(0, 0), seed=0,
            quality="low", formats=(name,), topics="standard", preview=False,
        )  # fmt: skip
        outputs = sequence_writers.outputs_of(recipe, ("rgb_left", "events_left"))
        assert outputs, name
        assert len({type(output.encoder) for output in outputs}) == 1
