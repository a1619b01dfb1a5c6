"""What every sensor promises: a sample depends on seed, name and stamp, and on nothing else.

Live (a short timeline that grows and forgets) and replayed (the whole drive), alone and among
others, forwards and shuffled: the same bytes.
"""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.clock import STEP_NS, STEP_TICKS
from carlaloc_env.core.ego import Controls
from carlaloc_env.envs.observer import Observer
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Sample
from carlaloc_env.sensors.base import Mount, SensorConfig
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.lidar_presets import HDL32E_ELEVATIONS_DEG, HDL32E_FIRING_NS
from carlaloc_env.sensors.radar_config import RadarConfig
from carlaloc_env.sensors.vehicle import SpeedConfig, WheelsConfig
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.timeline.vehicle_track import CarTrack

pytest.importorskip("open3d", reason="open3d is not installed")

STEPS = 24
ROOF = Mount(position_m=(1.1, 0.2, 1.9), rpy_deg=(1, 2, -30))
CONFIGS: dict[str, SensorConfig] = {
    "imu": ImuConfig(mount=Mount(position_m=(1.5, 0, 1.2), axes="paper_imu")),
    "consumer": ImuConfig(
        **ImuConfig.preset_values("consumer"),
        name="consumer",
        orientation="truth",
        orientation_noise_rad=0.01,
    ),
    "lidar": LidarConfig(mount=Mount(position_m=(1.2, 0, 1.85)), columns=240),
    "hdl32e": LidarConfig(
        name="hdl32e",
        mount=Mount(position_m=(1.0, 0.3, 1.9), rpy_deg=(2, 3, 40)),
        elevations_deg=HDL32E_ELEVATIONS_DEG,
        firing_ns=HDL32E_FIRING_NS,
        columns=180,
        rate_hz=10.0,
        ego_returns=True,
    ),
    **{
        name: LidarConfig(**{**LidarConfig.preset_values(name), "name": name, "mount": ROOF, **fewer})
        for name, fewer in (
            ("vlp16", {"cycle_ns": 552_960.0}),
            ("mid360", {"cycle_ns": 200_000.0}),
            ("aeries2", {"columns": 20}),
        )
    },
    "radar": RadarConfig(mount=Mount(position_m=(1.2, 0, 1.85), rpy_deg=(0, 0, 60)), columns=40),
    "gnss": GnssConfig(mount=Mount(position_m=(0.7, 0, 1.5))),
    "satellites": GnssConfig(name="satellites", model="satellites", mount=Mount(position_m=(0.7, 0, 1.5))),
    "speed": SpeedConfig(noise_mps=0.1),
    "wheels": WheelsConfig(),
}
RIG = SensorRig(sensors=tuple(CONFIGS.values()))


SPINS = np.random.default_rng(5).normal(35.0, 3.0, (1000, 4))
STEER = 0.2 * np.sin(np.arange(1000) / 40)


def controls_at(tick: int) -> Controls:
    return Controls(throttle=tick % 11 / 11, brake=tick % 5 / 5, reverse=tick > 99, handbrake=tick < 7)


def street(scenery: Any, seed: int = 7) -> Any:
    models = {
        "saloon": scenery.box([-2.3, -0.9, 0.1], [2.3, 0.9, 1.4]),
        "bus": scenery.box([-6, -1.2, 0.2], [6, 1.2, 3.1]),
        **{f"signal_{c}": scenery.box([0, 0, 0], [0.1, 0.1, 0.1]) for c in ("red", "yellow", "green")},
        "ego": scenery.box([-0.95, -0.9, 0.2], [3.75, 0.9, 1.45]),
    }
    static = [
        scenery.ground(),
        scenery.box([-20, 12, 0], [60, 14, 8]),
        scenery.box([30, -20, 0], [34, -9, 5]),
    ]
    return scenery.world(static, models, seed)


def traffic_drive(scenery: Any) -> Timeline:
    start = np.array([[8, 3.5, 0], [15, -3.5, 0], [-6, 3.5, 0], [25, 7, 0.1]])
    heading = np.array([0.0, np.pi, 0.1, -1.5])
    speed = np.array([9.0, 13.0, 14.0, 3.0])
    along = np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=-1)

    def frame_at(t: float) -> Any:
        return scenery.frame(start + t * speed[:, None] * along, heading + 0.2 * t, speed, 0.02)

    catalog = scenery.catalog(["saloon", "bus", "saloon", "saloon"])
    timeline: Timeline = scenery.drive(scenery.weaving, STEPS * 0.05, catalog, frame_at)
    ticks = STEPS * STEP_TICKS + 2
    controls = [(c.throttle, c.brake, c.reverse, c.handbrake) for c in map(controls_at, range(ticks))]
    timeline.car = CarTrack.from_arrays(SPINS[:ticks], STEER[:ticks], np.array(controls, dtype=np.float64))
    return timeline


def content(sample: Sample) -> tuple[Any, ...]:
    """Every field of a sample as bytes."""
    values = []
    for field in dataclasses.fields(sample):
        value = getattr(sample, field.name)
        values.append(
            (value.dtype.str, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value
        )
    return (type(sample).__name__, *values)


def by_key(samples: list[Sample]) -> dict[tuple[str, int], tuple[Any, ...]]:
    keyed = {(sample.sensor, sample.stamp_ns): content(sample) for sample in samples}
    assert len(keyed) == len(samples)
    return keyed


@pytest.fixture
def replayed(scenery: Any) -> dict[tuple[str, int], tuple[Any, ...]]:
    """All samples of the whole drive at once."""
    return by_key(RIG.build(street(scenery)).measure(traffic_drive(scenery), -1, STEPS * STEP_NS))


def test_live_equals_replayed(scenery: Any, replayed: dict[Any, Any]) -> None:
    """The timeline grows tick by tick and forgets what lies 0.2 s back."""
    whole = traffic_drive(scenery)
    rig = RIG.build(street(scenery))
    live = Timeline(whole.catalog)
    samples: list[Sample] = []

    def add_ticks(first: int, end: int) -> None:
        for tick in range(first, end):
            live.ego.append(whole.ego.position_m[tick], whole.ego.quat_xyzw[tick])
            live.car.append(SPINS[tick], STEER[tick], controls_at(tick))

    add_ticks(0, 2)
    for step in range(STEPS + 1):
        if step:
            add_ticks((step - 1) * STEP_TICKS + 2, step * STEP_TICKS + 2)
        live.append_step(whole.actors_at(step * STEP_NS), whole.signals_at(step * STEP_NS))
        samples += rig.measure(live, (step - 1) * STEP_NS if step else -1, step * STEP_NS)
        live.forget_before((step - 4) * STEP_NS)
    assert by_key(samples) == replayed
    assert len({key[0] for key in replayed}) == 17


@pytest.mark.parametrize("name", sorted(CONFIGS))
def test_alone_equals_among_others(scenery: Any, replayed: dict[Any, Any], name: str) -> None:
    rig = SensorRig(sensors=(CONFIGS[name],)).build(street(scenery))
    alone = by_key(rig.measure(traffic_drive(scenery), -1, STEPS * STEP_NS))
    assert alone == {key: value for key, value in replayed.items() if key[0] in rig.streams}
    assert alone


def test_shuffled_stretches_equal_forwards(scenery: Any, replayed: dict[Any, Any]) -> None:
    """Stretches of odd lengths, in any order, by workers that know nothing of each other."""
    borders = [
        -1, 0, 7_000_001, 50_000_000, 161_803_398, 271_828_182, 500_000_000, 941_421_356, STEPS * STEP_NS,
    ]  # fmt: skip
    spans = list(itertools.pairwise(borders))
    samples: list[Sample] = []
    for k in np.random.default_rng(1).permutation(len(spans)):
        samples += RIG.build(street(scenery)).measure(traffic_drive(scenery), *spans[k])
    assert by_key(samples) == replayed


def test_single_stamps_backwards_equal_forwards(scenery: Any, replayed: dict[Any, Any]) -> None:
    rig, drive = RIG.build(street(scenery)), traffic_drive(scenery)
    for sensor in rig.sensors:
        for stamp in reversed(rig.stamps_ns(sensor, -1, STEPS * STEP_NS)):
            for sample in sensor.measure(drive, [stamp]):
                assert content(sample) == replayed[sample.sensor, sample.stamp_ns]


def test_another_seed_changes_noise(scenery: Any, replayed: dict[Any, Any]) -> None:
    other = by_key(RIG.build(street(scenery, seed=8)).measure(traffic_drive(scenery), -1, STEPS * STEP_NS))
    assert other.keys() == replayed.keys()
    # Where a ring of teeth begins moves few of the whole ticks.
    assert all(other[key] != replayed[key] for key in replayed if key[0] != "wheels")
    assert any(other[key] != replayed[key] for key in replayed if key[0] == "wheels")


def test_another_name_changes_noise(scenery: Any) -> None:
    """Two GNSS receivers of one car do not err together."""
    rig = SensorRig(sensors=(GnssConfig(name="a"), GnssConfig(name="b"))).build(street(scenery))
    a, b = rig.measure(traffic_drive(scenery), -1, 0)
    assert a.latitude_deg != b.latitude_deg  # type: ignore[attr-defined]


def test_pictures_keep_the_same_promise(scenery: Any) -> None:
    """Cameras too: live one by one, replayed backwards, alone and beside a LiDAR, the same bytes."""
    camera = CameraConfig(
        mount=Mount(position_m=(1.8, 0.2, 1.6), axes="optical"), pinhole=Pinhole.from_fov(96, 64, 90.0)
    )
    drive, end = traffic_drive(scenery), 300_000_000
    rig = SensorRig(sensors=(CONFIGS["lidar"], camera)).build(street(scenery))
    forwards = by_key(rig.measure(drive, -1, end))
    alone = SensorRig(sensors=(camera,)).build(street(scenery))
    for stamp in reversed(range(0, end + 1, STEP_NS)):
        pictures = alone.measure(drive, stamp - 1, stamp)
        assert [p.sensor for p in pictures] == ["rgb_left", "depth_left", "semantic_left"]
        assert all(content(p) == forwards[p.sensor, stamp] for p in pictures)
    assert forwards["rgb_left", 0][1:] != forwards["rgb_left", STEP_NS][1:]


QUIET: dict[str, Callable[[], SensorConfig]] = {
    "imu": lambda: dataclasses.replace(
        CONFIGS["imu"],
        **{f"{a}_{b}": 0.0 for a in ("accel", "gyro") for b in ("noise_density", "random_walk")},  # type: ignore[arg-type]
    ),
    "lidar": lambda: dataclasses.replace(CONFIGS["lidar"], range_noise_m=0.0),  # type: ignore[call-arg]
    "gnss": lambda: dataclasses.replace(CONFIGS["gnss"], noise_enu_m=(0.0, 0.0, 0.0)),  # type: ignore[call-arg]
    "speed": lambda: dataclasses.replace(CONFIGS["speed"], noise_mps=0.0),  # type: ignore[call-arg]
}


@pytest.mark.parametrize("name", sorted(QUIET))
def test_no_noise_when_all_figures_are_zero(scenery: Any, name: str) -> None:
    """With every σ at zero the seed has no say."""
    rig = SensorRig(sensors=(QUIET[name](),))
    drive = traffic_drive(scenery)
    a, b = (by_key(rig.build(street(scenery, seed)).measure(drive, -1, 300_000_000)) for seed in (1, 2))
    assert a == b


@pytest.mark.parametrize("name", sorted(CONFIGS))
def test_samples_are_well_formed(scenery: Any, name: str) -> None:
    """Frame, stamps on the grid, streams as promised, values inside the observation space."""
    config = CONFIGS[name]
    rig = SensorRig(sensors=(config,)).build(street(scenery))
    sensor = rig.sensors[0]
    samples = rig.measure(traffic_drive(scenery), -1, STEPS * STEP_NS)
    assert {sample.sensor for sample in samples} == set(sensor.streams())
    assert {sample.frame_id for sample in samples} == {config.frame_id}
    assert all(sample.stamp_ns % (sensor.schedule.period_ticks * 5_000_000) == 0 for sample in samples)
    observer = Observer(rig)
    for sample in samples:
        observer.add([sample])
        assert observer.space.contains(observer.newest())
