"""The lights of a night as the shaders read them: eight words each, since every word read costs time.

Places and what low beams have alone are in single precision, directions within 1/65534; what else there
is has seven bits and an exponent, which is within 0.4 %.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.render.lighting.light_sources import HEADLAMP_COLOUR, Lights

Words = NDArray[np.uint32]
"""Words as the shaders read them."""


def surface_words(lights: Lights, eye_m: Array, exposure: float) -> Words:
    """What lights surfaces; one more row than there are lights, the last of which is no light, (N + 1, 8).

    ====  =======================================  =====================================
    word  lamps                                    low beams
    ====  =======================================  =====================================
    0–2   place relative to the eye [m]            the same
    3     exposed intensity / π, red and green     that of the beam, as a factor
    4     blue; gain towards the beam's edge       1 / range² [1/m²]
    5     axis, x and y                            the same
    6     axis z; 1 / range² [1/m²]                axis z; left x
    7     cosine to the axis where the beam ends;  left y and z
          1 / way of the cosine from there to the
          full beam
    ====  =======================================  =====================================

    Args:
        lights: Lights of a picture.
        eye_m: Camera in the world [m].
        exposure: Picture value per luminance [m²/cd].
    """
    words, rows = _placed(lights, eye_m)
    strength = lights.colour_cd * (exposure / math.pi)
    per_range2 = 1.0 / lights.range_m**2
    axis, left = _fixed(lights.axis), _fixed(lights.left)
    begin, full = lights.edge.T
    # All headlamps have one colour, which the shader knows.
    factor = (strength[:, 1] / HEADLAMP_COLOUR[1]).astype("<f4").view(np.uint32)
    red_green = _joined(_short(strength[:, 0]), _short(strength[:, 1]))
    blue_gain = _joined(_short(strength[:, 2]), _short(lights.cap))
    rows[:, 3] = np.where(lights.beam, factor, red_green)
    rows[:, 4] = np.where(lights.beam, per_range2.astype("<f4").view(np.uint32), blue_gain)
    rows[:, 5] = _joined(axis[:, 0], axis[:, 1])
    rows[:, 6] = _joined(axis[:, 2], np.where(lights.beam, left[:, 0], _short(per_range2)))
    edge = _joined(_short(begin), _short(1.0 / (full - begin)))
    rows[:, 7] = np.where(lights.beam, _joined(left[:, 1], left[:, 2]), edge)
    return words


def air_words(lights: Lights, eye_m: Array, exposure: float, glow_range_m: Array) -> Words:
    """What lights the air; one more row than there are lights, the last of which is no light, (N + 1, 8).

    Words 0–2 and 5 as for surfaces; 3 exposed intensity / π, red and green; 4 blue, and 1 / reach²
    [1/m²]; 6 axis z; 7 nothing.

    Args:
        lights: Lights of a picture.
        eye_m: Camera in the world [m].
        exposure: Picture value per luminance [m²/cd].
        glow_range_m: How far from each the air is seen to glow [m], shape (N,).
    """
    words, rows = _placed(lights, eye_m)
    hue = lights.colour_cd / np.maximum(lights.colour_cd.max(axis=1, initial=0.0)[:, None], 1e-9)
    glow = hue * (lights.glow_cd * exposure / math.pi)[:, None]
    axis = _fixed(lights.axis)
    rows[:, 3] = _joined(_short(glow[:, 0]), _short(glow[:, 1]))
    rows[:, 4] = _joined(_short(glow[:, 2]), _short(1.0 / np.maximum(glow_range_m, 1e-3) ** 2))
    rows[:, 5] = _joined(axis[:, 0], axis[:, 1])
    rows[:, 6] = axis[:, 2] << np.uint32(16)
    return words


def _placed(lights: Lights, eye_m: Array) -> tuple[Words, Words]:
    """The table with the places of the lights, and the rows of it that are lights."""
    words = np.zeros((len(lights) + 1, 8), np.uint32)
    rows = words[: len(lights)]
    rows[:, :3] = (lights.position_m - eye_m).astype("<f4").view(np.uint32)
    return words, rows


def _short(values: Array) -> Words:
    """Upper half of single-precision numbers, rounded to the nearest."""
    bits = values.astype("<f4").view(np.uint32)
    return np.asarray((bits + np.uint32(0x8000)) >> np.uint32(16), dtype=np.uint32)


def _fixed(values: Array) -> Words:
    """Numbers from −1 to 1 in sixteen bits of two's complement."""
    return np.rint(values * 32767.0).astype(np.int16).view(np.uint16).astype(np.uint32)


def _joined(high: Words, low: Words) -> Words:
    return np.asarray(high << np.uint32(16) | low, dtype=np.uint32)


UNSEEN_STEP, UNSEEN_NOISE = 0.25, 0.2
"""Changes that nobody sees, in steps of 8 bits and in standard deviations of the noise."""
