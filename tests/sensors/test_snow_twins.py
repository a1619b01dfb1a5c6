"""Twins in winter: snow is light alone, so geometry, labels, flow, radar, GNSS and IMU keep their bytes."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import need_opengl
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.samples import PointCloud
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount, Sensor
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.radar_config import RadarConfig
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.presets import PRESETS

need_opengl()
pytest.importorskip("open3d", reason="open3d is not installed")

STEP = 50_000_000
NAMES = ("ClearNoon", "SnowyNoon", "SnowyNight", "WinterNoon")
WEATHERS = [PRESETS[name] for name in NAMES]
PINHOLE = Pinhole(width_px=320, height_px=180, fx_px=160.0, fy_px=160.0, cx_px=160.0, cy_px=90.0)
MOUNT = Mount(position_m=(1.2, 0.0, 1.6))


@pytest.fixture(scope="module")
def street() -> Iterator[Any]:
    """A road with a wall, a kerb stone and a car that another one overtakes."""
    car = Scenery.box((-2.3, -0.9, 0.0), (2.3, 0.9, 1.4), tag=Tag.CAR)
    stones = [Scenery.box([20, -9, 0], [40, -7, 6]), Scenery.box([8, 3, 0], [30, 3.3, 0.15])]
    ego = Scenery.box((-0.9, -0.9, 0.3), (3.7, 0.9, 0.9), tag=Tag.CAR)
    lens = Scenery.box((0, -0.15, -0.15), (0.02, 0.15, 0.15))
    lenses = {f"signal_{colour}": lens for colour in ("red", "yellow", "green")}
    world = Scenery.world([Scenery.ground(), *stones], {"saloon": car, "ego": ego, **lenses})
    yield world
    world.renderer().close()


@pytest.fixture(scope="module")
def drive() -> Timeline:
    return Scenery.drive(
        Scenery.weaving, 0.4, Scenery.catalog(["saloon"]),
        lambda t: Scenery.frame([[14.0 + 9.0 * t, 1.0, 0.0]], speed_mps=9.0),
    )  # fmt: skip


def test_geometry_of_pictures_is_that_of_clear_noon(street: Any, drive: Timeline) -> None:
    """Depth, labels, instances, flow and normals; colours differ."""
    outputs = ("rgb", "depth", "semantic", "flow", "normal")
    mount = Mount(position_m=(1.8, 0.2, 1.6), axes="optical")
    camera = CameraConfig(name="left", mount=mount, pinhole=PINHOLE, outputs=outputs).build(street)
    clear, *snowy = camera.measure_conditions(drive, 2 * STEP, WEATHERS)
    names = [sample.sensor for sample in clear]
    assert sorted(names) == sorted(f"{output}_left" for output in outputs)
    for samples in snowy:
        for one, other in zip(clear, samples, strict=True):
            assert (one == other) == (one.sensor != "rgb_left"), one.sensor


@pytest.mark.parametrize(
    "config",
    [
        LidarConfig(mount=MOUNT),
        RadarConfig(name="front", mount=MOUNT, weather=True),
        GnssConfig(mount=MOUNT),
        ImuConfig(mount=MOUNT),
    ],
    ids=lambda config: config.kind,
)
def test_other_sensors_see_no_snow(street: Any, drive: Timeline, config: Any) -> None:
    """A radar that sees rain, too: dry snow takes less than 0.1 dB from it in 100 m."""
    sensor: Sensor = config.build(street)
    clear, *snowy = sensor.measure_conditions(drive, 4 * STEP, WEATHERS)
    assert clear
    assert all(samples == clear for samples in snowy)


def test_noise_of_points_is_that_of_clear_noon(street: Any, drive: Timeline) -> None:
    """A LiDAR in weather: surfaces that both see lie at the same places with the same labels."""
    sensor = LidarConfig(mount=MOUNT, weather=True, outputs=("semantic",)).build(street)
    clouds = [samples[0] for samples in sensor.measure_conditions(drive, STEP, WEATHERS[:2])]
    seen = []
    for cloud in clouds:
        assert isinstance(cloud, PointCloud)
        assert cloud.tag is not None
        rays = zip(cloud.offset_ns.tolist(), cloud.ring.tolist(), strict=True)
        values = zip(cloud.points_xyz_m.tolist(), cloud.tag.tolist(), strict=True)
        seen.append({ray: value for ray, value in zip(rays, values, strict=True) if value[1] != Tag.SNOW})
    clear, snowy = seen
    both = clear.keys() & snowy.keys()
    assert len(both) > 0.8 * len(clear)
    assert all(clear[ray] == snowy[ray] for ray in both)
    assert np.count_nonzero(clouds[1].tag == Tag.SNOW) > 100  # type: ignore[attr-defined]
