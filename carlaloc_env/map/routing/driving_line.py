"""How far inside of a bend drivers go, for the nose of a car swings out."""

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_SIZE_M

EASE_M = 2.0
"""The way aside is the running mean over twice this length, taken twice [m]."""
_FROM_RADPM, _FULL_RADPM = 1.0 / 9.0, 1.0 / 6.0


def wanted_inside(curvature_radpm: Array) -> Array:
    """How far left of the lane's middle to drive [m] in bends (N,), before it is eased: in tight ones inside.

    Where the rear axle follows an arc of radius R, the outer front corner runs wider than the car's
    side by √((R + w/2)² + l²) − (R + w/2); half of that keeps both sides of the lane alike.
    """
    bend = np.maximum(np.abs(curvature_radpm), 1e-4)
    side = 1.0 / bend + 0.5 * EGO_SIZE_M[1]
    swing = np.sqrt(side * side + EGO_FRONT_M * EGO_FRONT_M) - side
    tight = np.clip((bend - _FROM_RADPM) / (_FULL_RADPM - _FROM_RADPM), 0.0, 1.0)
    result: Array = 0.5 * swing * tight * np.sign(curvature_radpm)
    return result


def inside_line(
    s_m: Array, xy_m: Array, heading_rad: Array, step_m: float = 0.5
) -> tuple[Array, Array, Array]:
    """How drivers go along lane middles: even distances [m] (M,), points (M, 2) and headings (M,)."""
    s = np.arange(0.0, s_m[-1] + 1e-9, step_m)
    h = np.interp(s, s_m, heading_rad)
    half = 2.0
    bend = (np.interp(s + half, s_m, heading_rad) - np.interp(s - half, s_m, heading_rad)) / (2 * half)
    aside = wanted_inside(bend)
    count = round(EASE_M / step_m)
    for _ in range(2):
        padded = np.pad(aside, count, mode="edge")
        aside = elementary.convolve(padded, np.full(2 * count + 1, 1.0 / (2 * count + 1)), mode="valid")
    xy = np.stack([np.interp(s, s_m, xy_m[:, k]) for k in range(2)], axis=-1)
    xy += aside[:, None] * np.stack([-elementary.sin(h), elementary.cos(h)], axis=-1)
    return s, xy, h + elementary.arctan(np.gradient(aside, step_m)) if len(s) > 1 else h
