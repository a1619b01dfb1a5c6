"""Events of falling snow: of one flake in closed form, and of a snowfall before a camera that stands."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig, EventConfig
from carlaloc_env.sensors.event_camera.flakes import Flakes, flake_events
from carlaloc_env.sensors.event_camera.pixels import Thresholds
from carlaloc_env.sensors.imaging.frame import Optics
from carlaloc_env.weather.parameters import WeatherParameters

PINHOLE = Pinhole(width_px=64, height_px=32, fx_px=100.0, fy_px=100.0, cx_px=32.0, cy_px=16.0)
SPAN_US = 50_000


def of_one(shine: float, *, depth_m: float = 0.0, hops_m: float = 0.4) -> Any:
    """Events of a flake of 30 mm that flies 0.4 m to the right, 2 m before a wall of 100 cd/m²."""
    shape = (32, 64)
    eye = SimpleNamespace(
        poses=SimpleNamespace(T_world_camera=np.eye(4)), depth_m=np.full(shape, depth_m, np.float32)
    )
    flake = Flakes(
        begin_m=np.array([[-0.2, 0.0, 2.0]]), end_m=np.array([[-0.2 + hops_m, 0.0, 2.0]]),
        diameter_m=np.array([0.03]), light_cd_m2=np.full((1, 3), shine),
    )  # fmt: skip
    thresholds = Thresholds(on=np.full(shape, 0.3, np.float32), off=np.full(shape, 0.3, np.float32))
    ends: Any = (eye, eye)
    return flake_events(
        flake, ends, np.full(shape, math.log(100.0), np.float32), thresholds, Optics(PINHOLE, Lens()),
        dark_cd_m2=0.0, start_ns=0, span_us=SPAN_US, refractory_us=100,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("shine", "steps", "first"), [(200.0, 2, 1), (400.0, 4, 1), (60.0, 1, 0), (120.0, 0, 1)]
)
def test_a_flake_fires_its_contrast_and_takes_it_back(shine: float, steps: int, first: int) -> None:
    """|ln(L/100)| / 0.3 events where it enters, as many of the other sign where it leaves, 1.5 px later."""
    events = of_one(shine)
    row = events[(events["y"] == 16) & (events["x"] == 32)]
    assert row["p"].tolist() == [first] * steps + [1 - first] * steps
    if steps:
        # 20 px in 50 ms, from column 22 on.
        middle_us = SPAN_US * (32 - 22) / 20
        assert row["t"][0] / 1e3 == pytest.approx(middle_us - SPAN_US * 0.75 / 20, abs=2.0)
        assert row["t"][steps] / 1e3 == pytest.approx(middle_us + SPAN_US * 0.75 / 20, abs=2.0)
        assert set(events["y"].tolist()) == {16}
        assert set(range(23, 42)) <= set(events["x"].tolist())
        assert np.all(np.diff(events["t"]) >= 0)


def test_a_flake_behind_a_wall_and_one_that_floats_fire_nothing() -> None:
    assert len(of_one(400.0, depth_m=1.0)) == 0
    assert len(of_one(400.0, depth_m=3.0)) > 0
    assert len(of_one(400.0, hops_m=0.0)) == 0


def test_snow_fires_before_a_standing_camera_and_rain_does_not(scenery: Any) -> None:
    """Equally many of both signs; the same bytes in any order."""
    need_opengl()
    models = {name: scenery.box([0, 0, 0], [0.1, 0.1, 0.1]) for name in
              ("ego", "signal_red", "signal_yellow", "signal_green")}  # fmt: skip
    world = scenery.world([scenery.ground(), scenery.box([30, -30, 0], [31, 30, 20])], models)
    drive = scenery.drive(scenery.straight(), 0.4)
    config = CameraConfig(
        name="left", mount=Mount(position_m=(1.8, 0.2, 1.6), axes="optical"),
        pinhole=Pinhole.from_fov(320, 180, 90.0), outputs=("events",),
        events=EventConfig(leak_hz=0.0, shot_hz=0.0, threshold_on=0.1, threshold_off=0.1),
    )  # fmt: skip
    snow = WeatherParameters(snowfall=2.5, cloudiness=100.0)
    rain = WeatherParameters(precipitation=50.0, cloudiness=100.0)
    stamps = [k * 50_000_000 for k in range(5)]
    sensor = config.build(world)
    rows: list[Any] = []
    for t in stamps:
        pair: Any = sensor.measure_conditions(drive, t, [snow, rain])
        rows.append([samples[0].events for samples in pair])
    falling = np.concatenate([pair[0] for pair in rows])
    assert sum(len(pair[1]) for pair in rows) < 10
    assert len(falling) > 500
    assert np.mean(falling["p"]) == pytest.approx(0.5, abs=0.05)
    again = config.build(world)
    for t, pair in list(zip(stamps, rows, strict=True))[::-1]:
        found: Any = again.measure_conditions(drive, t, [snow])[0][0]
        assert found.events.tobytes() == pair[0].tobytes()
    world.renderer().close()
