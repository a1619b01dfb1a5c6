"""Falling snow: how many flakes of which size, how fast they fall and how much light they take away.

One law for cameras and LiDARs. The sizes of Gunn and Marshall, "The distribution with size of aggregate
snowflakes" (J. Meteorol. 15, 1958), are diameters of melted flakes: N₀ = 3.8·10³·S^−0.87 1/(m³ mm) and a
slope of 2.55·S^−0.48 1/mm at S mm/h of water. A flake of 0.1 g/cm³ is 10^(1/3) times as wide as its drop.
"""

from __future__ import annotations

import math

from carlaloc_env.core import elementary

SWELLING = 2.154434690031884
"""Diameter of a flake over that of its drop: the cube root of water's density over the flake's, 0.1 g/cm³.

Of flakes, 0.01 to 0.2 g/cm³ are observed (Hahner et al., "LiDAR snowfall simulation", 2022).
"""
ALBEDO = 0.9
"""Share of the light that a flake throws back, in the visible and at 905 nm (Hahner et al. 2022)."""


def intercept_per_m4(snowfall: float) -> float:
    """Number of flakes per volume and diameter at the diameter 0 [1/m⁴] for a rate [mm/h of water]."""
    return 3.8e6 / SWELLING * float(elementary.power(snowfall, -0.87)) if snowfall > 0 else 0.0


def slope_per_m(snowfall: float) -> float:
    """Decay of that number with the diameter [1/m] for a rate above 0 [mm/h of water]."""
    return 2550.0 / SWELLING * float(elementary.power(snowfall, -0.48))


def flakes_per_m3(snowfall: float, diameter_mm: float, width_mm: float) -> float:
    """Number of flakes of a class of diameters in a cubic metre."""
    if snowfall <= 0.0:
        return 0.0
    shape = float(elementary.exp(-1e-3 * slope_per_m(snowfall) * diameter_mm))
    return 1e-3 * intercept_per_m4(snowfall) * shape * width_mm


def extinction_per_m(snowfall: float) -> float:
    """Extinction by flakes that hide twice their cross-section [1/m]: 0.0033 at 1 mm/h, a sight of 0.9 km.

    ∫ 2·(π/4)·D²·N(D) dD = π·N₀/Λ³. Rasmussen et al., "The estimation of snowfall rate using visibility"
    (J. Appl. Meteorol. 38, 1999), have 0.0049·S for dry snow; single observations are off by 3 to 10 times.
    """
    if snowfall <= 0.0:
        return 0.0
    slope = slope_per_m(snowfall)
    return math.pi * intercept_per_m4(snowfall) / (slope * slope * slope)


def fall_mps(diameter_mm: float) -> float:
    """Speed of a falling aggregate of dendrites [m/s] (Locatelli and Hobbs, J. Geophys. Res. 79, 1974)."""
    return 0.8 * float(elementary.power(diameter_mm, 0.16))
