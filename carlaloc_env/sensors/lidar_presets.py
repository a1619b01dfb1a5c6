"""Figures of LiDARs that people own, by makers' manuals and drivers; docs/lidars.md has the source of each.

Beams are listed from the lowest to the highest. Azimuths are positive to the left, as all angles here, though
makers count theirs clockwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from carlaloc_env.sensors.lidar_patterns import FanPattern, WedgePattern

HDL32E_ELEVATIONS_DEG: tuple[float, ...] = (
    -30.67, -29.33, -28.0, -26.67, -25.33, -24.0, -22.67, -21.33, -20.0, -18.67, -17.33, -16.0, -14.67,
    -13.33, -12.0, -10.67, -9.33, -8.0, -6.67, -5.33, -4.0, -2.67, -1.33, 0.0, 1.33, 2.67, 4.0, 5.33,
    6.67, 8.0, 9.33, 10.67,
)  # fmt: skip
"""Beams of the Velodyne HDL-32E [deg]; user manual, page 13."""
HDL32E_FIRING_NS: tuple[int, ...] = tuple(1152 * (2 * r if r < 16 else 2 * (r - 16) + 1) for r in range(32))
"""When each beam of the HDL-32E fires in its 46.08 µs cycle [ns]: lower and upper bank alternate."""
HDL32E_CYCLE_NS = 50e6 / 1085
"""The manual's 46.08 µs, 0.006 % more, so that a revolution of 50 ms has whole columns [ns]."""
HDL32E: Mapping[str, Any] = {
    "elevations_deg": HDL32E_ELEVATIONS_DEG,
    "elevation_offset_deg": 0.02,
    "firing_ns": HDL32E_FIRING_NS,
    "columns": 0,
    "cycle_ns": HDL32E_CYCLE_NS,
}
"""Beams and times of the HDL-32E."""
_VLP16_UP_MM = (11.2, 9.7, 8.1, 6.6, 5.1, 3.7, 2.2, 0.7, -0.7, -2.2, -3.7, -5.1, -6.6, -8.1, -9.7, -11.2)
_HDL64E_BLOCK = (
    *(6, 7, 10, 11, 0, 1, 4, 5, 8, 9, 14, 15, 18, 19, 22, 23),
    *(12, 13, 16, 17, 20, 21, 26, 27, 30, 31, 2, 3, 24, 25, 28, 29),
)
"""Lasers of each block of an HDL-64E from the lowest to the highest."""
_HDL64E_AZIMUTHS_DEG = (
    (-1.98, 1.47, 4.83, 8.29, -7.46, -4.03, -0.68, 2.69, 6.09, 9.48, -8.69, -5.23),
    (-1.85, 1.40, 4.70, 7.93, -7.17, -3.91, -0.69, 2.59, 5.76, 9.13, -8.34, -5.10),
)
"""Azimuths of the lower and the upper block; they repeat after 12 lasers."""
_OS1_AZIMUTHS_DEG = (-4.21, -1.40, 1.40, 4.21)
"""Azimuths of an OS1's rows by their number modulo 4."""
_HELIOS_CHANNELS_DEG = (
    15.0, 13.0, 11.0, 9.0, 7.0, 5.5, 4.0, 2.67, 1.33, 0.0, -1.33, -2.67, -4.0, -5.33, -6.67, -8.0, -10.0,
    -16.0, -13.0, -19.0, -22.0, -28.0, -25.0, -31.0, -34.0, -37.0, -40.0, -43.0, -46.0, -49.0, -52.0, -55.0,
)  # fmt: skip


def _common(layout: str, cycle_ns: float, range_m: tuple[float, float], noise_m: float) -> dict[str, Any]:
    """Values that all have: driver, time of a column, 0 for columns by their number, range and its noise."""
    return {
        **{"rate_hz": 10.0, "attenuation_per_m": 0.0, "layout": layout, "columns": 0, "cycle_ns": cycle_ns},
        **{"range_min_m": range_m[0], "range_max_m": range_m[1], "range_noise_m": noise_m},
    }


def _os1(step: int) -> dict[str, Any]:
    """An OS1 of revision 7: of the 128 rows it has the first of each few."""
    rows = range(0, 128, step)[::-1]
    u = [(2 * row - 127) / 127 for row in rows]
    return {
        **_common("ouster", 0.0, (0.5, 90.0), 0.015),
        "elevations_deg": tuple(round(-0.760 - 22.25 * v + 0.019 * v * v + 1.025 * v * v * v, 3) for v in u),
        "azimuth_offsets_deg": tuple(_OS1_AZIMUTHS_DEG[row % 4] for row in rows),
        "origins_m": ((0.016721, 0.0, 0.0),),
        "rings_from_top": True,
        "columns": 1024,
    }


def _hdl64e() -> dict[str, Any]:
    lasers = [*(32 + laser for laser in _HDL64E_BLOCK), *_HDL64E_BLOCK]
    return {
        **_common("velodyne", 48_000.0, (0.9, 120.0), 0.02),
        "elevations_deg": (
            *(round(-24.33 + k / 2, 2) for k in range(32)),
            *(round(2.0 - (31 - k) / 3, 2) for k in range(32)),
        ),
        "azimuth_offsets_deg": tuple(_HDL64E_AZIMUTHS_DEG[k // 32][k % 32 % 12] for k in range(64)),
        "origins_m": tuple(
            (0.0, -0.026 if laser % 2 else 0.026, 0.20 if laser < 32 else 0.11) for laser in lasers
        ),
        "firing_ns": tuple(6000 * (laser % 32 // 4) + (0, 1260, 2460, 3660)[laser % 4] for laser in lasers),
    }


def _helios() -> dict[str, Any]:
    channels = sorted(range(32), key=lambda channel: _HELIOS_CHANNELS_DEG[channel])
    return {
        **_common("robosense", 55_560.0, (0.2, 150.0), 0.01),
        "elevations_deg": tuple(_HELIOS_CHANNELS_DEG[channel] for channel in channels),
        "origins_m": ((0.03498, 0.015, 0.0),),
        "firing_ns": tuple(1730 * channel for channel in channels),
    }


PRESETS: Mapping[str, Mapping[str, Any]] = {
    "vlp16": {
        **_common("velodyne", 55_296.0, (0.9, 100.0), 0.015),
        "elevations_deg": tuple(-15.0 + 2.0 * r for r in range(16)),
        "origins_m": tuple((0.0, 0.0, 1e-3 * up_mm) for up_mm in _VLP16_UP_MM),
        "firing_ns": tuple(2304 * (2 * r if r < 8 else 2 * (r - 8) + 1) for r in range(16)),
    },
    "hdl64e": _hdl64e(),
    "os1_32": _os1(4),
    "os1_64": _os1(2),
    "os1_128": _os1(1),
    "pandar_xt32": {
        **_common("hesai", 50_000.0, (0.05, 80.0), 0.005),
        "elevations_deg": tuple(r - 16.0 for r in range(32)),
        "rings_from_top": True,
        "firing_ns": tuple(368 + 1512 * (31 - r) for r in range(32)),
    },
    "helios_32": _helios(),
    "mid360": {
        **_common("livox", 20_000.0, (0.1, 40.0), 0.02),
        "elevations_deg": (-2.79, -0.93, 0.93, 2.79),
        "rings_from_top": True,
        "firing_ns": (15_000, 10_000, 5_000, 0),
        "pattern": FanPattern(
            turns_hz=182.41667,
            nods_hz=10.0,
            elevation_deg=(20.453, 23.523, 1.125, 2.300, 0.223, 0.156, 0.033),
            azimuth_deg=(28.428, 2.348, 2.692, 0.535, 0.304),
            tall_deg=(0.047, 0.117, 0.254, 2.765, 0.158, 0.541, 0.076),
            wide_deg=(0.048, 0.110, 0.278, 2.794, -0.201, -0.654, -0.099),
            field_deg=(-7.2, 52.2),
        ),
        "diffuse_intensity": 150.0,
    },
    "avia": {
        **_common("livox", 25_000.0, (1.0, 190.0), 0.02),
        "elevations_deg": (-2.170, -1.302, -0.434, 0.434, 1.302, 2.170),
        "rings_from_top": True,
        "firing_ns": (20_833, 16_667, 12_500, 8333, 4167, 0),
        "pattern": WedgePattern(
            wedge_deg=(27.12, 0.916, 26.50),
            turns_hz=(131.55, -213.15, -40.80),
            phase_deg=(180.0, 179.6, 0.0),
            inclined=("entry", "exit", "exit"),
            field_deg=(-38.6, 38.6),
            width_deg=70.6,
        ),
        "diffuse_intensity": 150.0,
    },
    "aeries2": {
        **_common("aeva", 0.0, (1.0, 500.0), 0.02),
        "elevations_deg": tuple(round(-15.0 + 30.0 * k / 79, 3) for k in range(80)),
        "columns": 1250,
        "span_deg": 120.0,
        "doppler": True,
    },
}
"""Values of LiDARs by the names of their presets."""
