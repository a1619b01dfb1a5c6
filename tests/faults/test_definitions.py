"""Every fault does to samples what its definition says, and nothing where it is neutral."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import imu as imu_of

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.faults.cameras import dirt, exposed
from carlaloc_env.faults.faults import KINDS, Faults
from carlaloc_env.faults.fields import quantities
from carlaloc_env.faults.timing import Draws
from carlaloc_env.rigs.presets import flu_rig
from carlaloc_env.samples import GnssFix, Image, Imu, PointCloud, Sample, SemanticImage, WheelTicks
from carlaloc_env.sensors.base import SensorConfig

RIG = {f"{one.kind}.{one.name}": one for one in flu_rig().sensors}
MS = 1_000_000


def imu(stamp_ns: int = 0) -> Imu:
    return imu_of(stamp_ns, (0.3, -0.2, 9.81), (0.01, 0.0, -0.3))


def cloud(stamp_ns: int = 0, *, labelled: bool = True, count: int = 20_000) -> PointCloud:
    """Points all around at 20 m, each of a ray of its own."""
    rng = np.random.default_rng(3)
    turn, up = np.linspace(-np.pi, np.pi, count, endpoint=False), rng.uniform(-0.3, 0.1, count)
    xyz = 20.0 * np.stack([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)], axis=-1)
    return PointCloud(
        sensor="lidar",
        frame_id="lidar",
        stamp_ns=stamp_ns,
        points_xyz_m=xyz.astype(np.float32),
        intensity=np.ones(count, np.float32),
        ring=(np.arange(count) % 32).astype(np.uint16),
        offset_ns=(np.arange(count) // 32 * 46_080).astype(np.uint32),
        sweep_ns=50 * MS,
        tag=np.full(count, 3, np.uint8) if labelled else None,
    )


def image(value: int = 100) -> Image:
    rgb = np.full((90, 160, 3), value, np.uint8)
    return Image(sensor="rgb_left", frame_id="camera_left", stamp_ns=0, rgb=rgb)


def fix(stamp_ns: int = 0) -> GnssFix:
    return GnssFix(
        sensor="gnss", frame_id="gnss", stamp_ns=stamp_ns, latitude_deg=48.0, longitude_deg=11.0,
        altitude_m=500.0, covariance_enu_m2=np.eye(3),
    )  # fmt: skip


def faulty(sample: Sample, target: str = "lidar.lidar", seed: int = 1, **values: float) -> Any:
    faults = Faults.from_mapping({target.partition(".")[0]: values})
    return faults.apply(sample, RIG[target], seed)


def stamps(count: int = 4000, period_ms: int = 5, **values: float) -> np.ndarray:
    """Stamps of IMU samples [ms]; NaN: lost."""
    true = [k * period_ms * MS for k in range(count)]
    found = Faults.from_mapping({"imu": values}).stamps_ns(true, RIG["imu.imu"], 1)
    return np.array([math.nan if stamp is None else stamp / MS for stamp in found])


def test_an_offset_and_a_drift_move_stamps_by_exactly_that() -> None:
    true = np.arange(4000) * 5.0
    assert np.array_equal(stamps(time_offset_ms=30.0), true + 30.0)
    assert np.allclose(stamps(time_drift_ppm=200.0), true * (1 + 200e-6), atol=1e-6)
    sweep = cloud(50 * MS)
    moved = faulty(sweep, time_offset_ms=-7.5)
    assert moved == replace(sweep, stamp_ns=42_500_000)


def test_a_mount_sways_at_its_resonance_by_its_root_mean_square() -> None:
    """Each point is turned by the sway at its own time; ranges and the x axis stay."""
    rolls, times_s = [], []
    for k in range(6000):
        sweep = cloud(7 * MS * k, count=32)
        moved = faulty(sweep, sway_deg=0.3)
        np.testing.assert_array_equal(moved.points_xyz_m[:, 0], sweep.points_xyz_m[:, 0])
        before, after = (np.arctan2(c.points_xyz_m[:, 2], c.points_xyz_m[:, 1]) for c in (sweep, moved))
        rolls.append((np.degrees(after - before) + 180) % 360 - 180)
        times_s.append(1e-9 * (sweep.stamp_ns + sweep.offset_ns.astype(float)))
    roll_deg, time_s = np.concatenate(rolls), np.concatenate(times_s)
    assert np.sqrt(np.mean(roll_deg**2)) == pytest.approx(0.3, rel=0.05)
    hz = np.arange(1.0, 30.0, 0.1)
    power = np.abs(np.exp(-2j * np.pi * hz[:, None] * time_s) @ roll_deg) ** 2
    assert (power[np.abs(hz - 13.0) <= 1.5].sum() / power.sum()) > 0.9


def test_a_warming_imu_gains_its_bias_within_five_minutes() -> None:
    """After one time constant 1 − 1/e of the warming is there; at the drive's beginning nothing is."""
    assert faulty(imu(), "imu.imu", warm_up_k=10.0) == imu()
    warm = faulty(imu(300_000 * MS), "imu.imu", warm_up_k=10.0)
    share, true = 1 - math.exp(-1), imu()
    rate, force = warm.angular_rate_radps - true.angular_rate_radps, warm.specific_force_mps2
    np.testing.assert_allclose(abs(rate), share * math.radians(0.15))
    np.testing.assert_allclose(abs(force - true.specific_force_mps2), share * 0.0980665)


def test_jitter_is_normal_and_keeps_the_order() -> None:
    late = stamps(time_jitter_ms=0.5) - np.arange(4000) * 5.0
    assert abs(late.mean()) < 4 * 0.5 / math.sqrt(4000)
    assert late.std() == pytest.approx(0.5, rel=4 / math.sqrt(2 * 4000))
    assert (np.diff(stamps(time_jitter_ms=50.0)) > 0).all()


def test_dropped_share_lies_within_binomial_bounds() -> None:
    lost = np.isnan(stamps(drop_share=0.3))
    assert abs(lost.sum() - 1200) < 4 * math.sqrt(4000 * 0.3 * 0.7)
    assert not np.isnan(stamps(drop_share=0.0)).any()
    assert np.isnan(stamps(100, drop_share=1.0)).all()


@pytest.mark.parametrize(("share", "length"), [(0.2, 5.0), (0.6, 2.0)])
def test_bursts_have_their_share_and_mean_length(share: float, length: float) -> None:
    """Both of Gilbert's and Elliott's chain: lengths are geometric, the share is the stationary one."""
    lost = np.isnan(stamps(3_000, burst_share=share, burst_length=length))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
    lengths = edges[1::2] - edges[::2]
    spread = math.sqrt(length * max(length - 1, 0.1) / len(lengths))
    assert abs(lengths.mean() - length) < 4 * spread
    correlated = length * (1 + (1 - share) / share)
    assert abs(lost.mean() - share) < 4 * math.sqrt(share * (1 - share) * 2 * correlated / 3_000)


def test_any_stamp_can_be_asked_for_alone() -> None:
    every = stamps(400, burst_share=0.4, burst_length=9.0, drop_share=0.1, time_jitter_ms=0.3)
    faults = Faults.parse(
        ["imu.burst_share=0.4", "imu.burst_length=9", "imu.drop_share=0.1", "imu.time_jitter_ms=0.3"]
    )
    for k in (399, 7, 123):
        (found,) = faults.stamps_ns([k * 5 * MS], RIG["imu.imu"], 1)
        assert (math.nan if found is None else found / MS) == pytest.approx(every[k], nan_ok=True)


def test_faults_act_between_their_times() -> None:
    found = stamps(time_offset_ms=1.0, begin_s=5.0, end_s=10.0) - np.arange(4000) * 5.0
    assert np.array_equal(np.flatnonzero(found), np.arange(1000, 2000))


def test_dead_beams_have_no_points_at_any_time() -> None:
    gone = [set(range(32)) - set(faulty(cloud(t * MS), dead_beam_share=0.4).ring.tolist()) for t in (0, 500)]
    assert gone[0] == gone[1]
    assert abs(len(gone[0]) - 12.8) < 4 * math.sqrt(32 * 0.4 * 0.6)
    assert len(faulty(cloud(), dead_beam_share=1.0).ring) == 0


def test_bias_of_ranges_and_beams() -> None:
    sweep = cloud()
    range_m = np.linalg.norm(faulty(sweep, range_bias_m=0.25).points_xyz_m, axis=1)
    assert np.allclose(range_m, 20.25, atol=1e-5)
    biased = faulty(sweep, beam_bias_m=0.1)
    bias_m = np.linalg.norm(biased.points_xyz_m, axis=1) - 20.0
    of_beams = np.array([bias_m[biased.ring == ring].mean() for ring in range(32)])
    assert all(np.ptp(bias_m[biased.ring == ring]) < 1e-4 for ring in range(32))
    assert 0.1 * math.sqrt(0.4) < of_beams.std() < 0.1 * math.sqrt(1.9)  # 0.1 % and 99.9 % of χ²(31) / 31


def test_lost_points_and_crosstalk_have_their_shares() -> None:
    sweep = cloud()
    kept = len(faulty(sweep, point_drop_share=0.3).ring) / 20_000
    assert abs(kept - 0.7) < 4 * math.sqrt(0.21 / 20_000)
    mixed = faulty(sweep, crosstalk_share=0.2)
    range_m = np.linalg.norm(mixed.points_xyz_m, axis=1)
    ghost = range_m < 20.0 - 1e-3
    assert abs(ghost.mean() - 0.2) < 4 * math.sqrt(0.16 / 20_000) + 1e-3
    assert range_m[ghost].min() >= 1.0 - 1e-5
    assert abs(range_m[ghost].mean() - 10.5) < 4 * 19 / math.sqrt(12 * ghost.sum())  # even from 1 m to 20 m
    assert (mixed.tag[ghost] == 0).all()
    assert (mixed.tag[~ghost] == 3).all()
    along = np.sum(mixed.points_xyz_m * sweep.points_xyz_m, axis=1) / (20.0 * range_m)
    assert along.min() > 1.0 - 1e-5
    assert np.array_equal(mixed.points_xyz_m, faulty(cloud(labelled=False), crosstalk_share=0.2).points_xyz_m)


def test_dirt_on_the_window_takes_a_sector() -> None:
    kept = faulty(cloud(), blocked_deg=90.0)
    assert len(kept.ring) == pytest.approx(15_000, abs=2)
    turn = np.sort(np.arctan2(kept.points_xyz_m[:, 1], kept.points_xyz_m[:, 0]))
    gaps = np.diff(np.concatenate([turn, turn[:1] + 2 * np.pi]))
    assert np.degrees(gaps.max()) == pytest.approx(90.0, abs=0.1)


def test_a_ray_has_its_number_whatever_else_returns() -> None:
    sweep = cloud()
    half = replace(
        sweep, tag=None,
        **{k: getattr(sweep, k)[::2] for k in ("points_xyz_m", "intensity", "ring", "offset_ns")},
    )  # fmt: skip
    kept = set(map(tuple, faulty(sweep, point_drop_share=0.5).points_xyz_m[:, :2].tolist()))
    alone = set(map(tuple, faulty(half, point_drop_share=0.5).points_xyz_m[:, :2].tolist()))
    assert alone == kept & set(map(tuple, half.points_xyz_m[:, :2].tolist()))


def test_a_stop_doubles_the_light_and_white_is_the_end() -> None:
    def light(code: float) -> float:
        x = code / 255
        return float(x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4)

    table = exposed(1.0)
    assert np.array_equal(exposed(0.0), np.arange(256))
    for code in (5, 40, 100, 180):
        assert light(table[code]) == pytest.approx(2 * light(code), rel=0.05, abs=1e-3)
    assert table[200] == 255
    assert (faulty(image(), "camera.left", exposure_stops=1.0).rgb == table[100]).all()


def test_dirt_hides_its_share_of_one_lens_and_stays() -> None:
    hidden = dirt((90, 160), 0.25, Draws(seed=1, target="camera.left", period_ns=50 * MS)) > 0.5
    assert hidden.mean() == pytest.approx(0.25, abs=0.001)
    left = Faults.parse(["camera.left.dirt_share=0.25"])
    dirty = left.apply(image(255), RIG["camera.left"], 1)
    assert isinstance(dirty, Image)
    assert (dirty.rgb.max(axis=2) < 160).mean() == pytest.approx(0.25, abs=0.02)
    assert left.apply(image(255), RIG["camera.right"], 1) == image(255)
    labels = SemanticImage(sensor="semantic_left", frame_id="camera_left", stamp_ns=0,
                           tag=np.ones((9, 16), np.uint8), instance=np.ones((9, 16), np.uint32))  # fmt: skip
    assert left.apply(labels, RIG["camera.left"], 1) is labels


def test_drops_change_pixels_of_a_picture_that_has_some() -> None:
    picture = replace(image(), rgb=np.random.default_rng(1).integers(0, 255, (90, 160, 3)).astype(np.uint8))
    changed = (faulty(picture, "camera.left", drops_percent=60.0).rgb != picture.rgb).any(axis=2).mean()
    assert 0.005 < changed < 0.5


def test_an_imu_saturates_and_its_bias_steps() -> None:
    cut = faulty(imu(), "imu.imu", accel_limit_mps2=5.0, gyro_limit_radps=0.2)
    assert cut.specific_force_mps2.tolist() == [0.3, -0.2, 5.0]
    assert cut.angular_rate_radps.tolist() == [0.01, 0.0, -0.2]
    for stamp, bias in ((1_999 * MS, 0.0), (2_000 * MS, 0.4)):
        found = faulty(imu(stamp), "imu.imu", accel_bias_mps2=0.4, begin_s=2.0)
        assert np.array_equal(found.specific_force_mps2, imu().specific_force_mps2 + bias)


def test_a_jump_has_its_length_and_one_direction_while_it_lasts() -> None:
    here = GeoReference(latitude_deg=48.0, longitude_deg=11.0, height_m=500.0)
    found = [
        faulty(fix(k * 200 * MS), "gnss.gnss", jump_m=40.0, jump_share=0.3, jump_length=4.0)
        for k in range(200)
    ]
    away_m = np.array([here.geodetic_to_enu([f.latitude_deg, f.longitude_deg, f.altitude_m]) for f in found])[
        :, :2
    ]
    length_m = np.linalg.norm(away_m, axis=1)
    jumps = length_m > 1e-6
    assert np.allclose(length_m[jumps], 40.0, atol=0.01)
    assert abs(jumps.mean() - 0.3) < 0.2
    begins = np.flatnonzero(np.diff(jumps.astype(int), prepend=0) == 1)
    assert len({tuple(np.round(row, 2)) for row in away_m[jumps]}) == len(begins) > 1
    lost = [faulty(fix(k * 200 * MS), "gnss.gnss", outage_share=0.5, outage_length=2.0) for k in range(200)]
    gone = np.array([not f.has_fix for f in lost])
    assert abs(gone.mean() - 0.5) < 0.2
    assert all(math.isnan(f.latitude_deg) == (not f.has_fix) for f in lost)


def test_driven_wheels_slip() -> None:
    ticks = WheelTicks(sensor="wheels", frame_id="wheels", stamp_ns=0, ticks=np.array([100, 101, 100, -7]),
                       rate_radps=np.ones(4), ticks_per_turn=96)  # fmt: skip
    found = faulty(ticks, "wheels.wheels", slip=0.25)
    assert found.ticks.tolist() == [100, 101, 125, -9]
    assert found.rate_radps.tolist() == [1.0, 1.0, 1.25, 1.25]


def test_calibration_alone_is_wrong() -> None:
    words = ["lidar.calib_x_m=0.2", "lidar.calib_yaw_deg=3", "camera.left.calib_focal_share=0.1",
             "camera.left.calib_centre_px=4"]  # fmt: skip
    faults, rig = Faults.parse(words), flu_rig()
    assert faults.apply(cloud(), RIG["lidar.lidar"], 1) == cloud()
    believed = {f"{one.kind}.{one.name}": one for one in rig.believed(faults).sensors}
    changed = {name for name in RIG if believed[name] != RIG[name]}
    assert changed == {"lidar.lidar", "camera.left"}
    T = np.linalg.inv(RIG["lidar.lidar"].mount.T_base_sensor) @ believed["lidar.lidar"].mount.T_base_sensor
    assert T[0, 3] == pytest.approx(0.2)
    assert math.degrees(math.atan2(T[1, 0], T[0, 0])) == pytest.approx(3.0)
    lens: Any = believed["camera.left"]
    assert (lens.pinhole.fx_px, lens.pinhole.cx_px) == (pytest.approx(704.0), pytest.approx(644.0))


SAMPLES = {"lidar": cloud(), "camera": image(), "imu": imu(), "gnss": fix()}


@pytest.mark.parametrize("kind", KINDS)
def test_neutral_values_are_no_faults(kind: str) -> None:
    config: SensorConfig = next(one for one in RIG.values() if one.kind == kind)
    neutral = {name: known.neutral for name, known in quantities(KINDS[kind]).items()}
    faults = Faults.from_mapping({kind: neutral})
    assert faults == Faults()
    assert not faults
    if kind in SAMPLES:
        assert faults.apply(SAMPLES[kind], config, 1) is SAMPLES[kind]


def test_faults_survive_words_and_files() -> None:
    words = ["camera.left.dirt_share=0.2", "lidar.begin_s=3", "lidar.time_offset_ms=-30"]
    faults = Faults.parse(words)
    assert faults.label.split() == words
    assert Faults.from_mapping(faults.to_mapping()) == faults
    assert Faults.parse(["lidar.time_offset_ms=-30"]).slug == "lidar.time_offset_ms--30"


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("lidr.drop_share=0.1", "did you mean 'lidar'"),
        ("lidar.time_ofset_ms=3", "did you mean 'time_offset_ms'"),
        ("lidar.drop_share=2", "give 0 to 1"),
        ("lidar.burst_share=0.9", "share 0.9 of bursts of 5"),
        ("lidar.drop_share=nan", "SENSOR.NAME=NUMBER"),
        ("lidar.time_offset_ms", "SENSOR.NAME=NUMBER"),
        ("lidar.time_offset_ms=inf", "time_offset_ms = inf"),
        ("imu.calib_x_m=1", "no fault of imu 'calib_x_m'"),
    ],
)
def test_wrong_words_are_named(word: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Faults.parse([word])
