"""Rigs and formats of a replay."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.camera_config import CameraConfig, ShutterConfig
from carlaloc_env.weather.presets import weather_by_name
from recorder.dataset.layout import FORMATS, SequenceFolder
from recorder.dataset.manifest import SequenceDescription
from recorder.episode.traffic_level import traffic_level
from recorder.replaying import sequence_writers
from recorder.replaying.conditions import Condition
from recorder.replaying.options import snow_notes
from recorder.replaying.recipe import Recipe
from recorder.replaying.replay import ReplayConfig, rig_of


def cameras(config: ReplayConfig) -> list[CameraConfig]:
    return [sensor for sensor in rig_of(config).sensors if isinstance(sensor, CameraConfig)]


def test_a_rig_file_asks_for_drops_and_wind(tmp_path: Path) -> None:
    file = tmp_path / "wet.yaml"
    file.write_text(
        "name: wet\nsensors:\n  - {kind: camera, name: front, lens_drops: true, leaf_wind_mps: 5}\n"
    )
    (camera,) = cameras(ReplayConfig(episode=Path("a.mcap"), out=Path("out"), rig=str(file)))
    assert camera.lens_drops
    assert camera.leaf_wind_mps == 5.0


@pytest.mark.parametrize(
    ("weather", "seen", "notes"), [("ClearNoon", False, 0), ("WinterNoon", False, 1), ("SnowyNoon", True, 0)]
)
def test_a_note_names_lidars_that_see_no_snow(weather: str, seen: bool, notes: int) -> None:
    config = ReplayConfig(
        episode=Path("a.mcap"),
        out=Path("out"),
        rig="lidar",
        weathers=("HardRainNoon", weather),
        lidar_weather=seen,
    )
    found = snow_notes(config)
    assert len(found) == notes
    assert all("lidar in snow equal those of ClearNoon; add --lidar-weather" in note for note in found)


def test_a_sequence_states_the_read_out_of_rolling_shutters(tmp_path: Path) -> None:
    rig = rig_by_name("real")
    left, right = rig.of_kind("camera")[:2]
    rolling = replace(left, shutter=ShutterConfig(readout_ms=12.5))
    condition = Condition(
        weather_name="ClearNoon", weather=weather_by_name("ClearNoon"), traffic=traffic_level("static")
    )
    for sensors, stated in (((left, right), None), ((rolling, right), {left.name: 12.5})):
        described = sequence_writers.describe(
            condition, rig=replace(rig, sensors=sensors), samples={}, movers={}
        )
        folder = SequenceFolder(tmp_path)
        folder.description.write_text(described.to_yaml())
        assert yaml.safe_load(folder.description.read_text()).get("readout_ms") == stated
        assert SequenceDescription.read(folder).readout_ms == (stated or {})


def test_every_named_format_has_its_writer() -> None:
    """Names stand apart from writers, so that a wrong one is reported before these are imported."""
    for name in FORMATS:
        if name in ("doppler_icp", "rinex"):
            continue  # They need sensors of their own, and have tests of their own.
        recipe = Recipe(
            episode=Path(), town=Path(), conditions=(), rig=rig_by_name("dsec"), camera_ns=(0, 0), seed=0,
            quality="low", formats=(name,), topics="standard", truth_tf=False, clock=False, preview=False,
        )  # fmt: skip
        outputs = sequence_writers.outputs_of(recipe, ("rgb_left", "events_left"))
        assert outputs, name
        assert len({type(output.encoder) for output in outputs}) == 1
