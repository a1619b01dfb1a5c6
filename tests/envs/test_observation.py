"""Observations: always inside the space, newest last, padded and counted."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.envs.observer import Observer, values_of
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import PointCloud, Sample
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.vehicle import SpeedConfig

pytest.importorskip("open3d", reason="open3d is not installed")
STEP = 50_000_000


def setup(scenery: Any) -> tuple[Any, Observer, Any]:
    config = SensorRig(
        sensors=(
            ImuConfig(),
            LidarConfig(columns=64, mount=Mount(position_m=(1, 0, 2))),
            GnssConfig(),
            SpeedConfig(),
        )
    )
    rig = config.build(scenery.world([scenery.ground(), scenery.box([15, -5, 0], [16, 5, 9], instance=9)]))
    return rig, Observer(rig), scenery.drive(scenery.weaving, 1.0)


def observed(observer: Observer, samples: list[Sample]) -> dict[str, NDArray[Any]]:
    """The observation after these samples."""
    observer.add(samples)
    return observer.newest()


def test_every_observation_lies_in_the_space(scenery: Any) -> None:
    """From the empty start on; dtypes exact; the space keeps its keys and shapes."""
    rig, observer, drive = setup(scenery)
    assert observer.space.contains(observed(observer, []))
    for k in range(10):
        seen = observed(observer, rig.measure(drive, k * STEP, (k + 1) * STEP))
        assert observer.space.contains(seen)
    shapes = {key: (space.shape, space.dtype) for key, space in observer.space.items()}
    assert shapes["imu"] == ((10, 6), np.float32)
    assert shapes["lidar"] == ((2048, 4), np.float32)
    assert shapes["lidar_semantic"] == ((2048, 6), np.float32)
    assert shapes["lidar_count"] == ((1,), np.int32)
    assert shapes["gnss"] == ((4,), np.float64)
    assert shapes["speed"] == ((1,), np.float32)
    assert all(
        np.isfinite(space.low).all() and np.isfinite(space.high).all() for space in observer.space.values()
    )


def test_imu_batch_is_the_last_ten_readings(scenery: Any) -> None:
    rig, observer, drive = setup(scenery)
    seen = observed(observer, rig.measure(drive, -1, 0))["imu"]
    assert np.array_equal(seen[:9], np.zeros((9, 6))), "what is yet to come is zero"
    samples = rig.measure(drive, 0, STEP)
    batch = [values_of(s) for s in samples if s.sensor == "imu"]
    assert len(batch) == 10
    assert np.array_equal(observed(observer, samples)["imu"], np.array(batch, np.float32))


def test_clouds_are_padded_and_counted(scenery: Any) -> None:
    """Rows up to the count are the cloud, the rest is zero; a shorter cloud leaves no old rows."""
    rig, observer, drive = setup(scenery)
    samples = rig.measure(drive, 0, STEP)
    cloud = next(s for s in samples if s.sensor == "lidar_semantic")
    assert isinstance(cloud, PointCloud)
    seen = observed(observer, samples)
    count = int(seen["lidar_semantic_count"][0])
    assert count == len(cloud.points_xyz_m) == int(seen["lidar_count"][0])
    assert 0 < count < 2048
    rows = seen["lidar_semantic"]
    assert np.array_equal(rows[:count, :3], cloud.points_xyz_m)
    labels = np.stack([getattr(cloud, name) for name in ("cos_incidence", "instance", "tag")], axis=1)
    np.testing.assert_array_equal(rows[:count, 3:], labels.astype(np.float32))
    np.testing.assert_array_equal(seen["lidar"][:count, 3], cloud.intensity)
    assert set(np.unique(rows[:count, 4])) == {0.0, 9.0}
    assert not rows[count:].any()
    half = {
        n: getattr(cloud, n)[:5]
        for n in ("points_xyz_m", "intensity", "ring", "offset_ns", "tag", "instance", "cos_incidence")
    }
    short = PointCloud(sensor=cloud.sensor, frame_id="lidar", stamp_ns=1, sweep_ns=STEP, **half)
    seen = observed(observer, [short])
    assert int(seen["lidar_semantic_count"][0]) == 5
    assert not seen["lidar_semantic"][5:].any()


def test_slow_sensors_keep_their_newest_value(scenery: Any) -> None:
    """GNSS at 5 Hz is seen in every step, and reset forgets it."""
    rig, observer, drive = setup(scenery)
    first = observed(observer, rig.measure(drive, -1, 0))["gnss"]
    assert first[3] == 1.0
    later = observed(observer, rig.measure(drive, 0, STEP))["gnss"]
    assert np.array_equal(first, later)
    observer.reset()
    assert not observed(observer, [])["gnss"].any()


def test_arrays_belong_to_the_caller(scenery: Any) -> None:
    """Writing into an observation changes no later one."""
    rig, observer, drive = setup(scenery)
    seen = observed(observer, rig.measure(drive, -1, STEP))
    kept = {key: array.copy() for key, array in seen.items()}
    for array in seen.values():
        array.fill(0)
    again = observed(observer, [])
    assert all(np.array_equal(again[key], kept[key]) for key in kept)


def test_unknown_samples(scenery: Any) -> None:
    """Streams of other rigs are left out; kinds without a layout are an error."""
    _, observer, _ = setup(scenery)
    stranger = Sample(sensor="radar_front", frame_id="radar", stamp_ns=0)
    assert "radar_front" not in observed(observer, [stranger])
    with pytest.raises(TypeError, match="no place"):
        values_of(stranger)


def test_a_sample_from_elsewhere_says_how_it_is_observed() -> None:
    """A new kind of sample with `observed` has a place in observations; one without is refused."""

    @dataclass(frozen=True, slots=True, kw_only=True, eq=False)
    class Pressure(Sample):
        pressure_pa: float

        def observed(self) -> NDArray[np.float64]:
            return np.array([self.pressure_pa])

    sample = Pressure(sensor="baro", frame_id="baro", stamp_ns=0, pressure_pa=101_325.0)
    assert values_of(sample).tolist() == [101_325.0]
    with pytest.raises(TypeError, match="observed"):
        values_of(Sample(sensor="x", frame_id="x", stamp_ns=0))
