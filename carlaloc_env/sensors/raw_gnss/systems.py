"""Satellite systems: their signals, orbital planes and constants, as their interface documents give them."""

from __future__ import annotations

import math
from dataclasses import dataclass

LIGHT_MPS = 299_792_458.0
"""Speed of light [m/s]."""
GPS_EPOCH_NS = 315_964_800_000_000_000
"""Unix time of 1980-01-06, where GPS time begins [ns]."""
LEAP_S = 18
"""Seconds that GPS time is ahead of UTC since 2017 [s]; earlier dates have the same here."""
WEEK_S = 604_800
"""Length of a week [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """A signal on one carrier."""

    code: str
    """RINEX 3 code of carrier and channel, e.g. ``1C``."""
    frequency_hz: float
    """Carrier [Hz]."""
    number: int
    """Code of RTKLIB and gnss_comm, e.g. 1 for L1C."""
    noise: float = 1.0
    """Code noise over that of L1: a chip of L5 and E5 is a tenth as long; a third is assumed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """A constellation of circular orbits in planes, with its signals."""

    letter: str
    """Letter in RINEX."""
    signals: tuple[Signal, ...]
    """Signals, that of the first carrier first."""
    numbers: tuple[int, ...]
    """Numbers of the satellites (PRN), plane by plane."""
    first_number: int
    """Number of satellite 1 in RTKLIB and gnss_comm, less one."""
    radius_m: float
    """Semi-major axis [m]."""
    inclination_deg: float
    """Tilt against the equator [deg]."""
    nodes_deg: tuple[float, ...]
    """Right ascension of each plane's ascending node at `reference_unix_s` [deg]."""
    along_deg: tuple[tuple[float, ...], ...]
    """Arguments of latitude of each plane's satellites then [deg]."""
    reference_unix_s: int
    """Time of the elements [s since 1970]."""
    node_rate_radps: float
    """Drift of the nodes [rad/s]."""
    rate_radps: float | None = None
    """Rate along the orbit [rad/s]; None: Kepler's."""
    gm_m3ps2: float = 3.986004418e14
    """Earth's gravitational constant of the system [m³/s²]."""
    earth_rate_radps: float = 7.2921151467e-5
    """Rotation of the Earth in the system's formulas [rad/s]."""
    ahead_s: int = 0
    """Seconds that GPS time is ahead of the system's time [s]."""
    first_week: int = 0
    """GPS weeks before the system's week 0."""
    record_s: int = 7200
    """Time between two records of the navigation message [s]."""
    before_s: int = 0
    """Time that a record's reference lies before its use at least [s]."""
    accuracy_m: float = 2.4
    """Accuracy that RTKLIB reads in the usual messages: URA of 2 m as 2.4 m, SISA of 3.12 m as 2.96 m [m]."""
    signal_in_space_m: float = 0.5
    """True error of orbit and clock in a range, rms (Montenbruck et al., GPS Solutions 22, 2018) [m]."""
    clock_reference_hz: float = 0.0
    """Carrier whose group delay the clock contains; 0: the one without an ionosphere."""


_L1, _E5A, _E5B = 1575.42e6, 1176.45e6, 1207.14e6
SYSTEMS = {
    "gps": System(
        letter="G",
        signals=(
            Signal(code="1C", frequency_hz=_L1, number=1),
            Signal(code="2W", frequency_hz=1227.60e6, number=20),
            Signal(code="5Q", frequency_hz=_E5A, number=25, noise=1 / 3),
        ),
        numbers=tuple(range(1, 25)),
        first_number=0,
        radius_m=26_559_710.0,
        inclination_deg=55.0,
        nodes_deg=(272.847, 332.847, 32.847, 92.847, 152.847, 212.847),
        along_deg=(
            (268.126, 161.786, 11.676, 41.806),
            (80.956, 173.336, 309.976, 204.376),
            (111.876, 11.796, 339.666, 241.556),
            (135.226, 265.446, 35.156, 167.356),
            (197.046, 302.596, 66.066, 333.686),
            (238.886, 345.226, 105.206, 135.346),
        ),
        reference_unix_s=741_484_800,
        node_rate_radps=-7.8e-9,
        gm_m3ps2=3.986005e14,
    ),
    "galileo": System(
        letter="E",
        signals=(
            Signal(code="1C", frequency_hz=_L1, number=1),
            Signal(code="7Q", frequency_hz=_E5B, number=28, noise=1 / 3),
            Signal(code="5Q", frequency_hz=_E5A, number=25, noise=1 / 3),
        ),
        numbers=tuple(range(1, 25)),
        first_number=59,
        radius_m=29_599_800.0,
        inclination_deg=56.0,
        nodes_deg=(317.632, 77.632, 197.632),
        along_deg=tuple(tuple(first + 45.0 * k for k in range(8)) for first in (225.153, 240.153, 255.153)),
        reference_unix_s=1_479_686_400,
        node_rate_radps=math.radians(-0.027644) / 86_400.0,
        rate_radps=math.radians(613.72254) / 86_400.0,
        record_s=600,
        before_s=1,
        accuracy_m=2.96,
        signal_in_space_m=0.2,
    ),
    "beidou": System(
        letter="C",
        signals=(
            Signal(code="2I", frequency_hz=1561.098e6, number=40),
            Signal(code="7I", frequency_hz=_E5B, number=27),
        ),
        numbers=(*range(19, 31), *range(32, 38), *range(41, 47)),
        first_number=97,
        radius_m=27_906_100.0,
        inclination_deg=55.0,
        nodes_deg=(0.0, 120.0, 240.0),
        along_deg=tuple(tuple(15.0 * plane + 45.0 * k for k in range(8)) for plane in range(3)),
        reference_unix_s=1_479_686_400,
        node_rate_radps=math.radians(-0.03) / 86_400.0,
        earth_rate_radps=7.292115e-5,
        ahead_s=14,
        first_week=1356,
        record_s=3600,
        clock_reference_hz=1268.52e6,
    ),
}
"""Nominal constellations: SPS Performance Standard 2020, table 3.2-1; Galileo's reference constellation
(GSC); BeiDou's interface documents (its planes' nodes are not published: evenly spread from 0). GLONASS is
left out: its messages hold states, which receivers integrate, and so do not repeat circular orbits."""
