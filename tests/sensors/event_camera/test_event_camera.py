"""The event output of a camera over a Timeline: memory, order of stamps, rates, stillness."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.envs.observer import Observer
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Events
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig, EventConfig
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.presets import PRESETS
from carlaloc_env.weather.schedule import WeatherSchedule

need_opengl()

STEP_NS = 50_000_000
QUIET = EventConfig(leak_hz=0.0, shot_hz=0.0)


def config(**changes: Any) -> CameraConfig:
    settings: dict[str, Any] = {
        "name": "left",
        "mount": Mount(position_m=(1.8, 0.2, 1.6), axes="optical"),
        "pinhole": Pinhole.from_fov(160, 90, 90.0),
        "outputs": ("events",),
        **changes,
    }
    return CameraConfig(**settings)


@pytest.fixture
def street(scenery: Any) -> Iterator[Any]:
    models = {
        "saloon": scenery.box([-2.3, -0.9, 0.1], [2.3, 0.9, 1.4]),
        **{f"signal_{c}": scenery.box([0, 0, 0], [0.1, 0.1, 0.1]) for c in ("red", "yellow", "green")},
        "ego": scenery.box([-0.95, -0.9, 0.2], [3.75, 0.9, 1.0]),
    }
    boxes = [scenery.box([x, y, 0], [x + 3, y + 2, 6]) for x in range(0, 80, 8) for y in (-9, 7)]
    world = scenery.world([scenery.ground(), *boxes], models, 3)
    yield world
    world.renderer().close()


def drive_of(scenery: Any, path: Any, seconds: float = 1.0) -> Timeline:
    def frame_at(t: float) -> Any:
        return scenery.frame([[14 + 9 * t, 3.0, 0]], [0.1], 9.0)

    timeline: Timeline = scenery.drive(path, seconds, scenery.catalog(["saloon"]), frame_at)
    return timeline


def batches(samples: list[Any]) -> dict[int, bytes]:
    return {sample.stamp_ns: sample.events.tobytes() for sample in samples}


def test_any_order_and_any_chunk_gives_the_same_bytes(street: Any, scenery: Any) -> None:
    """Forwards, backwards, from the middle with a fresh sensor, and twice the same."""
    drive = drive_of(scenery, scenery.weaving)
    camera = config(events=EventConfig(restart_s=0.3, shot_hz=2.0))
    stamps = range(0, 14 * STEP_NS, STEP_NS)
    forwards = batches(camera.build(street).measure(drive, list(stamps)))
    backwards: dict[int, bytes] = {}
    sensor = camera.build(street)
    for stamp in reversed(stamps):
        backwards |= batches(sensor.measure(drive, [stamp]))
    assert backwards == forwards
    chunk = batches(camera.build(street).measure(drive, list(stamps)[8:11]))
    assert chunk == {stamp: forwards[stamp] for stamp in list(stamps)[8:11]}
    again = camera.build(street)
    assert batches(again.measure(drive, [300_000_000])) == batches(again.measure(drive, [300_000_000]))
    assert len(forwards[0]) == 0
    assert all(len(forwards[stamp]) > 0 for stamp in stamps[1:])


def test_the_past_can_be_gone_over_picture_by_picture(street: Any, scenery: Any) -> None:
    """Its pictures are told one by one, and are not drawn again; the events are those of a whole drive."""
    drive = drive_of(scenery, scenery.weaving)
    camera, stamp = config(events=EventConfig(restart_s=0.3, shot_hz=2.0)), 600_000_000
    stamps = range(0, stamp + 1, STEP_NS)
    whole = batches(camera.build(street).measure(drive, list(stamps)))
    sensor, drawn = camera.build(street), list[int]()
    draw = street.renderer().draw

    def counted(*args: Any, **named: Any) -> Any:
        drawn.append(named["stamp_ns"])
        return draw(*args, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(street.renderer(), "draw", counted)
        assert list(sensor.recall(drive, stamp, [street.weather])) == list(range(300_000_000, stamp, STEP_NS))
        assert list(sensor.recall(drive, stamp, [street.weather])) == []
        assert batches(sensor.measure(drive, [stamp])) == {stamp: whole[stamp]}
    assert drawn == list(range(300_000_000, stamp + 1, STEP_NS))


def test_weathers_together_equal_weathers_alone(street: Any, scenery: Any) -> None:
    drive = drive_of(scenery, scenery.straight(8.0))
    weathers = [PRESETS["ClearNoon"], PRESETS["RainyNight"]]
    together = config().build(street)
    both = [together.measure_conditions(drive, t, weathers) for t in (0, STEP_NS, 2 * STEP_NS)]
    for row, weather in enumerate(weathers):
        alone = config().build(street)
        for t, pair in zip((0, STEP_NS, 2 * STEP_NS), both, strict=True):
            (samples,) = alone.measure_conditions(drive, t, [weather])
            np.testing.assert_array_equal(samples[0].events, pair[row][0].events)  # type: ignore[attr-defined]
    assert len(both[2][0][0].events) != len(both[2][1][0].events)  # type: ignore[attr-defined]


def test_a_changing_weather_is_remembered_too(street: Any, scenery: Any) -> None:
    drive = drive_of(scenery, scenery.straight(8.0), 1.4)
    street.weather = WeatherSchedule(at_s=(0.0, 2.0), weathers=(PRESETS["ClearNoon"], PRESETS["FoggyNoon"]))
    stamps = [950_000_000, 1_000_000_000, 1_050_000_000]
    one, sensor = config().build(street), config().build(street)
    forwards = batches(one.measure(drive, stamps))
    for stamp in stamps[::-1]:
        assert batches(sensor.measure(drive, [stamp]))[stamp] == forwards[stamp]


def test_stream_sits_in_the_observation(street: Any, scenery: Any) -> None:
    rig = SensorRig(sensors=(config(outputs=("rgb", "events")),)).build(street)
    samples = rig.measure(drive_of(scenery, scenery.straight(10.0)), -1, 2 * STEP_NS)
    assert [s.sensor for s in samples] == ["rgb_left", "events_left"] * 3
    observer = Observer(rig)
    observer.add(samples)
    seen = observer.newest()
    assert observer.space.contains(seen)
    last = samples[-1]
    assert isinstance(last, Events)
    assert seen["events_left"].shape == (90, 160, 2)
    assert seen["events_left"].sum() == len(last.events)
    assert last.events["t"].min() > STEP_NS
    assert last.events["t"].max() <= 2 * STEP_NS


def test_standing_still_there_is_noise_only(street: Any, scenery: Any) -> None:
    timeline = scenery.drive(scenery.straight(0.0), 0.3)
    silent = config(events=QUIET).build(street)
    assert [len(s.events) for s in silent.measure(timeline, [0, STEP_NS, 2 * STEP_NS])] == [0, 0, 0]  # type: ignore[attr-defined]
    noisy = config(events=EventConfig(leak_hz=0.0, shot_hz=5.0)).build(street)
    counts = [len(s.events) for s in noisy.measure(timeline, [0, *range(STEP_NS, 6 * STEP_NS, STEP_NS)])]  # type: ignore[attr-defined]
    expected = 5.0 * 0.25 * 160 * 90
    assert abs(sum(counts) - expected) < 5 * np.sqrt(expected)


def test_left_and_right_have_thresholds_of_their_own(street: Any, scenery: Any) -> None:
    drive = drive_of(scenery, scenery.straight(10.0))
    one, two = (
        config(name=name, events=QUIET).build(street).measure(drive, [0, STEP_NS])[1] for name in ("a", "b")
    )
    assert not np.array_equal(one.events, two.events)  # type: ignore[attr-defined]
    assert len(one.events) == pytest.approx(len(two.events), rel=0.2)  # type: ignore[attr-defined]
