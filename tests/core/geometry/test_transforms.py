"""Rotations and transforms against scipy and against axes worked out by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carlaloc_env.core import transforms

RNG = np.random.default_rng(5)
QUATS = Rotation.random(500, rng=5).as_quat()
VECTORS = RNG.normal(size=(500, 3))


def same_turn(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two sets of quaternions up to sign."""
    return float(np.minimum(np.abs(a - b).max(-1), np.abs(a + b).max(-1)).max())


def test_quaternions_agree_with_scipy() -> None:
    r = Rotation.from_quat(QUATS)
    other = Rotation.from_quat(QUATS[::-1])
    assert same_turn(transforms.quat_multiply(QUATS, QUATS[::-1]), (r * other).as_quat()) < 1e-14
    assert np.allclose(transforms.quat_to_matrix(QUATS), r.as_matrix(), atol=1e-14)
    assert np.allclose(transforms.quat_rotate(QUATS, VECTORS), r.apply(VECTORS), atol=1e-13)
    assert np.allclose(transforms.quat_to_rotvec(QUATS), r.as_rotvec(), atol=1e-12)
    assert np.allclose(transforms.quat_to_rpy(QUATS), r.as_euler("ZYX")[:, ::-1], atol=1e-9)
    assert same_turn(transforms.matrix_to_quat(r.as_matrix()), QUATS) < 1e-14


@pytest.mark.parametrize("angle", [0.0, 1e-13, 1e-9, 1e-5, 1.0, np.pi - 1e-9, np.pi])
def test_exponential_and_logarithm_are_inverse(angle: float) -> None:
    """Also for tiny turns and half turns, where naive formulas divide by zero."""
    axis = np.array([0.6, -0.64, 0.48])
    q = transforms.rotvec_to_quat(angle * axis)
    assert abs(np.sum(q * q) - 1) < 1e-14
    back = transforms.quat_to_rotvec(q)
    assert min(np.abs(back - angle * axis).max(), np.abs(back + angle * axis).max()) < 1e-12


def test_half_turns_survive_matrices() -> None:
    for axis in np.eye(3):
        q = transforms.rotvec_to_quat(np.pi * axis)
        assert same_turn(transforms.matrix_to_quat(transforms.quat_to_matrix(q))[None], q[None]) < 1e-14


def test_rpy_round_trip_and_signs() -> None:
    """Positive yaw turns left, positive pitch drops the nose, positive roll drops the right side."""
    rpy = np.array([0.1, -0.4, 2.5])
    assert np.allclose(transforms.quat_to_rpy(transforms.rpy_to_quat(*rpy)), rpy, atol=1e-14)
    assert transforms.quat_rotate(transforms.rpy_to_quat(0, 0, 0.1), [1, 0, 0])[1] > 0
    assert transforms.quat_rotate(transforms.rpy_to_quat(0, 0.1, 0), [1, 0, 0])[2] < 0
    assert transforms.quat_rotate(transforms.rpy_to_quat(0.1, 0, 0), [0, -1, 0])[2] < 0


def test_slerp_is_constant_rate() -> None:
    a, b = QUATS[:100], QUATS[100:200]
    whole = np.linalg.norm(
        transforms.quat_to_rotvec(transforms.quat_multiply(transforms.quat_conjugate(a), b)), axis=-1
    )
    part = transforms.quat_slerp(a, b, np.full(100, 0.3))
    turned = np.linalg.norm(
        transforms.quat_to_rotvec(transforms.quat_multiply(transforms.quat_conjugate(a), part)), axis=-1
    )
    assert np.allclose(turned, 0.3 * whole, atol=1e-12)


def test_inverse_and_apply() -> None:
    T = transforms.transform(VECTORS, QUATS)
    assert np.allclose(T @ transforms.invert(T), np.eye(4), atol=1e-14)
    assert np.allclose(
        transforms.apply(transforms.invert(T), transforms.apply(T, VECTORS[::-1])), VECTORS[::-1], atol=1e-13
    )
    assert np.allclose(transforms.apply(T, VECTORS), np.einsum("nij,nj->ni", T[:, :3, :3], VECTORS) + VECTORS)


def test_apply_gives_the_same_bytes_for_one_point_and_for_many() -> None:
    """BLAS would not: its rounding depends on the number of points."""
    T = transforms.transform(VECTORS[0], QUATS[0])
    many = transforms.apply(T, VECTORS)
    assert all(np.array_equal(transforms.apply(T, v), row) for v, row in zip(VECTORS, many, strict=True))


def test_axes_by_hand() -> None:
    """Optical z looks forward, x right, y down; the paper's IMU is x up, y right, z forward."""
    forward, left, up = np.eye(3)
    assert np.array_equal(transforms.R_FLU_OPTICAL.T @ forward, [0, 0, 1])
    assert np.array_equal(transforms.R_FLU_OPTICAL.T @ left, [-1, 0, 0])
    assert np.array_equal(transforms.R_FLU_OPTICAL.T @ up, [0, -1, 0])
    assert np.array_equal(transforms.R_FLU_PAPER_IMU.T @ up, [1, 0, 0])
    assert np.array_equal(transforms.R_FLU_PAPER_IMU.T @ left, [0, -1, 0])
    assert np.array_equal(transforms.R_FLU_PAPER_IMU.T @ forward, [0, 0, 1])
    for R in (transforms.R_FLU_OPTICAL, transforms.R_FLU_PAPER_IMU):
        assert np.linalg.det(R) == pytest.approx(1.0)


def test_wrap_angle() -> None:
    assert np.allclose(
        transforms.wrap_angle([0, np.pi, -np.pi, 3 * np.pi, 7.0]), [0, np.pi, np.pi, np.pi, 7 - 2 * np.pi]
    )
