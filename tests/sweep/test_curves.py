"""Axes, intervals and areas against closed forms and tables."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.weather.presets import changed_weather, weather_word
from recorder.benchmark.score import Score
from recorder.evaluation.confidence import mean_interval
from recorder.laboratory.sweep import Axis, Point, Setting
from recorder.laboratory.sweep_curves import areas_of, curves_of
from recorder.laboratory.sweep_run import row_of


def test_axes_are_even_in_value_or_logarithm() -> None:
    assert Axis.parse("fault.lidar.time_offset_ms=0:100:6").values == (0, 20, 40, 60, 80, 100)
    assert Axis.parse("traffic=1,0,0.5").values == (0, 0.5, 1)
    fog = Axis.parse("fog_visibility_m=20:500:log8")
    assert fog.is_log
    assert np.ptp(np.diff(np.log(fog.values))) < 1e-4
    assert (len(fog.values), fog.values[0], fog.values[-1]) == (8, 20, 500)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("trafic=0:1:3", "did you mean 'traffic'"),
        ("fault.lidar.time_ofset_ms=0:1:3", "did you mean 'time_offset_ms'"),
        ("fog_visibilty_m=20:500:3", "did you mean 'fog_visibility_m'"),
        ("fog_visibility_m=1:500:3", "fog_visibility_m = 1"),
        ("traffic=0:1", "NAME=FROM:TO:COUNT"),
        ("traffic=0:1:log3", "NAME=FROM:TO:COUNT"),
        ("traffic=-1,0", "factor of 0 or more"),
    ],
)
def test_wrong_axes_are_named(word: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Axis.parse(word)


@pytest.mark.parametrize("visibility_m", [20.0, 79.0, 500.0])
def test_fog_has_the_visibility_that_was_asked_for(visibility_m: float) -> None:
    """Where 5 % of the contrast is left, by Koschmieder's law."""
    weather = changed_weather(f"ClearNoon:fog_visibility_m={visibility_m}")
    assert math.exp(-weather.extinction_per_m * visibility_m) == pytest.approx(0.05, rel=1e-9)
    assert changed_weather("RainyNight:rain_mmph=25").rain_mmph == pytest.approx(25.0)
    assert weather_word("ClearNoon:fog_visibility_m=79.5") == "ClearNoon_fog_visibility_m-79.5"


def test_neutral_values_change_no_setting() -> None:
    base = Setting()
    assert base.changed("traffic", 1.0) == base
    assert base.changed("fault.lidar.time_offset_ms", 0.0) == base
    assert base.changed("fog_density", 2.0).weather == base.weather


def test_intervals_of_means_are_those_of_the_books() -> None:
    values = [1.0, 2.0, 3.0, 4.0, 5.0]
    found = mean_interval(values)
    half = 2.776445 * math.sqrt(2.5 / 5)  # Student's t of four degrees of freedom, 97.5 %
    assert (found.value, found.low, found.high) == pytest.approx((3.0, 3.0 - half, 3.0 + half), rel=1e-6)
    assert np.isnan(mean_interval([2.0]).low)


def runs(axis: str, values: list[float], **others: float) -> pd.DataFrame:
    """Errors that grow with the value; all fail at the last one."""
    about: dict[str, Any] = {"town": "T", "weather": "W", "cloud": "raw", "run": 1, "version": "1"}
    rows = []
    for value in values:
        score = Score(
            **about, dataset="d", traffic="dynamic", method="a", title="A", ape_m=2.0 * value, rpe_m=0.1,
            coverage=1.0, failed="diverged" if value == values[-1] else None,
        )  # fmt: skip
        for seed in range(3):
            place = (*others.items(), (axis, value))
            point = Point(values=place, setting=Setting(), drive=Path("d.mcap"), number=seed)
            rows.append(row_of(point, score, "A"))
    return pd.DataFrame(rows)


def test_areas_under_straight_lines() -> None:
    axis = Axis.parse("traffic=0:4:5")
    curves = curves_of(runs("traffic", list(axis.values)), [axis])
    assert curves["failed"].tolist() == [0, 0, 0, 0, 3]
    assert curves["ape_m"].tolist()[:4] == [0, 2, 4, 6]
    assert math.isnan(curves["ape_m"].iloc[-1])
    (row,) = areas_of(curves, [axis]).itertuples()
    assert row.success == pytest.approx(3.5 / 4)  # one until 3, then down to nothing at 4
    assert row.ape_m == pytest.approx(3.0)
    log = Axis.parse("rain_mmph=0.5:50:log3")
    (row,) = areas_of(curves_of(runs("rain_mmph", [0.5, 5.0, 50.0]), [log]), [log]).itertuples()
    assert row.success == pytest.approx(0.75)


def test_a_product_has_a_curve_for_each_value_of_the_others() -> None:
    both = pd.concat([runs("traffic", [0.0, 1.0], rain_mmph=rain) for rain in (0.0, 9.0)])
    curves = curves_of(both, [Axis.parse("traffic=0,1"), Axis.parse("rain_mmph=0,9")])
    assert set(curves["series"]) == {"A rain_mmph=0", "A rain_mmph=9", "A traffic=0", "A traffic=1"}


def test_axes_swept_alone_do_not_mix() -> None:
    """Rows of one axis have no value of the others."""
    axes = [Axis.parse("traffic=0,1"), Axis.parse("rain_mmph=0,9")]
    curves = curves_of(pd.concat([runs("traffic", [0.0, 1.0]), runs("rain_mmph", [0.0, 9.0])]), axes)
    assert curves[["axis", "series", "runs"]].to_numpy().tolist() == [
        ["traffic", "A", 3], ["traffic", "A", 3], ["rain_mmph", "A", 3], ["rain_mmph", "A", 3],
    ]  # fmt: skip
