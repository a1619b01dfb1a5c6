"""Pairs of rays and upright cylinders that may meet, without a test of every pair."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.jit import compiled

_FEW_PAIRS = 20_000
"""Pairs up to which a test of each costs less than sectors."""
_SECTORS = 1024
"""Sectors of the horizon; each knows the cylinders that can be seen in it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cylinders:
    """Upright cylinders, parallel arrays of A."""

    centre_m: Array
    """Middles [m], shape (A, 3)."""
    radius_m: Array
    """Radii [m], shape (A,)."""
    half_height_m: Array
    """Half heights [m], shape (A,)."""


def candidates(
    origins_m: ArrayLike, directions: ArrayLike, limit_m: F32, cylinders: Cylinders
) -> tuple[Index, Index]:
    """All (ray, cylinder) pairs that may meet.

    The horizon, seen from where the rays start, is parted into sectors. A cylinder is listed in those
    that it covers; a ray then tests the cylinders of its own sector. Rays may start anywhere in a
    small volume, by which the cylinders are grown.

    Args:
        origins_m: Starts [m], shape (N, 3).
        directions: Unit directions, shape (N, 3).
        limit_m: Length of each ray [m], shape (N,).
        cylinders: Upright cylinders, one per actor.

    Returns:
        Ray indices (M,) and actor indices (M,), in the order of rays, then of actors.
    """
    starts, along = (np.asarray(part, dtype=np.float32) for part in (origins_m, directions))
    if len(along) * len(cylinders.radius_m) <= _FEW_PAIRS:
        return _meeting(starts, along, limit_m, cylinders)
    # Axis by axis: numpy takes ten times as long over rows of three.
    lowest, highest = (np.array([end(axis) for axis in starts.T], np.float64) for end in (np.min, np.max))
    eye, spread = 0.5 * (lowest + highest), 0.5 * (highest - lowest)
    away = cylinders.centre_m - eye
    radius_m = cylinders.radius_m + math.hypot(spread[0], spread[1]) + 0.01
    tall = cylinders.half_height_m + spread[2] + 0.01
    near = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) - radius_m < float(limit_m.max()))
    first, listed = _seen_in_sectors(away[near], radius_m[near])
    around = np.column_stack([away, radius_m, tall])[near].astype(np.float32)
    room = len(along)
    while True:
        rays, actors = np.empty(room, np.intp), np.empty(room, np.intp)
        count = _pairs(along, limit_m, first, listed, around, rays, actors)
        if count <= room:
            return rays[:count], near[actors[:count]]
        room = count


def _meeting(starts_m: F32, directions: F32, limit_m: F32, cylinders: Cylinders) -> tuple[Index, Index]:
    """The pairs of `_pairs` by a test of each: rays may start far from each other."""
    starts, (dx, dy, dz) = starts_m.astype(np.float64), directions.astype(np.float64).T[:, :, None]
    centre, radius_m, tall_m = cylinders.centre_m, cylinders.radius_m + 0.01, cylinders.half_height_m + 0.01
    flat = np.maximum(np.hypot(dx, dy), 1e-3)
    # Rays that all rise are soon above what is low.
    above_m, rise = centre[:, 2] + tall_m - starts[:, 2].min(), float(np.min(dz / flat))
    away = np.maximum(np.maximum(starts.min(axis=0) - centre, centre - starts.max(axis=0)), 0.0)
    near = np.flatnonzero((np.hypot(away[:, 0], away[:, 1]) - radius_m) * rise <= above_m)
    if rise > 0.0:
        centre, radius_m, tall_m = centre[near], radius_m[near], tall_m[near]
    x, y, z = np.moveaxis(centre[None] - starts[:, None], -1, 0)
    square, half_chord, along = flat * flat, radius_m * flat, x * dx + y * dy
    far = limit_m.astype(np.float64)[:, None] * square
    meets = (np.abs(x * dy - y * dx) < half_chord) & (-half_chord < along) & (along < far + half_chord)
    meets &= np.abs(dz * along - z * square) < tall_m * square + np.abs(dz) * flat * radius_m
    rays, actors = np.nonzero(meets)
    return rays, near[actors] if rise > 0.0 else actors


def _seen_in_sectors(away_m: Array, radius_m: Array) -> tuple[Index, Index]:
    """Where the list of each sector begins (sectors + 1,), and the cylinders of all lists, ascending."""
    flat = np.hypot(away_m[:, 0], away_m[:, 1])
    half = elementary.arcsin(np.minimum(radius_m / np.maximum(flat, 1e-9), 1.0))
    middle = elementary.arctan2(away_m[:, 1], away_m[:, 0])
    # A sector to either side covers the rounding of float32.
    low = np.floor(_on_square(middle - half) * (_SECTORS / 4)).astype(np.intp) - 1
    high = np.floor(_on_square(middle + half) * (_SECTORS / 4)).astype(np.intp) + 1
    count = np.where(flat > radius_m, np.minimum((high - low) % _SECTORS + 1, _SECTORS), _SECTORS)
    cylinder = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(cylinder)) - np.repeat(np.cumsum(count) - count, count)
    sector = (low[cylinder] + step) % _SECTORS
    first = np.concatenate([[0], np.cumsum(np.bincount(sector, minlength=_SECTORS))])
    return first.astype(np.intp), cylinder[np.argsort(sector, kind="stable")]


def _on_square(angle_rad: Array) -> Array:
    """Position on the outline of the square |x| + |y| = 1 of directions, 0–4 anticlockwise from east."""
    x, y = elementary.cos(angle_rad), elementary.sin(angle_rad)
    fraction = x / (np.abs(x) + np.abs(y))
    quadrant: Array = np.where(y >= 0, 1 - fraction, 3 + fraction)
    return quadrant


@compiled
def _pairs(
    directions: F32, limit_m: F32, first: Index, listed: Index, around: F32, rays: Index, actors: Index
) -> int:
    """Write the pairs that may meet, as many as there is room for, and count all.

    Args:
        directions: Unit directions, shape (N, 3).
        limit_m: Length of each ray [m], shape (N,).
        first: Where the list of each sector begins, shape (sectors + 1,).
        listed: Cylinders of all lists.
        around: Middle from the eye, radius, half height of each cylinder [m], shape (A, 5).
        rays: Receives the ray of each pair.
        actors: Receives the cylinder of each pair.
    """
    count = 0
    sectors = len(first) - 1
    for i in range(len(directions)):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        fraction = dx / max(abs(dx) + abs(dy), np.float32(1e-9))
        quadrant = np.float32(1) - fraction if dy >= 0 else np.float32(3) + fraction
        sector = min(int(quadrant * np.float32(sectors * 0.25)), sectors - 1)
        begin, end = first[sector], first[sector + 1]
        if begin == end:
            continue
        # All lengths below are in the plan and times `flat`, which spares divisions.
        flat = np.float32(max(math.sqrt(dx * dx + dy * dy), 1e-3))
        square, steep, far = flat * flat, abs(dz) * flat, limit_m[i] * flat * flat
        for k in range(begin, end):
            actor = listed[k]
            x, y, z = around[actor, 0], around[actor, 1], around[actor, 2]
            radius, tall = around[actor, 3], around[actor, 4]
            # Where the ray passes nearest to the axis, how far from it, and at which height.
            along, half_chord = x * dx + y * dy, radius * flat
            meets = abs(x * dy - y * dx) < half_chord and -half_chord < along < far + half_chord
            if meets and abs(dz * along - z * square) < tall * square + steep * radius:
                if count < len(rays):
                    rays[count], actors[count] = i, actor
                count += 1
    return count
