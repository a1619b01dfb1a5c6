"""Compiled functions per LiDAR ray, around the casting itself: aiming, strength, points."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary_kernels
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.jit import compiled, inlined


class PatternRays(NamedTuple):
    """Rays of a scan pattern, R of them, column by column."""

    column: Index
    """Column of each ray, (R,)."""
    later_s: Array
    """Time between the beginning of its column and the ray [s], (R,)."""
    direction: Array
    """Unit direction in the sensor's frame before the turn, (R, 3)."""
    origin_m: Array
    """Where it begins there [m], (R, 3); (0, 3): at the origin."""
    R_base: Array
    """Maps directions there to the car's frame, (3, 3)."""


class ColumnMotion(NamedTuple):
    """Motion of the car at the beginning of each of C columns."""

    position_m: Array
    """Position, world axes [m], (C, 3)."""
    quat_xyzw: Array
    """Attitude, (C, 4)."""
    velocity_mps: Array
    """Velocity, world axes [m/s], (C, 3)."""
    omega_radps: Array
    """Angular rate, axes of the car [rad/s], (C, 3)."""


class ScanHits(NamedTuple):
    """Hits of a scan, H of them, and what the R rays of its pattern have in common."""

    ray: Index
    """Ray of each hit, (H,)."""
    range_m: F32
    """Distance [m], (H,)."""
    intensity: F32
    """Return strength 0–255, (H,)."""
    tag: NDArray[np.uint8]
    """Semantic tag, (H,)."""
    instance: NDArray[np.uint32]
    """Instance id, (H,)."""
    cos_incidence: F32
    """Cosine between ray and normal, (H,)."""
    direction: Array
    """Unit direction of each ray, sensor frame before the turn, (R, 3)."""
    origin_m: Array
    """Where each ray begins there [m], (R, 3); (0, 3): at its origin."""
    turn: tuple[float, float]
    """Cosine and sine of the turn about z."""
    noise: Array
    """Standard normal number of each ray, (R,)."""
    ring: NDArray[np.uint16]
    """Beam of each ray, (R,)."""
    offset_ns: NDArray[np.uint32]
    """Time of each ray after the scan began [ns], (R,)."""


class PointColumns(NamedTuple):
    """Points of a cloud, N of them."""

    xyz_m: F32
    """Coordinates in the sensor frame at the time of each point [m], (N, 3)."""
    intensity: F32
    """Return strength 0–255, (N,)."""
    ring: NDArray[np.uint16]
    """Beam, (N,)."""
    offset_ns: NDArray[np.uint32]
    """Time after the scan began [ns], (N,)."""
    tag: NDArray[np.uint8]
    """Semantic tag, (N,)."""
    instance: NDArray[np.uint32]
    """Instance id, (N,)."""
    cos_incidence: F32
    """Cosine between ray and normal, (N,)."""


def empty_points(count: int) -> PointColumns:
    """Columns for N points, not yet written."""
    return PointColumns(
        xyz_m=np.empty((count, 3), np.float32),
        intensity=np.empty(count, np.float32),
        ring=np.empty(count, np.uint16),
        offset_ns=np.empty(count, np.uint32),
        tag=np.empty(count, np.uint8),
        instance=np.empty(count, np.uint32),
        cos_incidence=np.empty(count, np.float32),
    )


@compiled
def aim(rays: Index, pattern: PatternRays, lever_m: Array, motion: ColumnMotion, out: F32) -> None:
    """Aim N rays, each at its own time: writes origins [m] and unit directions, world, to `out` (N, 6).

    Args:
        rays: Numbers of the rays, column by column, shape (N,).
        pattern: All rays of the pattern.
        lever_m: Position of the sensor on the car [m], shape (3,).
        motion: Motion of the car at the beginning of each column.
        out: Receives them, shape (N, 6).
    """
    column, later_s, local = pattern.column, pattern.later_s, pattern.direction
    position_m, quat_xyzw = motion.position_m, motion.quat_xyzw
    velocity_mps, omega_radps = motion.velocity_mps, motion.omega_radps
    own_origins, q = len(pattern.origin_m) > 0, pattern.R_base
    for row in range(len(rays)):
        ray = rays[row]
        c, dt = column[ray], later_s[ray]
        if row == 0 or c != column[rays[row - 1]]:
            qx, qy, qz, qw = quat_xyzw[c, 0], quat_xyzw[c, 1], quat_xyzw[c, 2], quat_xyzw[c, 3]
            xx, xy, xz = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw), 2 * (qx * qz + qy * qw)
            yx, yy, yz = 2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qx * qw)
            zx, zy, zz = 2 * (qx * qz - qy * qw), 2 * (qy * qz + qx * qw), 1 - 2 * (qx * qx + qy * qy)
            # The car's rotation after that of the sensor, and the car's rate in the sensor's axes.
            m00, m01, m02 = _times(xx, xy, xz, q)
            m10, m11, m12 = _times(yx, yy, yz, q)
            m20, m21, m22 = _times(zx, zy, zz, q)
            ux, uy, uz = _times(omega_radps[c, 0], omega_radps[c, 1], omega_radps[c, 2], q)
        x, y, z = local[ray, 0], local[ray, 1], local[ray, 2]
        ax, ay, az = lever_m[0], lever_m[1], lever_m[2]
        if dt > 0.0:
            wx, wy, wz = dt * ux, dt * uy, dt * uz
            x, y, z = x + (wy * z - wz * y), y + (wz * x - wx * z), z + (wx * y - wy * x)
            wx, wy, wz = dt * omega_radps[c, 0], dt * omega_radps[c, 1], dt * omega_radps[c, 2]
            ax, ay, az = ax + (wy * az - wz * ay), ay + (wz * ax - wx * az), az + (wx * ay - wy * ax)
        out[row, 0] = position_m[c, 0] + dt * velocity_mps[c, 0] + (xx * ax + xy * ay + xz * az)
        out[row, 1] = position_m[c, 1] + dt * velocity_mps[c, 1] + (yx * ax + yy * ay + yz * az)
        out[row, 2] = position_m[c, 2] + dt * velocity_mps[c, 2] + (zx * ax + zy * ay + zz * az)
        out[row, 3] = m00 * x + m01 * y + m02 * z
        out[row, 4] = m10 * x + m11 * y + m12 * z
        out[row, 5] = m20 * x + m21 * y + m22 * z
        if own_origins:
            ax, ay, az = pattern.origin_m[ray, 0], pattern.origin_m[ray, 1], pattern.origin_m[ray, 2]
            out[row, 0] += m00 * ax + m01 * ay + m02 * az
            out[row, 1] += m10 * ax + m11 * ay + m12 * az
            out[row, 2] += m20 * ax + m21 * ay + m22 * az


@inlined
def _times(x: float, y: float, z: float, q: Array) -> tuple[float, float, float]:
    """A row (x, y, z) times a matrix (3, 3)."""
    return (
        x * q[0, 0] + y * q[1, 0] + z * q[2, 0],
        x * q[0, 1] + y * q[1, 1] + z * q[2, 1],
        x * q[0, 2] + y * q[1, 2] + z * q[2, 2],
    )


@compiled
def strengths(
    range_m: F32,
    material: NDArray[np.uint8],
    cos_incidence: F32,
    tone: F32,
    reflectance: F32,
    retro: F32,
    scale: tuple[float, float],
    out: F32,
) -> None:
    """Return strength 0–255 of N hits: diffuse surfaces up to a figure, retro-reflectors above.

    Args:
        range_m: Distance, inf where nothing was hit [m], shape (N,).
        material: Material of each hit, shape (N,).
        cos_incidence: Cosine between ray and normal, shape (N,).
        tone: Reflectance at the place over the material's mean, shape (N,).
        reflectance: Diffuse reflectance by material.
        retro: Fraction of retro-reflection by material.
        scale: Strength of a white surface face on, and loss of intensity over distance [1/m].
        out: Receives the strengths, shape (N,).
    """
    white, attenuation_per_m = scale
    for i in range(len(range_m)):
        cosine, kind = float(cos_incidence[i]), material[i]
        strength = white * reflectance[kind] * tone[i] * cosine
        if retro[kind] > 0:
            strength += (255.0 - white) * retro[kind] * math.sqrt(cosine)
        if strength > 0:
            strength *= elementary_kernels.exp(-attenuation_per_m * range_m[i])
        out[i] = min(strength, 255.0)


@compiled
def points_of(kept: Index, hits: ScanHits, noise_scale_m: float, points: PointColumns) -> None:
    """Make points of N kept hits, in the sensor frame at the time of each [m].

    Args:
        kept: Rows of the hits that become points, shape (N,).
        hits: Hits of the scan.
        noise_scale_m: Standard deviation of the distance [m].
        points: Receives the points, N rows.
    """
    own_origins, cosine, sine = len(hits.origin_m) > 0, hits.turn[0], hits.turn[1]
    for row in range(len(kept)):
        hit = kept[row]
        ray = hits.ray[hit]
        distance_m = hits.range_m[hit] + noise_scale_m * hits.noise[ray]
        x, y, z = hits.direction[ray, 0], hits.direction[ray, 1], hits.direction[ray, 2]
        x, y, z = x * distance_m, y * distance_m, z * distance_m
        if own_origins:
            x, y, z = x + hits.origin_m[ray, 0], y + hits.origin_m[ray, 1], z + hits.origin_m[ray, 2]
        if sine != 0.0:
            x, y = cosine * x - sine * y, sine * x + cosine * y
        points.xyz_m[row, 0], points.xyz_m[row, 1], points.xyz_m[row, 2] = x, y, z
        points.intensity[row], points.cos_incidence[row] = hits.intensity[hit], hits.cos_incidence[hit]
        points.ring[row], points.offset_ns[row] = hits.ring[ray], hits.offset_ns[ray]
        points.tag[row], points.instance[row] = hits.tag[hit], hits.instance[hit]
