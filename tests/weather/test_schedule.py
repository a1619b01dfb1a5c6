"""Weather that changes during a drive: what holds when, files, and pictures that follow."""

from pathlib import Path

import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.presets import PRESETS
from carlaloc_env.weather.schedule import WeatherSchedule, weather_of
from recorder.replaying.conditions import conditions_of

SECOND = 1_000_000_000
TEXT = """
- at_s: 10
  weather: ClearNoon
- at_s: 30
  weather: {fog_density: 62, cloudiness: 45}
- at_s: 40
  weather: RainyNight
"""


def test_fields_change_evenly_between_the_times() -> None:
    schedule = WeatherSchedule.from_yaml(TEXT)
    assert schedule.at(0) == schedule.at(10 * SECOND) == PRESETS["ClearNoon"]
    half = schedule.at(20 * SECOND)
    assert half.fog_density == pytest.approx((2.0 + 62.0) / 2)
    assert half.cloudiness == pytest.approx(25.0)
    assert schedule.at(25 * SECOND).fog_density == pytest.approx(2.0 + 0.75 * 60.0)
    assert schedule.at(40 * SECOND) == schedule.at(10**12) == PRESETS["RainyNight"]


def test_weather_holds_within_a_second() -> None:
    schedule = WeatherSchedule.from_yaml(TEXT)
    assert schedule.at(20 * SECOND) == schedule.at(21 * SECOND - 1) != schedule.at(21 * SECOND)


def test_a_constant_weather_is_the_same_at_all_times() -> None:
    weather = PRESETS["FoggyNoon"]
    assert weather.at(0) is weather.at(77 * SECOND) is weather


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- at_s: 5\n  weather: CleerNoon", "did you mean 'ClearNoon'"),
        ("- at_s: 5\n  weather: {fog_densty: 3}", "did you mean 'fog_density'"),
        ("- {at_s: 5, weather: ClearNoon}\n- {at_s: 5, weather: FoggyNoon}", "do not rise"),
        ("- {at: 5, weather: ClearNoon}", "expected a list of rows"),
        ("- {at_s: 5, weather: 7}", "give a preset's name"),
        ("[]", "at least one"),
        ("{", "not YAML"),
    ],
)
def test_wrong_files_name_the_fault(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        WeatherSchedule.from_yaml(text, where="storm.yaml")


def test_a_replay_takes_the_path_of_a_schedule(tmp_path: Path) -> None:
    path = tmp_path / "storm.yaml"
    path.write_text(TEXT, encoding="utf-8")
    (condition,) = conditions_of([str(path)], ["static"])
    assert condition.name == "storm_static"
    assert condition.weather.at(40 * SECOND) == PRESETS["RainyNight"]
    assert len(condition.weather.to_mapping()["schedule"]) == 3
    with pytest.raises(ConfigError, match=r"cannot read the weather schedule .*gone\.yaml"):
        weather_of(tmp_path / "gone.yaml")


def test_names_and_parameters_still_count_as_weather() -> None:
    assert weather_of("clearnoon") is PRESETS["ClearNoon"]
    own = WeatherParameters(fog_density=7.0)
    assert weather_of(own) is own
