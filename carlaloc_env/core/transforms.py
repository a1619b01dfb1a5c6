"""Rotations and rigid transforms, vectorised over leading axes, float64, right-handed.

Quaternions are ``quat_xyzw``. ``T_a_b`` maps coordinates of frame b to frame a.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array

R_FLU_OPTICAL: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Maps camera optical axes (x right, y down, z forward) to FLU axes, shape (3, 3)."""
R_FLU_PAPER_IMU: Array = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Maps the paper's IMU axes (x up, y right, z forward) to FLU axes, shape (3, 3)."""


def quat_multiply(a_xyzw: ArrayLike, b_xyzw: ArrayLike) -> Array:
    """Hamilton product ``a ⊗ b`` (rotate by b first), shapes (..., 4)."""
    a = np.asarray(a_xyzw, dtype=np.float64)
    b = np.asarray(b_xyzw, dtype=np.float64)
    ax, ay, az, aw = _components(a)
    bx, by, bz, bw = _components(b)
    return _joined(
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def quat_conjugate(quat_xyzw: ArrayLike) -> Array:
    """Inverse of unit quaternions, shape (..., 4)."""
    conjugate: Array = np.asarray(quat_xyzw, dtype=np.float64) * np.array([-1.0, -1.0, -1.0, 1.0])
    return conjugate


def quat_normalise(quat_xyzw: ArrayLike) -> Array:
    """Unit quaternions of the same rotation, shape (..., 4)."""
    q = np.asarray(quat_xyzw, dtype=np.float64)
    unit: Array = q / np.sqrt(np.sum(q * q, axis=-1, keepdims=True))
    return unit


def quat_to_matrix(quat_xyzw: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    q = np.asarray(quat_xyzw, dtype=np.float64)
    x, y, z, w = _components(q)
    R = np.empty((*q.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = (
        1 - 2 * (y * y + z * z),
        2 * (x * y - z * w),
        2 * (x * z + y * w),
    )
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = (
        2 * (x * y + z * w),
        1 - 2 * (x * x + z * z),
        2 * (y * z - x * w),
    )
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = (
        2 * (x * z - y * w),
        2 * (y * z + x * w),
        1 - 2 * (x * x + y * y),
    )
    return R


def matrix_to_quat(R: ArrayLike) -> Array:
    """Unit quaternions xyzw (..., 4), w ≥ 0, of rotation matrices (..., 3, 3).

    Bar-Itzhack's choice of the largest of four candidates keeps it exact near half turns.
    """
    m = np.asarray(R, dtype=np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    yx, zx, zy = m[..., 1, 0], m[..., 2, 0], m[..., 2, 1]
    xy, xz, yz = m[..., 0, 1], m[..., 0, 2], m[..., 1, 2]
    candidates = (
        _joined(1 + xx - yy - zz, xy + yx, zx + xz, zy - yz),
        _joined(xy + yx, 1 + yy - xx - zz, yz + zy, xz - zx),
        _joined(zx + xz, yz + zy, 1 + zz - xx - yy, yx - xy),
        _joined(zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz),
    )
    largest = np.argmax(_joined(*(candidates[i][..., i] for i in range(4))), axis=-1)
    q = np.choose(largest[..., None], candidates)
    q = quat_normalise(q)
    return np.where(q[..., 3:4] < 0, -q, q)


def quat_rotate(quat_xyzw: ArrayLike, vectors: ArrayLike) -> Array:
    """Vectors (..., 3) rotated by unit quaternions (..., 4)."""
    q = np.asarray(quat_xyzw, dtype=np.float64)
    v = np.asarray(vectors, dtype=np.float64)
    u = q[..., :3]
    t = 2.0 * cross(u, v)
    return v + q[..., 3:4] * t + cross(u, t)


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """Cross product over the last axis, shapes (..., 3); several times faster than numpy's."""
    a0, a1, a2 = _components(np.asarray(a, dtype=np.float64))
    b0, b1, b2 = _components(np.asarray(b, dtype=np.float64))
    return _joined(a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0)


def rotvec_to_quat(rotvec_rad: ArrayLike) -> Array:
    """Exponential map: rotation vectors [rad] (..., 3) to unit quaternions (..., 4)."""
    v = np.asarray(rotvec_rad, dtype=np.float64)
    half = 0.5 * np.sqrt(np.sum(v * v, axis=-1, keepdims=True))
    scale = 0.5 * elementary.sinc(half / np.pi)
    return np.concatenate([v * scale, elementary.cos(half)], axis=-1)


def quat_to_rotvec(quat_xyzw: ArrayLike) -> Array:
    """Logarithm: unit quaternions (..., 4) to the shorter rotation vectors [rad] (..., 3)."""
    q = np.asarray(quat_xyzw, dtype=np.float64)
    q = np.where(q[..., 3:4] < 0, -q, q)
    sin_half = np.sqrt(np.sum(q[..., :3] ** 2, axis=-1, keepdims=True))
    half = elementary.arctan2(sin_half, q[..., 3:4])
    safe = np.where(sin_half > 1e-12, sin_half, 1.0)
    return q[..., :3] * np.where(sin_half > 1e-12, 2.0 * half / safe, 2.0)


def quat_slerp(a_xyzw: ArrayLike, b_xyzw: ArrayLike, fraction: ArrayLike) -> Array:
    """Great-arc interpolation from a (fraction 0) to b (1), shapes (..., 4) and (...)."""
    delta = quat_to_rotvec(quat_multiply(quat_conjugate(a_xyzw), b_xyzw))
    return quat_multiply(a_xyzw, rotvec_to_quat(delta * np.asarray(fraction)[..., None]))


def rpy_to_quat(roll_rad: ArrayLike, pitch_rad: ArrayLike, yaw_rad: ArrayLike) -> Array:
    """Quaternions xyzw (..., 4) of Rz(yaw)·Ry(pitch)·Rx(roll) [rad]; pitch > 0 is nose down (FLU)."""
    r, p, y = np.broadcast_arrays(
        *(0.5 * np.asarray(x, dtype=np.float64) for x in (roll_rad, pitch_rad, yaw_rad))
    )
    cr, sr, cp, sp, cy, sy = (
        elementary.cos(r),
        elementary.sin(r),
        elementary.cos(p),
        elementary.sin(p),
        elementary.cos(y),
        elementary.sin(y),
    )
    return _joined(
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def quat_to_rpy(quat_xyzw: ArrayLike) -> Array:
    """Roll, pitch, yaw [rad] (..., 3) of unit quaternions (..., 4), inverse of `rpy_to_quat`."""
    x, y, z, w = _components(np.asarray(quat_xyzw, dtype=np.float64))
    roll = elementary.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = elementary.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = elementary.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return _joined(roll, pitch, yaw)


def transform(position_m: ArrayLike, quat_xyzw: ArrayLike) -> Array:
    """Homogeneous matrices (..., 4, 4) of positions [m] (..., 3) and quaternions (..., 4)."""
    p = np.asarray(position_m, dtype=np.float64)
    R = quat_to_matrix(quat_xyzw)
    T = np.zeros((*np.broadcast_shapes(p.shape[:-1], R.shape[:-2]), 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def from_rotation(R: ArrayLike, position_m: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Homogeneous matrix (4, 4) of a rotation matrix (3, 3) and a position [m] (3,)."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = position_m
    return T


def invert(T: ArrayLike) -> Array:
    """Inverse of rigid transforms (..., 4, 4)."""
    m = np.asarray(T, dtype=np.float64)
    Rt = np.swapaxes(m[..., :3, :3], -1, -2)
    out = np.zeros_like(m)
    out[..., :3, :3] = Rt
    x, y, z = (m[..., k, 3, None] for k in range(3))
    out[..., :3, 3] = -(m[..., 0, :3] * x + m[..., 1, :3] * y + m[..., 2, :3] * z)
    out[..., 3, 3] = 1.0
    return out


def apply(T: ArrayLike, points_m: ArrayLike) -> Array:
    """Points [m] (..., 3) mapped by transforms (..., 4, 4).

    Written out without BLAS, whose rounding depends on the number of points.
    """
    m = np.asarray(T, dtype=np.float64)
    x, y, z = _components(np.asarray(points_m, dtype=np.float64))
    return _joined(*(m[..., i, 0] * x + m[..., i, 1] * y + m[..., i, 2] * z + m[..., i, 3] for i in range(3)))


def wrap_angle(angle_rad: ArrayLike) -> Array:
    """Angles [rad] brought into (−π, π]."""
    a = np.asarray(angle_rad, dtype=np.float64)
    return np.pi - np.mod(np.pi - a, 2 * np.pi)


def _components(vectors: Array) -> tuple[Array, ...]:
    """Columns of the last axis; plain indexing costs a tenth of `moveaxis` on the few rows of a tick."""
    return tuple(vectors[..., k] for k in range(vectors.shape[-1]))


def _joined(*components: Array) -> Array:
    """Inverse of `_components`."""
    out = np.empty((*components[-1].shape, len(components)))
    for k, component in enumerate(components):
        out[..., k] = component
    return out
