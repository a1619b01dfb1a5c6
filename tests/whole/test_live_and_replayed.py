"""Samples of a replay are those of the live drive, byte for byte."""

from pathlib import Path

import pytest
from shared_fixtures.drives.drives import small_cameras

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import RenderError
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.rigs.presets import flu_rig
from carlaloc_env.samples import Sample
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.traffic_config import traffic_of_town
from carlaloc_env.weather.presets import weather_by_name
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode


def test_live_samples_equal_replayed_samples(straight_map: Path, tmp_path: Path) -> None:
    """The samples of a live drive are, byte for byte, those of its episode's replay."""
    town, traffic = load_town(straight_map), "dynamic,vehicles=5,walkers=0"
    rig = small_cameras(flu_rig())
    stage = SensorStage(town, seed=7, weather=weather_by_name("ClearNoon"))
    built = rig.build(stage)
    world = DrivingWorld(town, traffic_of_town(town, traffic, 7))
    world.reset(7)
    live: list[Sample] = []
    try:
        for step in range(12):
            before = world.now_ns
            for _ in range(10):
                world.tick(Controls(throttle=0.5, steer=0.05))
            live += built.measure(world.timeline, before if step else -1, world.now_ns)
            world.forget_before(world.now_ns - 2 * STEP_NS)
    except RenderError as error:
        pytest.skip(str(error))
    path = tmp_path / "same.mcap"

    class Driver:
        name = "test"

        def read(self, view: object) -> Controls:
            return Controls(throttle=0.5, steer=0.05)

        def close(self) -> None:
            pass

    record(
        RecordConfig(map=str(straight_map), out=path, duration_s=0.6, seed=7, traffic=traffic),
        device=Driver(),
    )
    replayed = built.measure(Episode.load(path).timeline(), -1, world.now_ns)

    def by_stamp(samples: list[Sample]) -> dict[tuple[int, str], Sample]:
        # A live sweep comes when it is complete, after the IMU samples taken meanwhile.
        return {(sample.stamp_ns, sample.sensor): sample for sample in samples}

    assert len(live) == len(replayed) > 150
    assert by_stamp(live) == by_stamp(replayed)
    stage.close()
    world.close()
