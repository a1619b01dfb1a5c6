"""How well a scan holds the LiDAR in place, by the information of its point-to-plane constraints.

Point-to-plane ICP minimises Σ (nᵢ · (R pᵢ + t − qᵢ))². Linearised at the true pose, point pᵢ with unit
normal nᵢ has the Jacobian Jᵢ = [(pᵢ × nᵢ)ᵀ, nᵢᵀ] for a small rotation and a shift, so that a scan of N
points has the information H = Σ JᵢᵀJᵢ / N per point, for errors of 1 m along the normals. Its eigenvalues
tell where an odometry degenerates (Zhang, Kaess, Singh: On Degeneracy of Optimization-based State Estimation
Problems, ICRA 2016; Tuna et al.: X-ICP, T-RO 2023). Rotation is unknown, too: what is left for the shift of
the sensor is the Schur complement S = H_tt − H_tr H_rr⁻¹ H_rt, the inverse of its marginal covariance. The
least eigenvalue of S lies between 0, where a shift goes unseen, and 1/3, a box about the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from carlaloc_env.core.array_types import Array, Mask

_LEAST_SPREAD = 1e-9
"""Rotations that move no point are left out of the inverse, below this share of the strongest."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Localizability:
    """How strongly a scan holds a shift of the sensor."""

    strengths: Array
    """Eigenvalues of the information about the shift per point, ascending, shape (3,)."""
    directions: Array
    """Unit directions that belong to them, along the axes of the points, columns of (3, 3)."""

    @property
    def least(self) -> float:
        """Strength along the weakest direction, 0 … 1/3."""
        return float(self.strengths[0])

    @property
    def weakest(self) -> Array:
        """Direction along which the sensor is held least, shape (3,)."""
        weakest: Array = self.directions[:, 0]
        return weakest


def localizability(points_m: Array, normals: Array) -> Localizability:
    """Strength with which planes hold a shift, whatever the rotation.

    Args:
        points_m: Points from the sensor, along any axes [m], shape (N, 3).
        normals: Unit normals of the surfaces on which they lie, shape (N, 3); a row of zeros is a point that
            holds nothing, such as one on leaves, and still counts among the N.
    """
    strengths, directions = np.linalg.eigh(shift_information(points_m, normals))
    return Localizability(strengths=np.maximum(strengths, 0.0), directions=directions)


def shift_information(points_m: Array, normals: Array) -> Array:
    """Information about the shift per point with the rotation marginalised out, shape (3, 3).

    Args:
        points_m: Points from the sensor, along any axes [m], shape (N, 3).
        normals: Unit normals, or rows of zeros, shape (N, 3).
    """
    if not len(points_m):
        return np.zeros((3, 3))
    jacobian = np.concatenate([np.cross(points_m, normals), normals], axis=1)
    information = jacobian.T @ jacobian / len(points_m)
    rotation, coupling, shift = information[:3, :3], information[:3, 3:], information[3:, 3:]
    known = np.linalg.pinv(rotation, rcond=_LEAST_SPREAD, hermitian=True)
    left: Array = shift - coupling.T @ known @ coupling
    return left


def plane_normals(
    points_m: Array, neighbours: int = 12, *, reach_m: float = 1.5, roughness_m: float = 0.1
) -> Array:
    """Unit normals of planes through each point's nearest neighbours, rows of zeros where there is no plane.

    For clouds without known surfaces. FAST-LIO2 accepts planes by the same kind of test.

    Args:
        points_m: Points of one or of several aligned scans [m], shape (N, 3).
        neighbours: Points of a plane, the point itself among them.
        reach_m: All of them lie this near [m].
        roughness_m: None lies farther from the plane than this [m].
    """
    normals = np.zeros((len(points_m), 3))
    if len(points_m) < neighbours:
        return normals
    found = cKDTree(points_m).query(points_m, neighbours)
    distance, near = np.asarray(found[0]), np.asarray(found[1])
    away = points_m[near] - points_m[near].mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", away, away))
    across = axes[:, :, 0]
    flat = np.abs(np.einsum("nki,ni->nk", away, across)).max(axis=1) < roughness_m
    # Neighbours on one ring of the LiDAR are a line, through which any plane passes.
    flat &= (spread[:, 1] > 0.02 * spread[:, 2]) & (distance[:, -1] < reach_m)
    normals[flat] = across[flat]
    return normals


def longest_below(station_m: Array, values: Array, limit: float) -> tuple[float, float]:
    """Longest stretch along which values stay below a limit: its length and its beginning [m].

    Args:
        station_m: Evenly spaced stations, ascending [m], shape (K,).
        values: Value at each, shape (K,).
        limit: What they are compared with.
    """
    below: Mask = values < limit
    if not below.any():
        return 0.0, 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], below, [False]]).astype(np.int8)))
    first, last = edges[::2], edges[1::2]
    longest = int(np.argmax(last - first))
    step = float(station_m[1] - station_m[0]) if len(station_m) > 1 else 0.0
    return float(last[longest] - first[longest]) * step, float(station_m[first[longest]])


def weakest_stretch(station_m: Array, values: Array, length_m: float = 100.0) -> tuple[float, float]:
    """Least mean over a stretch of some length, and where that begins [m].

    Args:
        station_m: Evenly spaced stations, ascending [m], shape (K,).
        values: Value at each, shape (K,).
        length_m: Length of the stretch [m]; the whole line where it is shorter.
    """
    step = float(station_m[1] - station_m[0]) if len(station_m) > 1 else length_m
    window = min(max(round(length_m / step), 1), len(values))
    sums = np.concatenate([[0.0], np.cumsum(values)])
    means = (sums[window:] - sums[:-window]) / window
    worst = int(np.argmin(means))
    return float(means[worst]), float(station_m[worst])
