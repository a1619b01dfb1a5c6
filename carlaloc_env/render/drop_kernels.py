"""Drops of rain in the cells of a lattice, and the light that lamps give them, compiled by numba."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.render.lighting.light_sources import LAMP_LEAST_M, batwing_gain, range_window
from carlaloc_env.render.lighting.low_beam import low_beam

_FORWARD = 0.85
"""g of the Henyey–Greenstein lobe into which drops scatter three quarters of a lamp's light."""
_batwing = inlined(batwing_gain)
_window = inlined(range_window)


@inlined
def mixed(x: np.uint32) -> np.uint32:
    """Hash of a number."""
    x = np.uint32(x ^ (x >> np.uint32(16)))
    x = np.uint32(x * np.uint32(0x7FEB352D))
    x = np.uint32(x ^ (x >> np.uint32(15)))
    x = np.uint32(x * np.uint32(0x846CA68B))
    return np.uint32(x ^ (x >> np.uint32(16)))


@inlined
def _ball(turned: float) -> float:
    """Light that a diffuse ball throws back over its mean in all directions, 8/3 straight back to the lamp.

    Lambert's law over the lit part of the ball: 8/(3π)·(sin θ − θ·cos θ) at the angle θ by which light turns
    (Schönberg, "On the brightness of planets", 1929).

    Args:
        turned: Cosine between the way from the lamp and the way from the eye.
    """
    angle = math.acos(min(max(-turned, -1.0), 1.0))
    return 8.0 / (3.0 * math.pi) * (math.sin(angle) - angle * math.cos(angle))


@inlined
def _least(x: float, y: float, z: float, planes: Array) -> float:
    """Signed distance [m] of a place to the nearest of planes, shape (K, 4): positive inside all of them."""
    least = math.inf
    for k in range(len(planes)):
        distance = x * planes[k, 0] + y * planes[k, 1] + z * planes[k, 2] + planes[k, 3]
        least = min(least, distance)
    return least


@compiled
def drops_in_cells(
    places: Array,
    low: NDArray[np.int64],
    high: NDArray[np.int64],
    home: Array,
    planes: Array,
    key: np.uint32,
    most: int,
    below: np.uint32,
) -> int:
    """Write the drops of cells of edge 1 that lie inside planes.

    Args:
        places: Room for places from the eye, shape (N, 3).
        low: First cell, shape (3,).
        high: Last cell, shape (3,).
        home: The eye in the lattice, shape (3,).
        planes: Normals and offsets, shape (K, 4).
        key: Of the lattice's hash.
        most: Most drops of a cell.
        below: Hash below which a drop is there.

    Returns:
        Number of drops.
    """
    count = 0
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            for k in range(low[2], high[2] + 1):
                # Half of a cell's diagonal is 0.87.
                if _least(i + 0.5 - home[0], j + 0.5 - home[1], k + 0.5 - home[2], planes) <= -0.87:
                    continue
                cell = mixed(mixed(mixed(key ^ np.uint32(i)) ^ np.uint32(j)) ^ np.uint32(k))
                for drop in range(most):
                    lot = mixed(np.uint32(cell + np.uint32(np.uint32(drop) * np.uint32(0x9E3779B9))))
                    if lot >= below:
                        continue
                    lot = mixed(np.uint32(lot + np.uint32(0x85EBCA6B)))
                    x = i + lot * 2.0**-32 - home[0]
                    lot = mixed(np.uint32(lot + np.uint32(0x85EBCA6B)))
                    y = j + lot * 2.0**-32 - home[1]
                    lot = mixed(np.uint32(lot + np.uint32(0x85EBCA6B)))
                    z = k + lot * 2.0**-32 - home[2]
                    if _least(x, y, z, planes) > 0.0:
                        places[count, 0], places[count, 1], places[count, 2] = x, y, z
                        count += 1
    return count


@compiled
def light_drops(
    shine: Array,
    drops: Array,
    lamps: Array,
    axes: Array,
    lefts: Array,
    ups: Array,
    colours: Array,
    edges: Array,
    caps: Array,
    ranges: Array,
    beams: NDArray[np.bool_],
    flake_albedo: float,
) -> None:
    """Add what lamps give to drops, see `lit`.

    Args:
        shine: Luminance of the drops [cd/m²], shape (N, 3).
        drops: Places from the eye [m], shape (N, 3).
        lamps: Places from the eye [m], shape (K, 3).
        axes: Middles of the beams, shape (K, 3).
        lefts: Left of headlamps, shape (K, 3).
        ups: Above headlamps, shape (K, 3).
        colours: Intensities [cd], shape (K, 3).
        edges: Cosines between which a beam ends, shape (K, 2).
        caps: Most gain, shape (K,).
        ranges: Where the light has faded to nothing [m], shape (K,).
        beams: Whether it is a low beam, shape (K,).
        flake_albedo: Of flakes, 0: they are drops.
    """
    for n in range(len(drops)):
        x, y, z = drops[n, 0], drops[n, 1], drops[n, 2]
        away = max(math.sqrt(x * x + y * y + z * z), 1e-9)
        for k in range(len(lamps)):
            u, v, w = x - lamps[k, 0], y - lamps[k, 1], z - lamps[k, 2]
            r2 = max(u * u + v * v + w * w, LAMP_LEAST_M * LAMP_LEAST_M)
            per_r = 1.0 / math.sqrt(r2)
            u, v, w = u * per_r, v * per_r, w * per_r
            ahead = u * axes[k, 0] + v * axes[k, 1] + w * axes[k, 2]
            if beams[k]:
                left = u * lefts[k, 0] + v * lefts[k, 1] + w * lefts[k, 2]
                gain = low_beam(ahead, left, u * ups[k, 0] + v * ups[k, 1] + w * ups[k, 2])
            else:
                gain = _batwing(ahead, edges[k, 0], edges[k, 1], caps[k])
            turned = (u * x + v * y + w * z) / away
            spread = 1.0 + _FORWARD**2 + 2.0 * _FORWARD * turned
            lobe = (1.0 - _FORWARD**2) / (spread * math.sqrt(spread))
            phase = (0.75 * lobe + 0.25) / (4.0 * math.pi)
            if flake_albedo > 0.0:
                phase = flake_albedo * _ball(turned) / (4.0 * math.pi)
            given = gain * _window(r2 / (ranges[k] * ranges[k])) * phase / r2
            for channel in range(3):
                shine[n, channel] += given * colours[k, channel]
