"""The time offset of a clock, against offsets that were put in."""

import numpy as np
import pytest

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.associate import associate
from recorder.evaluation.time_offset import find_time_offset
from recorder.evaluation.trajectory import Trajectory

EPOCH_NS = 1_672_531_200_000_000_000


def drive(rate_hz: int, duration_s: float = 40.0) -> Trajectory:
    """A winding road at varying speed."""
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    yaw = 0.9 * np.sin(0.35 * t) + 0.2 * np.sin(1.3 * t)
    fine = np.linspace(0.0, duration_s, 40_001)
    fine_yaw = 0.9 * np.sin(0.35 * fine) + 0.2 * np.sin(1.3 * fine)
    speed = 8.0 + 3.0 * np.sin(0.2 * fine)
    xy = np.cumsum(np.stack([speed * np.cos(fine_yaw), speed * np.sin(fine_yaw)]), axis=1) * fine[1]
    position = np.stack(
        [np.interp(t, fine, xy[0]), np.interp(t, fine, xy[1]), 0.3 * np.sin(0.5 * t)], axis=-1
    )
    return Trajectory(
        stamp_ns=EPOCH_NS + np.round(t * 1e9).astype(np.int64),
        position_m=position,
        quat_xyzw=transforms.rpy_to_quat(np.zeros_like(t), np.zeros_like(t), yaw),
        name="drive",
    )


def in_another_world(trajectory: Trajectory, seed: int) -> Trajectory:
    """Seen from another origin, with noise of 2 cm and 2 mrad."""
    rng = np.random.default_rng(seed)
    q = transforms.rpy_to_quat(0.1, -0.2, 2.0)
    count = len(trajectory)
    turn = transforms.rotvec_to_quat(rng.normal(0, 0.002, (count, 3)))
    shift = np.array([500.0, -20.0, 3.0]) + rng.normal(0, 0.02, (count, 3))
    return Trajectory(
        stamp_ns=trajectory.stamp_ns,
        position_m=transforms.quat_rotate(np.broadcast_to(q, (count, 4)), trajectory.position_m) + shift,
        quat_xyzw=transforms.quat_multiply(
            np.broadcast_to(q, (count, 4)), transforms.quat_multiply(trajectory.quat_xyzw, turn)
        ),
        name="estimate",
    )


@pytest.mark.parametrize("offset_s", [0.0, 0.0137, -0.25, 3.4, -1_672_531_190.0])
def test_offset_is_found(offset_s: float) -> None:
    offset_ns = round(offset_s * 1e9)
    estimate = in_another_world(drive(20), 1).shifted(-offset_ns)
    found_ns = find_time_offset(drive(200), estimate)
    assert found_ns == pytest.approx(offset_ns, abs=2_000_000)


def test_offset_of_a_part_is_found() -> None:
    part = in_another_world(drive(20).take(np.arange(200, 600)), 2).shifted(-7_000_000_000)
    assert find_time_offset(drive(200), part) == pytest.approx(7_000_000_000, abs=2_000_000)


def test_straight_drive_is_found_by_its_speed() -> None:
    t = np.arange(0, 30, 0.05)
    at = np.cumsum(6.0 + 4.0 * np.sin(0.7 * t)) * 0.05
    truth = Trajectory(
        stamp_ns=np.round(t * 1e9).astype(np.int64),
        position_m=np.stack([at, 0.001 * at**2, np.sin(at)], axis=-1),
        quat_xyzw=np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)),
        name="straight",
    )
    found_ns = find_time_offset(truth, truth.shifted(-1_500_000_000))
    assert found_ns == pytest.approx(1_500_000_000, abs=2_000_000)


def test_other_drive_is_refused() -> None:
    rng = np.random.default_rng(3)
    truth = drive(20)
    walk = np.cumsum(rng.normal(size=(len(truth), 3)), axis=0)
    other = Trajectory(
        stamp_ns=truth.stamp_ns,
        position_m=walk,
        quat_xyzw=transforms.rotvec_to_quat(rng.normal(size=(len(truth), 3))),
        name="other",
    )
    with pytest.raises(EvaluationError, match="do not resemble"):
        find_time_offset(truth, other)


def test_disjoint_stamps_name_the_search() -> None:
    with pytest.raises(EvaluationError, match=r"lie 1\.6725\d*e\+09 s apart; use --time-offset search"):
        associate(drive(20), drive(20).shifted(-EPOCH_NS))
