"""NMEA 0183 sentences of a receiver's epoch; heights are above the ellipsoid, with a geoid of 0."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any

from carlaloc_env.sensors.raw_gnss.systems import LEAP_S

_TALKERS = {"G": "GP", "E": "GA", "C": "GB"}
_KNOTS = 3600.0 / 1852.0
_IDS = {"G": 1, "E": 3, "C": 4}
"""Numbers of the systems in sentence GSA (NMEA 4.10)."""


def nmea_text(epoch: Mapping[str, Any]) -> str:
    """Sentences GGA, RMC, VTG, GST, ZDA, GSA and GSV of an epoch, each with its checksum.

    Args:
        epoch: Values of a `GnssRaw` by name.
    """
    seconds = round(epoch["tow_s"] - epoch["clock_s"] - LEAP_S, 3)
    when = datetime(1980, 1, 6) + timedelta(weeks=epoch["week"], seconds=seconds)
    clock = f"{when:%H%M%S}.{when.microsecond // 10_000:02d}"
    latitude, longitude, height = epoch["solution_deg_m"]
    valid = math.isfinite(latitude)
    used = sorted(set(epoch["satellite"])) if valid else []
    place = f"{_angle(latitude, 2, 'NS')},{_angle(longitude, 3, 'EW')}" if valid else ",,,"
    east, north, _ = epoch["velocity_enu_mps"] if valid else (0.0, 0.0, 0.0)
    speed = math.hypot(east, north)
    course = f"{math.degrees(math.atan2(east, north)) % 360.0:.2f}" if valid and speed > 0.1 else ""
    pdop, hdop, vdop = (min(value, 99.99) for value in epoch["dop"]) if valid else (99.99,) * 3
    high = f"{height:.3f}" if valid else ""
    sentences = [
        f"GNGGA,{clock},{place},{int(valid)},{min(len(used), 99):02d},{hdop:.2f},{high},M,0.0,M,,",
        f"GNRMC,{clock},{'A' if valid else 'V'},{place},{speed * _KNOTS:.3f},{course},{when:%d%m%y},,,"
        f"{'A' if valid else 'N'}",
        f"GNVTG,{course},T,,M,{speed * _KNOTS:.3f},N,{speed * 3.6:.3f},K,{'A' if valid else 'N'}",
        f"GNZDA,{clock},{when:%d,%m,%Y},00,00",
    ]
    if valid:
        covariance = epoch["solution_covariance_m2"]
        sigma = [math.sqrt(max(covariance[k][k], 0.0)) for k in (1, 0, 2)]
        sentences.append(f"GNGST,{clock},,,,,{sigma[0]:.3f},{sigma[1]:.3f},{sigma[2]:.3f}")
    for letter, talker in _TALKERS.items():
        mine = [name[1:] for name in used if name[0] == letter][:12]
        if mine:
            numbers = ",".join(mine) + "," * (12 - len(mine))
            sentences.append(f"GNGSA,A,3,{numbers},{pdop:.2f},{hdop:.2f},{vdop:.2f},{_IDS[letter]}")
        sentences += _in_view(epoch, letter, talker)
    return "".join(_checked(sentence) for sentence in sentences)


def _in_view(epoch: Mapping[str, Any], letter: str, talker: str) -> list[str]:
    """Sentences GSV of a system: elevation, azimuth and C/N0 of the first signal, four satellites each."""
    # Of several signals of a satellite, the first.
    cn0 = dict(zip(reversed(epoch["satellite"]), reversed(epoch["cn0_dbhz"]), strict=True))
    sky = zip(epoch["sky_satellite"], epoch["sky_elevation_deg"], epoch["sky_azimuth_deg"], strict=True)
    seen = [
        f"{name[1:]},{up:02.0f},{round(azimuth) % 360:03d},{f'{cn0[name]:02.0f}' if name in cn0 else ''}"
        for name, up, azimuth in sky
        if name[0] == letter
    ]
    count = -(-len(seen) // 4)
    return [
        f"{talker}GSV,{count},{k + 1},{len(seen):02d},{','.join(seen[4 * k : 4 * k + 4])}"
        for k in range(count)
    ]


def _angle(degrees: float, digits: int, signs: str) -> str:
    """Degrees and minutes, and the half of the Earth."""
    whole, parts = divmod(round(abs(degrees) * 60e7), 60 * 10_000_000)
    return f"{whole:0{digits}d}{parts / 1e7:010.7f},{signs[degrees < 0]}"


def _checked(sentence: str) -> str:
    """The sentence between ``$`` and its checksum."""
    total = 0
    for letter in sentence.encode("ascii"):
        total ^= letter
    return f"${sentence}*{total:02X}\r\n"
