"""Beam divergence: several rays per beam, and the echo that their energies make."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.raycast import Hits

PULSE_LENGTH_M = 0.6
"""Surfaces nearer to each other than this give one echo between them [m]."""
_RING = 0.35
"""Where the rays around the middle lie, in beam widths: the radius that halves the beam's energy."""


def sub_rays(directions: Array, divergence_rad: float) -> Iterator[Array]:
    """Unit directions of four rays around each of N, a beam of full width `divergence_rad`, each (N, 3)."""
    flat = np.stack([-directions[:, 1], directions[:, 0], np.zeros(len(directions))], axis=-1)
    size = np.sqrt(np.sum(flat * flat, axis=-1))[:, None]
    sideways = np.where(size > 1e-9, flat / np.maximum(size, 1e-9), np.array([0.0, 1.0, 0.0]))
    above = transforms.cross(directions, sideways)
    for right, up in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        moved = directions + _RING * divergence_rad * (right * sideways + up * above)
        yield moved / np.sqrt(np.sum(moved * moved, axis=-1))[:, None]


def weigh(beams: list[Hits], power: Callable[[Hits], Array]) -> Hits:
    """One hit per beam out of its rays: the strongest group of surfaces, at its energy's middle.

    Args:
        beams: Hits of S rays of each of N beams, the middle ray first.
        power: ρ·cosθ of hits; echoes fall with R⁻² beyond it.
    """
    ranges = np.stack([hits.range_m.astype(np.float64) for hits in beams])
    met = np.isfinite(ranges)
    safe = np.where(met, ranges, 1.0)
    energy = np.where(met, np.stack([power(hits) for hits in beams]) / (safe * safe), 0.0)
    total, middle = np.zeros_like(ranges), np.zeros_like(ranges)
    for k in range(len(beams)):
        near = met & met[k] & (np.abs(ranges - safe[k]) < PULSE_LENGTH_M)
        group = np.where(near, energy, 0.0)
        total[k] = np.sum(group, axis=0)
        middle[k] = np.sum(group * safe, axis=0) / np.where(total[k] > 0, total[k], 1.0)
    # The middle ray decides between equals, and where nothing reflects at all.
    best = np.argmax(np.where(met, total * (1 + 1e-9 * (np.arange(len(beams)) == 0)[:, None]), -1.0), axis=0)
    result = Hits.none(len(best))
    for k, hits in enumerate(beams):
        rows = np.flatnonzero((best == k) & met[k])
        result.put(rows, hits.take(rows))
        result.range_m[rows] = np.where(total[k, rows] > 0, middle[k, rows], ranges[k, rows])
    return result
