"""The lights of a night as the shaders read them: four texels of single precision each."""

import math

import numpy as np

from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.render.lighting.light_sources import Lights

TEXELS = 4
"""Texels of a light."""
LIST_COLUMNS = 512
"""Lights in a row of the image that holds them."""


def surface_lights(lights: Lights, eye_m: Array, exposure: float) -> F32:
    """Lights of surfaces, and a last row of zeros that is no light, shape (N + 1, 16).

    =====  ==========================================================  ==================================
    texel  xyz                                                         w
    =====  ==========================================================  ==================================
    0      place relative to the eye [m]                               1 / range² [1/m²]
    1      exposed intensity / π, of a low beam as a factor            most gain towards the beam's edge
    2      axis                                                        cosine to it where the beam ends
    3      left of a headlamp                                          1 / change of the cosine from there
                                                                       to the full beam
    =====  ==========================================================  ==================================

    Args:
        lights: Lights of a picture.
        eye_m: Camera in the world [m].
        exposure: Picture value per luminance [m²/cd].
    """
    begin, full = lights.edge.T
    return _table(
        (lights.position_m - eye_m, lights.range_m**-2.0),
        (lights.colour_cd * (exposure / math.pi), lights.cap),
        (lights.axis, begin),
        (lights.left, 1.0 / (full - begin)),
    )


def fog_lights(lights: Lights, eye_m: Array, exposure: float, glow_range_m: Array) -> F32:
    """Lights of the air in the same layout, shape (N + 1, 16).

    The second texel has the exposed intensity / π that lights the air, the first 1 / glow range².

    Args:
        lights: Lights of a picture.
        eye_m: Camera in the world [m].
        exposure: Picture value per luminance [m²/cd].
        glow_range_m: How far from each the air is seen to glow [m], shape (N,).
    """
    hue = lights.colour_cd / np.maximum(lights.colour_cd.max(axis=1, initial=0.0)[:, None], 1e-9)
    none = np.zeros(len(lights))
    return _table(
        (lights.position_m - eye_m, np.maximum(glow_range_m, 1e-3) ** -2.0),
        (hue * (lights.glow_cd * exposure / math.pi)[:, None], none),
        (lights.axis, none),
        (np.zeros((len(lights), 3)), none),
    )


def _table(*texels: tuple[Array, Array]) -> F32:
    """Texels of N lights, xyz (N, 3) and w (N,) each, and a last row of zeros."""
    rows = np.column_stack([part for texel in texels for part in texel])
    return np.concatenate([rows, np.zeros((1, 4 * TEXELS))]).astype(np.float32)
