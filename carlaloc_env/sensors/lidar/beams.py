"""Beams of several rays: the hit that they make together, and beams on edges."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.raycast import Hits
from carlaloc_env.scene.materials import Material
from carlaloc_env.sensors.lidar_config import ReceiverConfig

PULSE_LENGTH_M = 0.6
"""Surfaces nearer to each other than this give one echo between them [m]."""
_RING = 0.35
"""Where the rays around the middle lie, in beam widths: the radius that halves the beam's energy."""


def sub_rays(directions: Array, divergence_rad: float) -> Iterator[Array]:
    """Unit directions of four rays around each of N, a beam of full width `divergence_rad`, each (N, 3)."""
    sideways, above = _axes(directions)
    for right, up in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        moved = directions + _RING * divergence_rad * (right * sideways + up * above)
        yield moved / np.sqrt(np.sum(moved * moved, axis=-1))[:, None]


def weigh(beams: list[Hits], power: Callable[[Hits], Array]) -> tuple[Hits, Array]:
    """One hit per beam out of its rays: the strongest group of surfaces, at its energy's middle.

    Besides the hits (N), the energy of each over that of a whole beam on such a surface, shape (N,).

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
    result, share = Hits.none(len(best)), np.ones(len(best))
    for k, hits in enumerate(beams):
        rows = np.flatnonzero((best == k) & met[k])
        result.put(rows, hits.take(rows))
        result.range_m[rows] = np.where(total[k, rows] > 0, middle[k, rows], ranges[k, rows])
        share[rows] = total[k, rows] / (len(beams) * np.maximum(energy[k, rows], 1e-12))
    return result, share


EDGE_M = 0.3
"""Least step of the range between neighbouring beams at which a beam is cast again in parts [m]."""


def _axes(directions: Array) -> tuple[Array, Array]:
    """Unit vectors across N unit directions, level and above, each (N, 3)."""
    flat = np.stack([-directions[:, 1], directions[:, 0], np.zeros(len(directions))], axis=-1)
    size = np.sqrt(np.sum(flat * flat, axis=-1))[:, None]
    sideways = np.where(size > 1e-9, flat / np.maximum(size, 1e-9), np.array([0.0, 1.0, 0.0]))
    return sideways, transforms.cross(directions, sideways)


def part_beams(directions: Array, receiver: ReceiverConfig) -> Iterator[Array]:
    """Unit directions of some rays of equal energy in each of N beams, evenly lit rectangles, each (N, 3).

    Args:
        directions: Unit directions of the beams' middles, shape (N, 3).
        receiver: Has the beams' widths and the number of rays.
    """
    sideways, above = _axes(directions)
    wide, tall = (1e-3 * width for width in receiver.beam_mrad)
    for k in range(receiver.edge_rays):
        right = ((k + 0.5) / receiver.edge_rays - 0.5) * wide
        up = (0.25 if k % 2 else -0.25) * tall
        moved = directions + right * sideways + up * above
        yield moved / np.sqrt(np.sum(moved * moved, axis=-1))[:, None]


def on_edges(range_m: F32, material: NDArray[np.uint8], columns: int) -> NDArray[np.bool_]:
    """Whether the neighbours of a beam in its own ring lie on other surfaces, shape (rays,).

    Along a plane 1/R is linear in the tangent of the azimuth, so its second difference is a bend. Within one
    crown parts of a beam are nearer to each other than a pulse is long.

    Args:
        range_m: Distances of all rays column by column, inf where nothing is [m], shape (rays,).
        material: Materials there, shape (rays,).
        columns: Columns of the revolution.
    """
    near = (1.0 / range_m.astype(np.float64)).reshape(columns, -1)
    before, after = np.roll(near, 1, axis=0), np.roll(near, -1, axis=0)
    nearest = np.maximum(np.maximum(before, after), near)
    leafy = (material == Material.LEAF).reshape(columns, -1)
    crown = leafy & np.roll(leafy, 1, axis=0) & np.roll(leafy, -1, axis=0)
    bent = np.abs(before + after - 2.0 * near) > EDGE_M * nearest * nearest
    edges: NDArray[np.bool_] = (bent & ~crown).reshape(-1)
    return edges
