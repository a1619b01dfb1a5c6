"""The spline: derivatives, closed-form motions, and the same bytes live and loaded."""

import numpy as np
import pytest

from carlaloc_env.core import transforms
from carlaloc_env.core.clock import TICK_NS, TICK_S
from carlaloc_env.timeline.ego_spline import EgoTrack


def wild_track(count: int = 400) -> EgoTrack:
    t = np.arange(count) * TICK_S
    position = np.stack([300 + 9 * t + np.sin(3 * t), -200 + 2 * np.cos(2 * t), 0.1 * np.sin(9 * t)], axis=-1)
    quat = transforms.rpy_to_quat(0.05 * np.sin(4 * t), 0.04 * np.cos(5 * t), 1.5 * np.sin(0.9 * t) + 2)
    return EgoTrack.from_arrays(position, quat)


def circle(radius_m: float, rate_radps: float, seconds: float) -> EgoTrack:
    t = np.arange(int(seconds / TICK_S) + 3) * TICK_S
    a = rate_radps * t
    position = np.stack([radius_m * np.sin(a), radius_m * (1 - np.cos(a)), 0 * a], axis=-1)
    return EgoTrack.from_arrays(position, transforms.rpy_to_quat(0 * a, 0 * a, a))


def test_derivatives_equal_finite_differences() -> None:
    """Velocity, acceleration, body rate and angular acceleration belong to the same curve."""
    track = wild_track()
    h = 1000
    t = np.random.default_rng(0).integers(10 * TICK_NS, 380 * TICK_NS, 500)
    here, before, after = track.motion(t), track.motion(t - h), track.motion(t + h)
    dt = 2e-9 * h
    velocity = (after.position_m - before.position_m) / dt
    assert np.allclose(velocity, here.velocity_world_mps, atol=2e-6)
    acceleration = (after.velocity_world_mps - before.velocity_world_mps) / dt
    assert np.allclose(acceleration, here.acceleration_world_mps2, atol=1e-2)
    turn = transforms.quat_multiply(transforms.quat_conjugate(before.quat_xyzw), after.quat_xyzw)
    assert np.allclose(transforms.quat_to_rotvec(turn) / dt, here.omega_body_radps, atol=1e-7)
    alpha = (after.omega_body_radps - before.omega_body_radps) / dt
    assert np.allclose(alpha, here.alpha_body_radps2, atol=1e-2)


def test_curve_is_twice_continuous_across_ticks() -> None:
    """Acceleration and angular acceleration do not jump where one polynomial follows another."""
    track = wild_track()
    border = np.arange(5, 390) * TICK_NS
    left, right = track.motion(border - 1), track.motion(border + 1)
    slope = 2e-9
    assert np.abs(left.acceleration_world_mps2 - right.acceleration_world_mps2).max() < 500 * slope
    assert np.abs(left.alpha_body_radps2 - right.alpha_body_radps2).max() < 500 * slope


def test_circle_has_centripetal_acceleration() -> None:
    """v = r·ω, a = r·ω² towards the centre, constant body rate; spline error of order (ω·dt)²."""
    radius, rate = 20.0, 0.5
    motion = circle(radius, rate, 4.0).motion(np.arange(20, 700) * TICK_NS + 1_234_567)
    assert np.allclose(np.linalg.norm(motion.velocity_world_mps, axis=1), radius * rate, rtol=1e-5)
    body = transforms.quat_rotate(transforms.quat_conjugate(motion.quat_xyzw), motion.acceleration_world_mps2)
    assert np.allclose(body, [0, radius * rate**2, 0], atol=1e-4)
    assert np.allclose(motion.omega_body_radps, [0, 0, rate], atol=1e-10)
    assert np.allclose(motion.alpha_body_radps2, 0, atol=1e-7)


def test_pendulum_about_a_tilted_axis() -> None:
    """θ = A·sin(kt) about one axis: rate A·k·cos(kt), angular acceleration −A·k²·sin(kt)."""
    axis, amplitude, k = np.array([0.48, 0.6, 0.64]), 0.7, 3.0
    t = np.arange(800) * TICK_S
    quat = transforms.rotvec_to_quat(amplitude * np.sin(k * t)[:, None] * axis)
    stamps = np.random.default_rng(1).integers(5 * TICK_NS, 790 * TICK_NS, 300)
    motion = EgoTrack.from_arrays(np.zeros((800, 3)), quat).motion(stamps)
    s = stamps * 1e-9
    rate = (amplitude * k * np.cos(k * s))[:, None] * axis
    assert np.allclose(motion.omega_body_radps, rate, atol=2e-4)
    alpha = (-amplitude * k**2 * np.sin(k * s))[:, None] * axis
    assert np.allclose(motion.alpha_body_radps2, alpha, atol=2e-3)


def test_knots_do_not_amplify_rounding_far_from_the_origin() -> None:
    """Second differences of coordinates near 1 km stay quiet: below 1e-5 m/s² on a still car."""
    position = np.broadcast_to([912.3456789, -803.1234567, 12.3], (50, 3))
    track = EgoTrack.from_arrays(position, np.broadcast_to([0.0, 0, 0, 1], (50, 4)))
    motion = track.motion(np.arange(0, 45 * TICK_NS, 777_777))
    assert np.array_equal(motion.acceleration_world_mps2, np.zeros_like(motion.acceleration_world_mps2))
    assert np.array_equal(motion.position_m, np.broadcast_to(position[0], motion.position_m.shape))


def test_spline_of_a_far_steady_drive_is_quiet() -> None:
    """20 m/s at 900 m from the origin: knots at 200 Hz turn float64 rounding into < 1e-7 m/s².

    float32 positions (0.06 mm there) would read as metres per second squared.
    """
    t = np.arange(400) * TICK_S
    position = np.stack([900 + 20 * t, -800 + 1.3 * t, 5 + 0.1 * t], axis=-1)
    quat = np.broadcast_to([0.0, 0, 0, 1], (400, 4))
    stamps = np.arange(2 * TICK_NS, 390 * TICK_NS, 1_234_567)
    quiet = EgoTrack.from_arrays(position, quat).motion(stamps)
    assert np.abs(quiet.acceleration_world_mps2).max() < 1e-7
    rounded = EgoTrack.from_arrays(position.astype(np.float32), quat).motion(stamps)
    assert np.abs(rounded.acceleration_world_mps2).max() > 1.0


def test_lever_arm_closed_form() -> None:
    """On a circle a point ahead of the centre feels r·ω² sideways and l·ω² backwards."""
    radius, rate, ahead = 15.0, 0.8, 2.0
    mount = transforms.from_rotation(np.eye(3), [ahead, 0.0, 1.0])
    motion = circle(radius, rate, 3.0).motion(np.arange(50, 500) * TICK_NS).at_mount(mount)
    body = transforms.quat_rotate(transforms.quat_conjugate(motion.quat_xyzw), motion.acceleration_world_mps2)
    assert np.allclose(body, [-ahead * rate**2, radius * rate**2, 0], atol=2e-4)
    speed = transforms.quat_rotate(transforms.quat_conjugate(motion.quat_xyzw), motion.velocity_world_mps)
    assert np.allclose(speed, [radius * rate, ahead * rate, 0], atol=2e-4)


def test_mount_motion_is_the_derivative_of_mount_position() -> None:
    """Lever arm terms agree with differences of the mounted point itself, in a wild motion."""
    track, h = wild_track(), 20_000
    mount = transforms.transform([1.2, -0.4, 1.8], transforms.rpy_to_quat(0.1, 0.2, -2.0))
    t = np.random.default_rng(3).integers(10 * TICK_NS, 380 * TICK_NS, 300)
    a, b, c = (track.motion(t + k).at_mount(mount) for k in (-h, 0, h))
    dt = h * 1e-9
    assert np.allclose((c.position_m - a.position_m) / (2 * dt), b.velocity_world_mps, atol=1e-5)
    second = (c.velocity_world_mps - a.velocity_world_mps) / (2 * dt)
    assert np.allclose(second, b.acceleration_world_mps2, atol=1e-2)
    turn = transforms.quat_multiply(transforms.quat_conjugate(a.quat_xyzw), c.quat_xyzw)
    assert np.allclose(transforms.quat_to_rotvec(turn) / (2 * dt), b.omega_body_radps, atol=1e-5)


def test_live_window_equals_the_whole_track_to_the_byte() -> None:
    """A live run that keeps 60 ticks reads what a replay of the whole drive reads."""
    whole = wild_track()
    live = EgoTrack()
    for tick in range(400):
        live.append(whole.position_m[tick], whole.quat_xyzw[tick])
        if tick % 10 == 3 and tick > 80:
            live.forget_before(tick - 60)
            stamps = np.arange((tick - 40) * TICK_NS, live.end_ns, 1_357_911)
            seen, known = live.motion(stamps), whole.motion(stamps)
            for name in ("position_m", "quat_xyzw", "acceleration_world_mps2", "alpha_body_radps2"):
                assert getattr(seen, name).tobytes() == getattr(known, name).tobytes()


def test_one_time_or_many_times_give_the_same_bytes() -> None:
    track = wild_track()
    stamps = np.arange(0, 390 * TICK_NS, 7_654_321)
    many = track.motion(stamps)
    for i, stamp in enumerate(stamps):
        one = track.motion(int(stamp))
        assert one.quat_xyzw[0].tobytes() == many.quat_xyzw[i].tobytes()
        assert one.omega_body_radps[0].tobytes() == many.omega_body_radps[i].tobytes()


def test_times_outside_are_refused() -> None:
    track = wild_track(100)
    for stamp in (-1, track.end_ns + 1):
        with pytest.raises(ValueError, match="outside"):
            track.motion(stamp)
    track.motion([track.start_ns, track.end_ns])
    track.forget_before(50)
    with pytest.raises(ValueError, match="outside"):
        track.motion(50 * TICK_NS)
    track.motion(51 * TICK_NS)
