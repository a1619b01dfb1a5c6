"""What files of others say never leads out of a folder."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from carlaloc_env.core.errors import CarlaLocError, ConfigError, OutputError, check_name, is_name
from carlaloc_env.core.files.output_paths import path_below
from carlaloc_env.map.sources import identify_town
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.weather.presets import weather_by_name
from recorder.episode.traffic_level import traffic_level
from recorder.replaying.conditions import Condition

HOSTILE = ["../up", "/etc/x", "a/b", "a\\b", "..", ".", "", "a\0b", "a\nb", "ü", " a", "x" * 101, "~", "a:b"]


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_are_refused_where_they_enter(name: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="letters, digits"):
        check_name("sensor", name)
    for kind in ("camera", "lidar", "imu", "gnss", "radar", "speed", "wheels"):
        text = f"name: r\nsensors:\n- kind: {kind}\n  name: {name!r}\n" if "\0" not in name else None
        if text is not None:
            with pytest.raises(CarlaLocError):
                SensorRig.from_yaml(text)
    with pytest.raises(ConfigError):
        SensorRig(name=name)
    with pytest.raises(ConfigError):
        Condition(weather_name=name, weather=weather_by_name("ClearNoon"), traffic=traffic_level("static"))
    if "/" not in name and "\0" not in name and len(name) < 200 and name not in ("", ".", ".."):
        file = tmp_path / f"{name}.xodr"
        file.write_text("<OpenDRIVE/>")
        # A file may be called anything; the town is not.
        assert is_name(identify_town(file).name)


@given(st.text(max_size=12))
def test_whatever_passes_stays_in_the_folder(text: str) -> None:
    """The rule of names is enough: joined to any folder, a name is a child of it."""
    if is_name(text):
        folder = Path("/some/where")
        assert (folder / text).resolve().parent == folder
        assert path_below(folder, text) == folder / text


def test_paths_stay_below(tmp_path: Path) -> None:
    """Neither dots nor absolute paths nor links lead out; folders below may."""
    outside = tmp_path / "outside"
    inside = tmp_path / "inside"
    outside.mkdir()
    inside.mkdir()
    (inside / "link").symlink_to(outside)
    for name in ("../outside", "link/x", str(outside), "a/../../outside", ""):
        with pytest.raises(OutputError, match="leads out"):
            path_below(inside, name)
    assert path_below(inside, "link", link=True) == inside / "link"
    for name in ("..", "link/x", "link/.."):
        with pytest.raises(OutputError, match="leads out"):
            path_below(inside, name, link=True)
    assert path_below(inside, "kalibr/imu.yaml") == inside / "kalibr/imu.yaml"
