"""Fixed exposure of a weather: picture value, exposure time and electrons by the light on the ground."""

import math

import numpy as np

F_NUMBER = 2.0
"""Of the lens, a usual one of cameras that also drive by night."""
ELECTRONS_PER_CD_M2_S = 2000.0 * (2.8 / F_NUMBER) ** 2
"""Electrons in a pixel of 3 µm behind this lens per luminance and time [e⁻/(cd/m²·s)]."""
FULL_WELL_E = 10000.0
"""Most electrons in such a pixel [e⁻]."""
READ_NOISE_E = 2.0
"""Standard deviation of reading it [e⁻]."""


SNOW_VALUE, SNOW_NIGHT = 0.65, 0.7
"""Picture value of level snow by day, a stop above a grey exposure as photographers have it; and the share of
the exposure that lit snow leaves by night."""


def exposure(horizontal_lx: float, snow_cover: float = 0.0, *, night: bool = False) -> float:
    """Picture value per luminance [m²/cd] of a fixed exposure for an illuminance of the ground [lx].

    ``1 / (1.2 · 2^EV100)`` (Lagarde and de Rousiers 2014). It belongs to the weather, not to the
    picture, so that it has no history and brighter streets stay brighter.
    """
    log_lx = math.log10(max(horizontal_lx, 0.1))
    ev100 = float(np.interp(log_lx, [0.7, 1.5, 3.0, 4.0, 4.3, 4.9], [2.8, 4.0, 10.0, 12.8, 13.62, 13.5]))
    bare = float(1.0 / (1.2 * 2.0**ev100))
    if snow_cover <= 0.0:
        return bare
    # Level snow has the luminance 0.28 · E.
    whole = SNOW_NIGHT if night else SNOW_VALUE / (0.28 * bare * horizontal_lx)
    return float(bare * whole**snow_cover)


def exposure_time_s(value_per_cd_m2: float) -> float:
    """Exposure time [s] that belongs to an `exposure`: f/2 and ISO 100, within 2 to 15 ms.

    Beyond 15 ms a camera on a moving car raises its gain instead.
    """
    return float(np.clip(F_NUMBER**2 * 1.2 * value_per_cd_m2, 0.002, 0.015))


def electrons(value_per_cd_m2: float) -> float:
    """Electrons of a pixel at picture value 1 [e⁻]: 10 000 by day, some hundred in a lit street at night."""
    gathered = ELECTRONS_PER_CD_M2_S * exposure_time_s(value_per_cd_m2) / value_per_cd_m2
    return min(gathered, FULL_WELL_E)
