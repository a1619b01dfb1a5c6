"""Bundle adjustment of a few stereo images: poses and landmarks that explain all sightings best.

Levenberg and Marquardt over Huber's loss on the errors in both images, with the landmarks eliminated by
Schur's complement (Triggs et al. 2000, Bundle Adjustment – A Modern Synthesis).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import quat_to_matrix, rotvec_to_quat
from recorder.evaluation.se3 import cross_matrix

HUBER_PX = 1.0
"""Error from which a sighting counts linearly [px]."""
DEPTH_MIN_M = 0.5
"""Landmarks nearer than this do not count: they lie behind the camera or in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoCamera:
    """Two equal, parallel cameras side by side, without distortion."""

    focal_px: float
    """Focal length [px]."""
    centre_px: Array
    """Principal point [px], shape (2,)."""
    baseline_m: float
    """Distance of the cameras [m]."""

    def project(self, points_m: Array) -> Array:
        """Column and row in the left image, column in the right one [px], of points in its axes, (N, 3)."""
        x, y, z = points_m.T
        u = self.focal_px * x / z + self.centre_px[0]
        v = self.focal_px * y / z + self.centre_px[1]
        seen: Array = np.stack([u, v, u - self.focal_px * self.baseline_m / z], axis=1)
        return seen

    def jacobian(self, points_m: Array) -> Array:
        """Derivative of `project` by the points, shape (N, 3, 3)."""
        x, y, z = points_m.T
        f, zero = self.focal_px / z, np.zeros(len(z))
        rows = [[f, zero, -f * x / z], [zero, f, -f * y / z], [f, zero, -f * (x - self.baseline_m) / z]]
        J: Array = np.stack([np.stack(row, axis=1) for row in rows], axis=1)
        return J


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sightings:
    """Sightings of landmarks in images, each pair once: parallel arrays of M."""

    image: NDArray[np.intp]
    """Number of the image, shape (M,)."""
    landmark: NDArray[np.intp]
    """Number of the landmark, shape (M,)."""
    pixel: Array
    """Column and row in the left image, column in the right one or NaN [px], shape (M, 3)."""


def adjust(
    camera: StereoCamera, T_camera_world: Array, points_m: Array, sightings: Sightings, *, iterations: int = 6
) -> tuple[Array, Array]:
    """Poses and landmarks with the least error; the first pose is held.

    Args:
        camera: The cameras.
        T_camera_world: Poses to begin with, map world coordinates to the left camera, shape (K, 4, 4).
        points_m: Landmarks to begin with [m], world, shape (L, 3).
        sightings: What is seen; every landmark at least once.
        iterations: Steps at most.

    Returns:
        Poses and landmarks, shapes as given.
    """
    T, points = T_camera_world.copy(), points_m.copy()
    damping, cost = 1e-4, _cost(camera, T, points, sightings)
    for _ in range(iterations):
        step = _step(camera, T, points, sightings, damping)
        moved, shifted = _moved(T, step[0]), points + step[1]
        new = _cost(camera, moved, shifted, sightings)
        if new > cost or not np.isfinite(new):
            damping *= 10.0
            continue
        done = cost - new < 1e-4 * cost
        T, points, cost, damping = moved, shifted, new, damping * 0.1
        if done:
            break
    return T, points


def _errors(camera: StereoCamera, T: Array, points_m: Array, seen: Sightings) -> tuple[Array, Array, Array]:
    """Errors [px] (M, 3), their weights (M,), and the points in the axes of the cameras (M, 3)."""
    pose = T[seen.image]
    local = np.einsum("mij,mj->mi", pose[:, :3, :3], points_m[seen.landmark]) + pose[:, :3, 3]
    ahead = local[:, 2] > DEPTH_MIN_M
    local[~ahead] = [0.0, 0.0, 1.0]
    error = np.nan_to_num(camera.project(local) - seen.pixel)
    size = np.linalg.norm(error, axis=1)
    weight = np.where(ahead, np.minimum(1.0, HUBER_PX / np.maximum(size, 1e-9)), 0.0)
    return error, weight, local


def _cost(camera: StereoCamera, T: Array, points_m: Array, seen: Sightings) -> float:
    """Huber's loss of all sightings [px²]; one behind a camera costs as much as one 10 px off."""
    error, weight, _ = _errors(camera, T, points_m, seen)
    size = np.where(weight > 0, np.linalg.norm(error, axis=1), 10.0)
    return float(np.where(size < HUBER_PX, size**2, HUBER_PX * (2.0 * size - HUBER_PX)).sum())


def _step(
    camera: StereoCamera, T: Array, points_m: Array, seen: Sightings, damping: float
) -> tuple[Array, Array]:
    """Change of the poses, (K, 6): shift and turn in camera axes, and of the landmarks [m], (L, 3)."""
    images, landmarks = len(T), len(points_m)
    error, weight, local = _errors(camera, T, points_m, seen)
    by_local = camera.jacobian(local)
    by_local[np.isnan(seen.pixel)] = 0.0
    by_point = by_local @ T[seen.image, :3, :3]
    by_pose = np.concatenate([by_local, -by_local @ cross_matrix(local)], axis=2)
    weighted = weight[:, None, None] * by_pose

    shape = (landmarks, images)
    H_pose = _dense(seen, weighted.transpose(0, 2, 1) @ by_pose, shape).sum(axis=0)
    g_pose = _dense(seen, np.einsum("mji,mj->mi", weighted, error), shape).sum(axis=0)
    weighted_point = weight[:, None, None] * by_point
    H_point = _dense(seen, weighted_point.transpose(0, 2, 1) @ by_point, shape).sum(axis=1)
    g_point = _dense(seen, np.einsum("mji,mj->mi", weighted_point, error), shape).sum(axis=1)
    H_mixed = _dense(seen, weighted.transpose(0, 2, 1) @ by_point, shape)

    H_point += (damping * np.einsum("lii->l", H_point) + 1e-6)[:, None, None] * np.eye(3)
    inverse = np.linalg.inv(H_point)
    mixed = H_mixed[:, 1:].reshape(landmarks, -1, 3)  # the first pose is held
    gain = mixed @ inverse
    size = mixed.shape[1]
    # einsum by itself, since threads of BLAS wait for each other on a machine that is busy.
    S = -np.einsum("lai,lbi->ab", gain, mixed)
    for k in range(1, images):
        rows = slice(6 * (k - 1), 6 * k)
        S[rows, rows] += H_pose[k]
    S[np.diag_indices(size)] *= 1.0 + damping
    S[np.diag_indices(size)] += 1e-9
    d_pose = np.linalg.solve(S, -g_pose[1:].ravel() + np.einsum("lai,li->a", gain, g_point))
    back = g_point + np.einsum("lai,a->li", mixed, d_pose)
    d_point: Array = -np.einsum("lij,lj->li", inverse, back)
    return np.concatenate([np.zeros((1, 6)), d_pose.reshape(-1, 6)]), d_point


def _dense(seen: Sightings, values: Array, shape: tuple[int, int]) -> Array:
    """Values of all sightings by landmark and image, zero where one does not see the other."""
    dense = np.zeros((*shape, *values.shape[1:]))
    dense[seen.landmark, seen.image] = values
    return dense


def _moved(T: Array, step: Array) -> Array:
    """Poses after a shift and turn in their cameras' axes."""
    moved = T.copy()
    turn = quat_to_matrix(rotvec_to_quat(step[:, 3:]))
    moved[:, :3, :3] = turn @ T[:, :3, :3]
    moved[:, :3, 3] = np.einsum("kij,kj->ki", turn, T[:, :3, 3]) + step[:, :3]
    return moved
