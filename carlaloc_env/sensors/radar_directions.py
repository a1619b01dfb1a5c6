"""Directions as a radar counts them: azimuth, elevation, and turns between its axes and the world's."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.timeline.motion import Motion


def polar(local_m: Array) -> tuple[Array, Array, Array]:
    """Distance [m], azimuth and elevation [rad] of points (N, 3) in a sensor's frame."""
    flat = np.sqrt(local_m[:, 0] * local_m[:, 0] + local_m[:, 1] * local_m[:, 1])
    distance = np.sqrt(flat * flat + local_m[:, 2] * local_m[:, 2])
    return distance, elementary.arctan2(local_m[:, 1], local_m[:, 0]), elementary.arctan2(local_m[:, 2], flat)


def direction(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Unit vectors at azimuths and elevations of one shape, shape (..., 3)."""
    flat, up = elementary.cos(elevation_rad), elementary.sin(elevation_rad)
    return np.stack([flat * elementary.cos(azimuth_rad), flat * elementary.sin(azimuth_rad), up], axis=-1)


def into(motion: Motion, vectors: Array) -> Array:
    """Vectors (N, 3) from world axes to those of the radar."""
    return transforms.quat_rotate(transforms.quat_conjugate(motion.quat_xyzw), vectors)


def out_of(motion: Motion, vectors: Array) -> Array:
    """Vectors (N, 3) from the axes of the radar to those of the world."""
    return transforms.quat_rotate(motion.quat_xyzw, vectors)


def dot(vectors: Array, other: Array) -> Array:
    """Scalar products of vectors (N, 3) with others or with one, shape (N,), without BLAS."""
    product = vectors * other
    result: Array = product[:, 0] + product[:, 1] + product[:, 2]
    return result
