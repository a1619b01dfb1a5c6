"""Pattern of a low beam for right-hand traffic: bells over angles, which shaders get as defines."""

from typing import Any

import numpy as np

from carlaloc_env.core.jit import inlined

LOW_BEAM_DEGREES = 57.29578
"""Degrees of a small angle's tangent."""
LOW_BEAM_LEAST_AHEAD = 0.05
"""Cosine to the axis from which on there is light."""
LOW_BEAM_BELLS = (
    (26000.0, 1.5, -1.0, 1 / 2.3, 1 / 0.9),
    (8000.0, 0.0, -1.8, 1 / 9.0, 1 / 1.8),
    (4200.0, 0.0, -4.5, 1 / 20.0, 1 / 3.5),
)
"""Below the cut-off: peak [cd], its place to the right and up [°], and widths along both [1/°]."""
LOW_BEAM_HAZE = (180.0, 0.0, 0.0, 1 / 25.0, 1 / 12.0)
"""The same of the light on both sides of the cut-off."""
LOW_BEAM_CUT_OFF = (-0.57, 0.268, 1.0)
"""Height of the cut-off on the left [°], its rise by a degree to the right, and where it ends [°]."""


def low_beam_cd(ahead: Any, left: Any, up: Any) -> Any:
    """Intensity of one lamp [cd]; components of a direction from it, numbers or arrays of one shape."""
    per_ahead = LOW_BEAM_DEGREES / np.maximum(ahead, LOW_BEAM_LEAST_AHEAD)
    h, v = -left * per_ahead, up * per_ahead
    level, rise, end = LOW_BEAM_CUT_OFF
    cut = np.minimum(level + np.maximum(h, 0.0) * rise, end)
    below = np.minimum(np.maximum(1.5 * (cut - v) + 0.5, 0.0), 1.0)
    below = below * below * (3.0 - 2.0 * below)
    light = 0.0 * h
    # (1 - x²/32)^16, which is a normal curve but for its end and takes no exponential.
    for cd, right_deg, up_deg, per_right, per_up in LOW_BEAM_BELLS:
        x, y = (h - right_deg) * per_right, (v - up_deg) * per_up
        light = light + cd * np.maximum(1.0 - (x * x + y * y) * 0.03125, 0.0) ** 16
    cd, right_deg, up_deg, per_right, per_up = LOW_BEAM_HAZE
    x, y = (h - right_deg) * per_right, (v - up_deg) * per_up
    haze = cd * np.maximum(1.0 - (x * x + y * y) * 0.03125, 0.0) ** 16
    return (below * light + haze) * (ahead > LOW_BEAM_LEAST_AHEAD)


low_beam = inlined(low_beam_cd)
"""`low_beam_cd` of numbers, inside compiled loops."""
