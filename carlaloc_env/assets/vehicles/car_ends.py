"""Nose and tail of a car: lamps, grille, bumper, plates' recesses, rear window."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from carlaloc_env.assets.decals import Decals
from carlaloc_env.assets.primitives import Look, circle
from carlaloc_env.assets.vehicles.body import plastic
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material

if TYPE_CHECKING:
    from carlaloc_env.assets.vehicles.car_models import CarSpec


REVERSE_TINT = (188, 190, 192)
"""Linear tint of unlit reversing lamps."""
AMBER_TINT = (180, 70, 4)
"""Tint of indicators that are off; they are made of plastic."""
STOP_TINT = (42, 3, 3)
"""Tint of the high stop lamp that is off; it is made of plastic."""
HOUSING = (20, 21, 23)
"""Tint of the dark inside of a headlamp."""
_RECESS = (3, 3, 3)


def add_front(decals: Decals, spec: CarSpec, *, low: bool = False) -> None:
    """Grille, bumper and headlamps."""
    half, tag = 0.5 * spec.shape.width_m, spec.tag
    dark, recess = plastic(tag), plastic(tag, _RECESS)
    chrome = Look(Material.METAL_GALVANISED, tag, (240, 240, 240))
    frame = chrome if spec.chrome else dark
    a, b, z0, z1 = spec.grille
    if low:
        decals.front(dark, band(a * half, b * half, z0, z1))
        decals.pair_front(Look(Material.LAMP_WHITE, tag, (110, 112, 115)), np.array(spec.head) * (half, 1.0))
        return
    bottom = spec.shape.clearance_m
    decals.front(dark, band(0.94 * half, 0.94 * half, bottom - 0.05, bottom + spec.valance_m))
    ia, ib, i0, i1 = spec.intake
    decals.front(dark, band(ia * half + 0.03, ib * half + 0.03, i0 - 0.02, i1 + 0.02), 1)
    decals.front(recess, band(ia * half, ib * half, i0, i1), 2)
    decals.front(dark, band(ia * half, ib * half, 0.5 * (i0 + i1) - 0.008, 0.5 * (i0 + i1) + 0.008), 3)
    decals.front(frame, band(a * half + 0.018, b * half + 0.018, z0 - 0.015, z1 + 0.015), 1)
    decals.front(recess, band(a * half, b * half, z0, z1), 2)
    for k in range(spec.bars):
        t = (k + 1) / (spec.bars + 1)
        z, w = z0 + t * (z1 - z0), (a + t * (b - a)) * half
        decals.front(frame, band(w, w, z - 0.007, z + 0.007), 3)
    decals.front(chrome, disc_outline(0.0, 0.5 * (z0 + z1), 0.04, 6), 4)
    _headlamps(decals, spec)
    decals.pair_front(recess, disc_outline(0.78 * half, i0 + 0.06, 0.055, 6), 2)
    decals.pair_front(plastic(tag, (60, 62, 64)), disc_outline(0.78 * half, i0 + 0.06, 0.035, 6), 3)


def _headlamps(decals: Decals, spec: CarSpec) -> None:
    """Dark housing, two projectors, a strip of daylight, an indicator at the outer end."""
    half, tag = 0.5 * spec.shape.width_m, spec.tag
    outline = np.array(spec.head) * (half, 1.0)
    decals.pair_front(plastic(tag, HOUSING), outline, 1)
    lamp, daylight = Look(Material.LAMP_WHITE, tag), Look(Material.LAMP_WHITE, tag, (225, 232, 240))
    for s in (0.14, 0.48):
        decals.pair_front(lamp, _slot(outline, s, s + 0.28, 0.26, 0.86), 2)
    decals.pair_front(daylight, _slot(outline, 0.05, 0.80, 0.04, 0.15), 2)
    decals.pair_front(plastic(tag, AMBER_TINT), _slot(outline, 0.86, 0.96, 0.25, 0.80), 2)


def add_rear(decals: Decals, spec: CarSpec, *, low: bool = False) -> None:
    """Tail lamps, bumper, rear window and what else a following driver sees."""
    half, tag = 0.5 * spec.shape.width_m, spec.tag
    outline = np.array(spec.tail) * (half, 1.0)
    lamp = Look(Material.LAMP_TAIL, tag)
    glass, dark = Look(Material.GLASS, tag), plastic(tag)
    if spec.rear_window is not None:
        a, b = spec.rear_window
        w = 0.78 * half
        if spec.barn_doors:
            decals.pair_rear(glass, [(0.06, a), (w, a), (0.95 * w, b), (0.06, b)])
        else:
            decals.rear(glass, band(w, 0.95 * w, a, b))
    if low:
        decals.pair_rear(lamp, outline)
        decals.rear(dark, band(0.93 * half, 0.93 * half, 0.0, spec.shape.clearance_m + spec.valance_m))
        return
    _tail_lamps(decals, outline, spec)
    gap = plastic(tag, (4, 4, 4))
    bottom = spec.shape.clearance_m
    decals.rear(dark, band(0.93 * half, 0.93 * half, bottom - 0.05, bottom + 1.3 * spec.valance_m))
    z = spec.plate_z[1]
    decals.rear(gap, band(0.33, 0.31, z - 0.085, z + 0.095), 1)
    chrome = Look(Material.METAL_GALVANISED, tag, (235, 235, 235))
    decals.rear(chrome if spec.chrome else dark, band(0.30, 0.30, z + 0.085, z + 0.105), 2)
    decals.rear(chrome, disc_outline(0.0, z + 0.17, 0.035, 6), 2)
    for k in range(spec.exhausts):
        pipe = disc_outline(0.62 * half, bottom + 0.07, 0.04, 8)
        (decals.pair_rear if k else decals.rear)(chrome, pipe, 2)
    if spec.barn_doors:
        decals.rear(gap, band(0.008, 0.008, bottom + 0.2, spec.shape.top[-1][1] - 0.08), 1)
        decals.pair_rear(dark, rectangle(0.03, 1.02, 0.16, 1.06), 2)
    elif spec.shape.bed is None:
        seam = min(float(outline[:, 1].min()), z - 0.12)
        decals.rear(gap, band(0.80 * half, 0.80 * half, seam - 0.006, seam + 0.006), 1)
    high = float(np.interp(spec.shape.roof_rear_d, *np.array(spec.shape.top).T)) - 0.07
    stop = plastic(tag, STOP_TINT)
    decals.rear(stop, band(0.17, 0.17, high - 0.028, high), 2)


def _tail_lamps(decals: Decals, outline: Array, spec: CarSpec) -> None:
    """Dark red lamp with a bright inner part, an indicator and a reversing lamp."""
    tag = spec.tag
    inner, outer = outline[:, 0].min(), outline[:, 0].max()
    upright = outline[:, 1].max() - outline[:, 1].min() > outer - inner
    if spec.tail_across:
        z1 = float(_edges(outline)[1](np.array([inner]))[0])
        look = Look(Material.LAMP_TAIL, tag, (150, 150, 150))
        decals.rear(look, band(inner, inner, z1 - 0.05, z1 - 0.01), 1)
    decals.pair_rear(plastic(tag, (20, 2, 2)), outline, 1)
    places = ((0.36, 0.98, 0.08, 0.92), (0.16, 0.33, 0.10, 0.90), (0.03, 0.13, 0.12, 0.88))
    if upright:
        places = ((0.06, 0.96, 0.46, 0.97), (0.08, 0.94, 0.20, 0.42), (0.10, 0.92, 0.04, 0.16))
    amber, white = (plastic(tag, tint) for tint in (AMBER_TINT, REVERSE_TINT))
    for look, place in zip((Look(Material.LAMP_TAIL, tag), amber, white), places, strict=True):
        decals.pair_rear(look, _slot(outline, *place), 2)


def _slot(outline: Array, s0: float, s1: float, t0: float, t1: float) -> Array:
    """Quadrilateral at shares of a lamp's width and of its height there."""
    inner, outer = outline[:, 0].min(), outline[:, 0].max()
    bottom, top = _edges(outline)
    ys = inner + np.array([s0, s1, s1, s0]) * (outer - inner)
    share = np.array([t0, t0, t1, t1])
    return np.stack([ys, bottom(ys) + share * (top(ys) - bottom(ys))], axis=-1)


def _edges(outline: Array) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Lower and upper edge of a convex outline as functions of y."""
    ys = np.unique(outline[:, 0])
    low, high = np.full(len(ys), np.inf), np.full(len(ys), -np.inf)
    closed = np.concatenate([outline, outline[:1]])
    for k, y in enumerate(ys):
        for p, q in pairwise(closed):
            if min(p[0], q[0]) - 1e-9 <= y <= max(p[0], q[0]) + 1e-9:
                t = 0.5 if abs(q[0] - p[0]) < 1e-9 else (y - p[0]) / (q[0] - p[0])
                at = (p[1], q[1]) if abs(q[0] - p[0]) < 1e-9 else (p[1] + t * (q[1] - p[1]),)
                low[k], high[k] = min(low[k], *at), max(high[k], *at)
    return (lambda y: np.interp(y, ys, low)), (lambda y: np.interp(y, ys, high))


def band(low_half: float, high_half: float, z0: float, z1: float) -> Array:
    """Outline of a symmetrical trapezium, shape (4, 2)."""
    return np.array([(-low_half, z0), (low_half, z0), (high_half, z1), (-high_half, z1)])


def rectangle(y0: float, z0: float, y1: float, z1: float) -> Array:
    """Outline of a rectangle between two of its corners, shape (4, 2)."""
    return np.array([(y0, z0), (y1, z0), (y1, z1), (y0, z1)])


def disc_outline(y: float, z: float, radius_m: float, sides: int) -> Array:
    """Outline of a circle, shape (N, 2)."""
    return np.array([y, z]) + radius_m * circle(sides, 0.5)
