"""Loops over drops, compiled by numba."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.render.lighting.low_beam import low_beam


@compiled
def mixed(x: np.uint32) -> np.uint32:
    """Hash of a number."""
    x = np.uint32(x ^ (x >> np.uint32(16)))
    x = np.uint32(x * np.uint32(0x7FEB352D))
    x = np.uint32(x ^ (x >> np.uint32(15)))
    x = np.uint32(x * np.uint32(0x846CA68B))
    return np.uint32(x ^ (x >> np.uint32(16)))


@inlined
def _reaches(x: float, y: float, z: float, normals: Array, offsets: Array) -> bool:
    """Whether a cell with its middle there may reach inside all planes; 0.87 is half its diagonal."""
    for p in range(len(offsets)):
        if normals[p, 0] * x + normals[p, 1] * y + normals[p, 2] * z + offsets[p] <= -0.87:
            return False
    return True


@compiled
def fill(
    out: Array,
    low: NDArray[np.int64],
    high: NDArray[np.int64],
    most: int,
    share: np.uint32,
    key: np.uint32,
    home: Array,
    normals: Array,
    offsets: Array,
) -> int:
    """Write the drops of a box of cells that lie inside all planes to `out`, and count them.

    Without room for all of them it stops at the first that finds none, which it counts, too.

    Args:
        out: Places from the eye in units of cells of 1 m, shape (N, 3).
        low: First cell along x, y and z, shape (3,).
        high: Last cell, shape (3,).
        most: Drops that a cell may have.
        share: Share of them that it has, of 2**32.
        key: Chooses the pattern.
        home: Eye in the lattice's frame [m], shape (3,).
        normals: Inward normals of planes, shape (P, 3).
        offsets: Their offsets from the eye [m], shape (P,).
    """
    count = 0
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            for k in range(low[2], high[2] + 1):
                if not _reaches(
                    (i + 0.5) - home[0], (j + 0.5) - home[1], (k + 0.5) - home[2], normals, offsets
                ):
                    continue
                h = mixed(np.uint32(key ^ np.uint32(i & 0xFFFFFFFF)))
                h = mixed(np.uint32(h ^ np.uint32(j & 0xFFFFFFFF)))
                h = mixed(np.uint32(h ^ np.uint32(k & 0xFFFFFFFF)))
                for drop in range(most):
                    lot = mixed(np.uint32(h + np.uint32(drop) * np.uint32(0x9E3779B9)))
                    if lot >= share:
                        continue
                    if count == len(out):
                        return count + 1
                    for axis in range(3):
                        cell = i if axis == 0 else j if axis == 1 else k
                        lot = mixed(np.uint32(lot + np.uint32(0x85EBCA6B)))
                        out[count, axis] = (cell + lot * 2.0**-32) - home[axis]
                    inside = True
                    for p in range(len(offsets)):
                        gap = offsets[p]
                        for axis in range(3):
                            gap += normals[p, axis] * out[count, axis]
                        inside = inside and gap > 0.0
                    if inside:
                        count += 1
    return count


@compiled
def shine(
    out: Array,
    drops: Array,
    lamps: Array,
    axes: Array,
    lefts: Array,
    ups: Array,
    colours: Array,
    caps: Array,
    edges: Array,
    ranges: Array,
    beams: NDArray[np.bool_],
) -> None:
    """Add the luminance [cd/m²] that lamps give to drops; places are relative to the eye [m]."""
    for i in range(len(drops)):
        far = math.sqrt(drops[i, 0] ** 2 + drops[i, 1] ** 2 + drops[i, 2] ** 2)
        for k in range(len(lamps)):
            x, y, z = drops[i, 0] - lamps[k, 0], drops[i, 1] - lamps[k, 1], drops[i, 2] - lamps[k, 2]
            r2 = max(x * x + y * y + z * z, 0.25)
            ratio = r2 / (ranges[k] * ranges[k])
            if ratio >= 1.0:
                continue
            r = math.sqrt(r2)
            x, y, z = x / r, y / r, z / r
            turn = -(x * drops[i, 0] + y * drops[i, 1] + z * drops[i, 2]) / far
            spread = 1.0 + 0.85**2 - 1.7 * turn
            phase = (0.75 * (1.0 - 0.85**2) / (spread * math.sqrt(spread)) + 0.25) / (4.0 * math.pi)
            fade = (1.0 - ratio * ratio) ** 2
            ahead = x * axes[k, 0] + y * axes[k, 1] + z * axes[k, 2]
            if beams[k]:
                left = x * lefts[k, 0] + y * lefts[k, 1] + z * lefts[k, 2]
                gain = low_beam(ahead, left, x * ups[k, 0] + y * ups[k, 1] + z * ups[k, 2])
            else:
                share = min(max((ahead - edges[k, 0]) / (edges[k, 1] - edges[k, 0]), 0.0), 1.0)
                gain = min(1.0 / (max(ahead, 0.0) ** 3 + 1e-3), caps[k]) * share * share * (3 - 2 * share)
            for channel in range(3):
                out[i, channel] += gain * phase * fade / r2 * colours[k, channel]
