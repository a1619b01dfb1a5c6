"""Compiled functions per LiDAR ray, around the casting itself: aiming, strength, points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.jit import compiled


@compiled
def aim(
    rays: Index,
    of_ray: tuple[Index, Array, Array],
    lever_m: Array,
    position_m: Array,
    quat_xyzw: Array,
    velocity_mps: Array,
    omega_radps: Array,
    out: F32,
) -> None:
    """Aim N rays, each at its own time: writes origins [m] and unit directions, world, to `out` (N, 6).

    Args:
        rays: Which rays, column by column, shape (N,).
        of_ray: Column of every ray, time between the beginning of its column and the ray [s], and
            direction in the car's frame.
        lever_m: Position of the sensor on the car [m], shape (3,).
        position_m: Position of the car at the beginning of each column, world axes [m], shape (C, 3).
        quat_xyzw: Its attitude then, shape (C, 4).
        velocity_mps: Its velocity in world axes [m/s], shape (C, 3).
        omega_radps: Its rate in its own axes [rad/s], shape (C, 3).
        out: Receives them, shape (N, 6).
    """
    column, later_s, local = of_ray
    for row in range(len(rays)):
        ray = rays[row]
        c, dt = column[ray], later_s[ray]
        if row == 0 or c != column[rays[row - 1]]:
            qx, qy, qz, qw = quat_xyzw[c, 0], quat_xyzw[c, 1], quat_xyzw[c, 2], quat_xyzw[c, 3]
            xx, xy, xz = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw), 2 * (qx * qz + qy * qw)
            yx, yy, yz = 2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qx * qw)
            zx, zy, zz = 2 * (qx * qz - qy * qw), 2 * (qy * qz + qx * qw), 1 - 2 * (qx * qx + qy * qy)
        x, y, z = local[ray, 0], local[ray, 1], local[ray, 2]
        ax, ay, az = lever_m[0], lever_m[1], lever_m[2]
        if dt > 0.0:
            wx, wy, wz = dt * omega_radps[c, 0], dt * omega_radps[c, 1], dt * omega_radps[c, 2]
            x, y, z = x + (wy * z - wz * y), y + (wz * x - wx * z), z + (wx * y - wy * x)
            ax, ay, az = ax + (wy * az - wz * ay), ay + (wz * ax - wx * az), az + (wx * ay - wy * ax)
        out[row, 0] = position_m[c, 0] + dt * velocity_mps[c, 0] + (xx * ax + xy * ay + xz * az)
        out[row, 1] = position_m[c, 1] + dt * velocity_mps[c, 1] + (yx * ax + yy * ay + yz * az)
        out[row, 2] = position_m[c, 2] + dt * velocity_mps[c, 2] + (zx * ax + zy * ay + zz * az)
        out[row, 3] = xx * x + xy * y + xz * z
        out[row, 4] = yx * x + yy * y + yz * z
        out[row, 5] = zx * x + zy * y + zz * z


@compiled
def strengths(
    range_m: F32,
    material: NDArray[np.uint8],
    cos_incidence: F32,
    reflectance: F32,
    retro: F32,
    attenuation_per_m: float,
    out: F32,
) -> None:
    """Return strength 0–255 of N hits: diffuse surfaces up to 100, retro-reflectors above.

    Args:
        range_m: Distance, inf where nothing was hit [m], shape (N,).
        material: Material of each hit, shape (N,).
        cos_incidence: Cosine between ray and normal, shape (N,).
        reflectance: Diffuse reflectance by material.
        retro: Fraction of retro-reflection by material.
        attenuation_per_m: Loss of intensity over distance [1/m].
        out: Receives the strengths, shape (N,).
    """
    for i in range(len(range_m)):
        cosine, kind = float(cos_incidence[i]), material[i]
        strength = 100.0 * reflectance[kind] * cosine
        if retro[kind] > 0:
            strength += 155.0 * retro[kind] * math.sqrt(cosine)
        if strength > 0:
            strength *= math.exp(-attenuation_per_m * range_m[i])
        out[i] = min(strength, 255.0)


@compiled
def points_of(
    kept: Index,
    of_ray: tuple[Index, Array, Array, NDArray[np.uint16], NDArray[np.uint32]],
    noise_scale_m: float,
    of_hit: tuple[F32, F32, NDArray[np.uint8], NDArray[np.uint32], F32],
    points_xyz_m: F32,
    out: tuple[F32, NDArray[np.uint16], NDArray[np.uint32], NDArray[np.uint8], NDArray[np.uint32], F32],
) -> None:
    """Make points of the N kept hits, in the sensor frame at the time of each [m].

    Args:
        kept: Rows of the hits that become points, shape (N,).
        of_ray: The ray of each hit; then direction, unit noise, ring and time of every ray.
        noise_scale_m: What one unit of noise adds to the distance [m].
        of_hit: Distance [m], strength, tag, instance and incidence of each hit.
        points_xyz_m: Receives the points [m], shape (N, 3).
        out: Receive strength, ring, time, tag, instance and incidence, each of shape (N,).
    """
    rays, local, noise, ring, offset_ns = of_ray
    range_m, strength, tag, instance, cosine = of_hit
    out_strength, out_ring, out_offset_ns, out_tag, out_instance, out_cosine = out
    for row in range(len(kept)):
        hit = kept[row]
        ray = rays[hit]
        distance_m = range_m[hit] + noise_scale_m * noise[ray]
        for k in range(3):
            points_xyz_m[row, k] = local[ray, k] * distance_m
        out_strength[row], out_cosine[row] = strength[hit], cosine[hit]
        out_ring[row], out_offset_ns[row] = ring[ray], offset_ns[ray]
        out_tag[row], out_instance[row] = tag[hit], instance[hit]
