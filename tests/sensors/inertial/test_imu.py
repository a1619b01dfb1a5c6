"""The IMU: gravity's sign, lever arm, re-integration, and noise of the promised densities."""

import itertools
from typing import Any

import numpy as np
import pytest
from scipy.fft import dst
from scipy.optimize import nnls
from scipy.signal import welch

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.core.errors import ConfigError, EpisodeError
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Imu, Sample
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.inertial.imu import ImuConfig
from carlaloc_env.sensors.inertial.stochastic_processes import Flicker, GaussMarkov, RandomWalk, WhiteSequence
from carlaloc_env.sensors.inertial.vibration import body_response
from carlaloc_env.sensors.lidar.config import LidarConfig
from carlaloc_env.sensors.vehicle.speedometer import SpeedConfig
from carlaloc_env.timeline.vehicle_track import CarTrack

QUIET = {
    "accel_noise_density": 0.0,
    "gyro_noise_density": 0.0,
    "accel_random_walk": 0.0,
    "gyro_random_walk": 0.0,
}


def rows(samples: list[Sample]) -> Array:
    """Specific force and body rate, one row per sample."""
    assert all(isinstance(sample, Imu) for sample in samples)
    return np.array([[*s.specific_force_mps2, *s.angular_rate_radps] for s in samples])  # type: ignore[attr-defined]


def read(scenery: Any, path: Any, seconds: float, **config: Any) -> Array:
    """All readings of a drive."""
    drive = scenery.drive(path, seconds)
    imu = ImuConfig(**config).build(scenery.world())
    stamps = [k * TICK_NS for k in range(round(seconds * 200))]
    return rows(imu.measure(drive, stamps))


def test_gravity_reads_upwards_at_rest(scenery: Any) -> None:
    """(0, 0, +9.81) in FLU; along +x in the paper's axes (up, right, forward); a sign slip reads −9.81."""
    rest = read(scenery, scenery.straight(0.0), 0.5, **QUIET)
    assert np.allclose(rest, [0, 0, 9.81, 0, 0, 0], atol=1e-12)
    paper = read(scenery, scenery.straight(0.0), 0.5, mount=Mount(axes="paper_imu"), **QUIET)
    assert np.allclose(paper, [9.81, 0, 0, 0, 0, 0], atol=1e-12)


def test_slope_at_rest(scenery: Any) -> None:
    """Parked nose up by 5°: the forward axis feels +g·sin 5°."""

    def slope(t: Array) -> tuple[Array, Array]:
        return np.zeros((len(t), 3)), np.stack([0 * t, np.full(len(t), -np.radians(5)), 0 * t], axis=-1)

    rest = read(scenery, slope, 0.2, **QUIET)
    assert np.allclose(
        rest[:, :3], [9.81 * np.sin(np.radians(5)), 0, 9.81 * np.cos(np.radians(5))], atol=1e-9
    )


def turn(t: Array) -> tuple[Array, Array]:
    """Circle of 25 m to the left at 10 m/s."""
    a = 0.4 * t
    return np.stack([25 * np.sin(a), 25 * (1 - np.cos(a)), 0 * a], axis=-1), np.stack(
        [0 * a, 0 * a, a], axis=-1
    )


def test_constant_turn(scenery: Any) -> None:
    """A left turn reads +v·ω to the left and +ω about up, in both conventions of axes."""
    flu = read(scenery, turn, 3.0, **QUIET)[10:]
    assert np.allclose(flu, [0, 10 * 0.4, 9.81, 0, 0, 0.4], atol=1e-4)
    paper = read(scenery, turn, 3.0, mount=Mount(axes="paper_imu"), **QUIET)[10:]
    assert np.allclose(paper, [9.81, -10 * 0.4, 0, 0.4, 0, 0], atol=1e-4)


def test_lever_arm(scenery: Any) -> None:
    """1.5 m ahead and 0.4 m left of the axle, the turn adds ω²·l towards the axle."""
    mount = Mount(position_m=(1.5, 0.4, 1.2))
    arm = read(scenery, turn, 3.0, mount=mount, **QUIET)[10:]
    assert np.allclose(arm[:, :3], [-1.5 * 0.16, 4.0 - 0.4 * 0.16, 9.81], atol=2e-4)


def test_free_fall_reads_nothing(scenery: Any) -> None:
    def fall(t: Array) -> tuple[Array, Array]:
        return np.stack([0 * t, 0 * t, -0.5 * 9.81 * t**2], axis=-1), np.zeros((len(t), 3))

    assert np.allclose(read(scenery, fall, 1.0, **QUIET)[5:], 0, atol=1e-8)


def test_reintegration_returns_the_drive(scenery: Any) -> None:
    """Mid-point integration of 60 s of noise-free readings: 0.05 m and 0.01° from the truth."""

    def lively(t: Array) -> tuple[Array, Array]:
        position = np.stack([60 * np.sin(0.2 * t), 40 * np.sin(0.4 * t), 0.03 * np.sin(6 * t)], axis=-1)
        yaw = np.unwrap(np.arctan2(16 * np.cos(0.4 * t), 12 * np.cos(0.2 * t)))
        return position, np.stack([0.03 * np.sin(2 * t), 0.02 * np.cos(3 * t), yaw], axis=-1)

    mount = Mount(position_m=(1.5, 0.0, 1.2), axes="paper_imu")
    drive = scenery.drive(lively, 61.0)
    stamps = [k * TICK_NS for k in range(2, 2 + 60 * 200)]
    r = rows(ImuConfig(mount=mount, **QUIET).build(scenery.world()).measure(drive, stamps))
    truth = drive.ego_motion(stamps).at_mount(mount.T_base_sensor)
    q, v, p = truth.quat_xyzw[0], truth.velocity_world_mps[0].copy(), truth.position_m[0].copy()
    g, dt = np.array([0, 0, -9.81]), 0.005
    for a, b in itertools.pairwise(r):
        following = transforms.quat_multiply(q, transforms.rotvec_to_quat(0.5 * (a[3:] + b[3:]) * dt))
        force = 0.5 * (transforms.quat_rotate(q, a[:3]) + transforms.quat_rotate(following, b[:3])) + g
        p += v * dt + 0.5 * force * dt**2
        v += force * dt
        q = following
    error = transforms.quat_to_rotvec(
        transforms.quat_multiply(transforms.quat_conjugate(q), truth.quat_xyzw[-1])
    )
    assert np.linalg.norm(p - truth.position_m[-1]) < 0.05
    assert np.degrees(np.linalg.norm(error)) < 0.01


def allan_variance(x: Array, strides: list[int]) -> Array:
    """Overlapping Allan variance of readings at 200 Hz."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    means = [(total[m:] - total[:-m]) / m for m in strides]
    return np.array([0.5 * np.mean((a[m:] - a[:-m]) ** 2) for a, m in zip(means, strides, strict=True)])


def imu_noise(scenery: Any, count: int) -> Array:
    """White noise and bias walk of the paper's IMU, shape (count, 6)."""
    imu = ImuConfig().build(scenery.world())
    spans = [np.arange(k, k + 10_000, dtype=np.int64) for k in range(0, count, 10_000)]
    white = np.concatenate([imu._white.rows(span) for span in spans])
    walk = np.concatenate([imu._walk.rows(span) for span in spans])
    noise: Array = imu._white_scale * white + imu._walk_scale * walk
    return noise


def test_noise_densities_by_allan_variance(scenery: Any) -> None:
    """A joint fit σ²(τ) = N²/τ + K²·τ/3 over 1200 s returns the configured densities, not per-sample numbers.

    N and the accelerometer's K hold on each axis. The gyroscope's K holds as the rms of the axes only:
    of 1200 s no unbiased estimator knows one axis's better than to 13 % (1σ), see `walk_bound`.
    """
    strides = [2, 5, 10, 30, 100, 300, 1000, 3000, 10000]
    tau = np.array(strides) / 200
    noise = imu_noise(scenery, 200 * 1200)
    found = []
    for axis in range(6):
        variance = allan_variance(noise[:, axis], strides)
        A = np.stack([1 / tau, tau / 3], axis=-1) / variance[:, None]
        squares, _ = nnls(A / np.sqrt(tau)[:, None], 1 / np.sqrt(tau))
        found.append(np.sqrt(squares))
    n, k = np.array(found).T
    assert n[:3] == pytest.approx(2e-3, rel=0.03)
    assert n[3:] == pytest.approx(2e-4, rel=0.03)
    assert k[:3] == pytest.approx(3e-3, rel=0.15)
    assert np.sqrt(np.mean(k[3:] ** 2)) == pytest.approx(2e-5, rel=0.15)


def difference_spectrum(count: int) -> Array:
    """Power of the differences of unit white noise along the eigenvectors of their covariance.

    That of a random walk's differences is 1 along each: white noise and walk together are
    independent normal numbers of variance N²/Δt·c + K²·Δt there, exactly.
    """
    return 2.0 - 2.0 * np.cos(np.pi * np.arange(1, count) / count)


def walk_bound(density: float, walk: float, seconds: float) -> float:
    """Cramér–Rao bound of the walk K, relative, N being unknown too; close to √(2N / (K·T))."""
    a, b, c = density**2 * 200, walk**2 / 200, difference_spectrum(round(200 * seconds))
    rows = np.stack([c, np.ones_like(c)]) / (a * c + b)
    return float(0.5 * np.sqrt(np.linalg.inv(0.5 * rows @ rows.T)[1, 1]) / b)


def most_likely(x: Array) -> tuple[float, float]:
    """Maximum-likelihood N and K of readings at 200 Hz, by Fisher scoring."""
    power, c = dst(np.diff(x), type=1, norm="ortho") ** 2, difference_spectrum(len(x))
    a, b = float(np.mean(power) / np.mean(c)), 1e-6 * float(np.mean(power))
    before = np.inf
    while abs(b - before) > 1e-6 * b:
        before, rows = b, np.stack([c, np.ones_like(c)]) / (a * c + b)
        a, b = np.linalg.solve(rows @ rows.T, rows @ (power / (a * c + b)))
        b = max(b, 0.2 * before)
    return float(np.sqrt(a / 200)), float(np.sqrt(b * 200))


def test_walk_of_each_gyro_axis_in_a_log_long_enough(scenery: Any) -> None:
    """At 1200 s the bound of K is 3.3 % and 13 %; at 8000 s the gyroscope's is 5 %, and 15 % are 3σ."""
    assert walk_bound(2e-3, 3e-3, 1200.0) == pytest.approx(0.033, abs=5e-4)
    assert walk_bound(2e-4, 2e-5, 1200.0) == pytest.approx(0.130, abs=5e-4)
    assert walk_bound(2e-4, 2e-5, 8000.0) == pytest.approx(0.050, abs=5e-4)
    found = np.array([most_likely(x) for x in imu_noise(scenery, 200 * 8000)[:, 3:].T])
    assert found[:, 0] == pytest.approx(2e-4, rel=0.005)
    assert found[:, 1] == pytest.approx(2e-5, rel=0.15)


def test_no_estimator_beats_the_bound_and_the_likeliest_reaches_it() -> None:
    """K over 30 logs of 1200 s of numpy's own noise: no bias, and the spread that the bound says."""
    rng = np.random.default_rng(1)
    for density, walk in ((2e-3, 3e-3), (2e-4, 2e-5)):
        found = []
        for _ in range(30):
            white, steps = rng.standard_normal((2, 200 * 1200))
            x = density * np.sqrt(200) * white + walk / np.sqrt(200) * np.cumsum(steps)
            found.append(most_likely(x)[1] / walk)
        bound = walk_bound(density, walk, 1200.0)
        assert np.mean(found) == pytest.approx(1.0, abs=3 * bound / np.sqrt(30))
        assert np.std(found) == pytest.approx(bound, rel=0.39)  # 3σ of a spread of 30


def test_white_noise_per_sample(scenery: Any) -> None:
    """At 200 Hz the paper's density 2e-3 means 0.0283 m/s² per sample."""
    config = {**QUIET, "accel_noise_density": 2e-3}
    x = read(scenery, scenery.straight(0.0), 30.0, **config)[:, :3] - [0, 0, 9.81]
    assert x.std() == pytest.approx(2e-3 * np.sqrt(200), rel=0.03)
    assert np.abs(np.corrcoef(x.T) - np.eye(3)).max() < 0.06


def test_bias_walks_with_the_square_root_of_time() -> None:
    """Steps of the walk are standard normal; the spread over seeds grows as √n."""
    ends = np.concatenate(
        [RandomWalk(seed, "imu/bias", 6).rows(np.array([400, 1600])) for seed in range(60)], axis=0
    )
    assert ends[0::2].std() == pytest.approx(20, rel=0.12)
    assert ends[1::2].std() == pytest.approx(40, rel=0.12)
    steps = np.diff(RandomWalk(1, "imu/bias", 2).rows(np.arange(5000)), axis=0)
    assert steps.std() == pytest.approx(1.0, rel=0.03)


def test_random_access_to_noise_gives_the_same_bytes() -> None:
    """Jumping, going backwards or walking there: the bias of a tick is the same number."""
    walk = RandomWalk(3, "imu/bias", 6).rows(np.arange(2000))
    white = WhiteSequence(3, "imu/white", 6).rows(np.arange(2000))
    order = np.random.default_rng(0).permutation(2000)
    jump, jump_white = RandomWalk(3, "imu/bias", 6), WhiteSequence(3, "imu/white", 6)
    for n in order[:300]:
        assert jump.rows(np.array([n]))[0].tobytes() == walk[n].tobytes()
        assert jump_white.rows(np.array([n]))[0].tobytes() == white[n].tobytes()


def test_speed_is_forward_speed(scenery: Any) -> None:
    """Positive ahead, negative backwards, blind to sideways motion."""
    for speed in (12.0, -3.0):
        drive = scenery.drive(scenery.straight(speed), 0.5)
        sample = SpeedConfig().build(scenery.world()).measure(drive, [200_000_000])[0]
        assert sample.speed_mps == pytest.approx(speed, abs=1e-9)  # type: ignore[attr-defined]


def test_wrong_noise_figures_are_refused() -> None:
    with pytest.raises(ConfigError, match="≥ 0"):
        ImuConfig(accel_noise_density=-1.0)
    with pytest.raises(ConfigError, match="≥ 0"):
        ImuConfig(gyro_random_walk=float("nan"))


def quiet_imu(**config: Any) -> Any:
    """A perfect IMU but for what is asked for."""
    return ImuConfig(**{**QUIET, **config})


def test_rest_reads_gravity_whatever_the_grade(scenery: Any) -> None:
    """‖f‖ at rest is 9.81 m/s² up to turn-on bias and scale, and exactly so without them."""
    for name, limit in (("paper", 5e-3), ("adis16448", 0.06), ("tactical", 0.03), ("consumer", 0.9)):
        mean = np.mean(
            [
                np.linalg.norm(read(scenery, scenery.straight(), 2.0, **ImuConfig.preset_values(name))[:, :3]
                               .mean(axis=0))
            ]
        )  # fmt: skip
        assert mean == pytest.approx(9.81, abs=limit), name


def test_bias_instability_is_flat_at_its_level() -> None:
    """Allan deviation of the flicker alone: 0.664·B from 10 s to 300 s, over 16 axes of 3000 s at 10 Hz."""
    noise = Flicker(4, "imu/flicker", 16, period_s=0.1).rows(np.arange(30_000, dtype=np.int64))
    for tau in (10.0, 30.0, 100.0, 300.0):
        stride = round(tau * 10)
        variance = np.mean([allan_variance(noise[:, k], [stride])[0] for k in range(16)])
        assert np.sqrt(variance) == pytest.approx(0.664, rel=0.15), tau


def test_gauss_markov_keeps_variance_and_correlation() -> None:
    """Variance 1 from the first sample on, correlation e⁻¹ after one time constant, any order of access."""
    process = GaussMarkov(5, "x", 400, period_s=0.2, time_constant_s=10.0)
    rows = process.rows(np.array([0, 50, 430]))
    assert rows.std(axis=1) == pytest.approx([1.0, 1.0, 1.0], rel=0.1)
    assert np.mean(rows[0] * rows[1]) == pytest.approx(np.exp(-1.0), abs=0.12)
    again = GaussMarkov(5, "x", 400, period_s=0.2, time_constant_s=10.0).rows(np.array([430]))
    assert again.tobytes() == rows[2:].tobytes()


def test_scale_and_misalignment_mix_the_axes(scenery: Any) -> None:
    """At rest only the up axis feels force: its scale on its own axis, its tilt on the two others."""
    readings = []
    for seed in range(300):
        imu = quiet_imu(scale_error=0.01, misalignment_rad=0.003).build(scenery.world(seed=seed))
        readings.append(rows(imu.measure(scenery.drive(scenery.straight(), 0.1), [0]))[0, :3] / 9.81)
    spread = np.std(readings, axis=0)
    assert spread == pytest.approx([0.003, 0.003, 0.01], rel=0.13)
    assert np.mean(readings, axis=0) == pytest.approx([0.0, 0.0, 1.0], abs=0.002)


def test_readings_saturate(scenery: Any) -> None:
    """Range of 0.2 rad/s and 3 m/s²: the turn of 0.4 rad/s and 4 m/s² is cut, gravity too."""
    flat = read(scenery, turn, 1.0, accel_range_mps2=3.0, gyro_range_radps=0.2, **QUIET)[10:]
    assert np.allclose(flat, [0, 3.0, 3.0, 0, 0, 0.2], atol=1e-4)


def rolling(scenery: Any, speed: float, seconds: float, throttle: float = 1.0) -> Any:
    """A straight drive whose wheels roll without slip."""
    drive = scenery.drive(scenery.straight(speed), seconds)
    ticks = round(seconds * 200) + 2
    spin = np.full((ticks, 4), speed / 0.311)
    controls = np.tile([throttle, 0.0, 0.0, 0.0], (ticks, 1))
    drive.car = CarTrack.from_arrays(spin, np.zeros(ticks), controls)
    return drive


@pytest.mark.parametrize("speed", [8.0, 20.0])
def test_road_vibration_has_the_spectrum_of_iso_8608(scenery: Any, speed: float) -> None:
    """Power of the vertical acceleration in octaves against ∫(2πf)⁴·|H|²·G_d(f) of class C, ±35 %."""
    seconds = 200.0
    drive = rolling(scenery, speed, seconds)
    imu = quiet_imu(road_class="C", mount=Mount(axes="paper_imu")).build(scenery.world())
    stamps = [k * TICK_NS for k in range(round(seconds * 200))]
    up = rows(imu.measure(drive, stamps))[:, 0] - 9.81
    frequency, power = welch(up, fs=200.0, nperseg=8192)
    step = frequency[1]
    for low, high in ((0.8, 1.6), (1.6, 3.2), (3.2, 6.4), (6.4, 12.8), (12.8, 25.6)):
        band = (frequency >= low) & (frequency < high)
        f = frequency[band]
        n = f / speed
        expected = (2 * np.pi * f) ** 4 * np.abs(body_response(f)) ** 2 * 256e-6 * (n / 0.1) ** -2 / speed
        assert power[band].sum() * step == pytest.approx(expected.sum() * step, rel=0.35), (low, high)
    still = rows(imu.measure(rolling(scenery, 0.0, 1.0), stamps[:100]))
    assert np.allclose(still[:, 0], 9.81, atol=1e-12)


def test_quarter_car_follows_slow_roads_and_ignores_fast_ones() -> None:
    """Gain 1 far below the bounce, above 1 near 1.3 Hz, falling beyond the wheel hop."""
    slow, bounce, fast = np.abs(body_response(np.array([0.05, 1.3, 40.0])))
    assert slow == pytest.approx(1.0, abs=0.01)
    assert bounce > 1.3
    assert fast < 0.05


def test_motor_vibration_follows_the_motor(scenery: Any) -> None:
    """At 5 m/s the first order lies at v/(2πr)·9 Hz; full throttle gives the RMS, none a fifth of it."""
    imu = quiet_imu(motor_vibration_mps2=0.5, motor_orders=(1.0, 2.0)).build(scenery.world())
    stamps = [k * TICK_NS for k in range(10, 4000)]  # the drive's jerky first instants left out
    full = rows(imu.measure(rolling(scenery, 5.0, 20.0), stamps))[:, :3] - [0, 0, 9.81]
    assert full.std(axis=0) == pytest.approx([0.5] * 3, rel=0.02)
    frequency, power = welch(full[:, 1], fs=200.0, nperseg=2048)
    assert frequency[np.argmax(power)] == pytest.approx(9 * 5.0 / (2 * np.pi * 0.311), abs=0.15)
    idle = rows(imu.measure(rolling(scenery, 5.0, 20.0, throttle=0.0), stamps))[:, :3] - [0, 0, 9.81]
    assert idle.std() == pytest.approx(0.1, rel=0.02)


def test_vibration_needs_the_wheels(scenery: Any) -> None:
    with pytest.raises(EpisodeError, match="no record of its wheels"):
        read(scenery, scenery.straight(5.0), 0.2, road_class="B", **QUIET)


def test_orientation_on_request(scenery: Any) -> None:
    """None by default; the true attitude of the IMU's own axes, or with the noise asked for."""
    drive, stamps = scenery.drive(scenery.weaving, 3.0), [k * TICK_NS for k in range(500)]
    mount = Mount(position_m=(1.5, 0, 1.2), axes="paper_imu")
    world = scenery.world()
    assert quiet_imu(mount=mount).build(world).measure(drive, [0])[0].quat_xyzw is None
    truth = drive.ego_motion(stamps).at_mount(mount.T_base_sensor).quat_xyzw
    exact = quiet_imu(mount=mount, orientation="truth").build(world).measure(drive, stamps)
    assert np.array_equal([s.quat_xyzw for s in exact], truth)
    noisy = quiet_imu(mount=mount, orientation="truth", orientation_noise_rad=0.02).build(world)
    quats = np.array([s.quat_xyzw for s in noisy.measure(drive, stamps)])
    off = transforms.quat_to_rotvec(transforms.quat_multiply(transforms.quat_conjugate(truth), quats))
    assert off.std(axis=0) == pytest.approx([0.02] * 3, rel=0.1)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"road_class": "Z"}, "road class 'Z'"),
        ({"orientation": "thruth"}, "did you mean 'truth'"),
        ({"motor_vibration_mps2": 1.0, "motor_orders": ()}, "motor_orders"),
        ({"scale_error": -0.1}, "≥ 0"),
    ],
)
def test_wrong_configurations_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        ImuConfig(**wrong)


def test_readings_begin_with_the_drive_and_never_pause(scenery: Any) -> None:
    """Trackers look for the reading before the first picture: no other sample comes before ours begin."""
    pytest.importorskip("open3d", reason="open3d is not installed")
    sensors = (ImuConfig(), LidarConfig(columns=8), SpeedConfig())
    rig = SensorRig(name="three", sensors=sensors).build(scenery.world([scenery.ground()]))
    drive = scenery.drive(scenery.straight(0.0), 1.0)
    samples = [s for k in range(10) for s in rig.measure(drive, k * STEP_NS - (k == 0), (k + 1) * STEP_NS)]
    inertial = [s.stamp_ns for s in samples if isinstance(s, Imu)]
    assert inertial == list(range(0, 10 * STEP_NS + 1, TICK_NS))
    assert min(s.stamp_ns for s in samples if not isinstance(s, Imu)) == 0
