"""Lines of RINEX 3.04: headers, observations and navigation records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from carlaloc_env.sensors.raw_gnss.atmosphere import ALPHA, BETA
from carlaloc_env.sensors.raw_gnss.orbits import Ephemeris
from carlaloc_env.sensors.raw_gnss.systems import LEAP_S, SYSTEMS, WEEK_S

VERSION = "3.04"
_PROGRAM = "CarlaLoc"
_GPS_EPOCH = datetime(1980, 1, 6)
_IODES = 128
"""Issues of data run below this, so that all systems can hold them."""
_INAV = 517
"""Source of Galileo's records: I/NAV on E1 and E5b, clocks for both."""
_URA_M, _SISA_M = 2.0, 3.12
"""Accuracies that GPS and BeiDou, and Galileo, announce as a rule [m]."""


def observation_header(name: str, ecef_m: Sequence[float], week: int, tow_s: float) -> str:
    """Header of a file of observations, whose first epoch is at a GPS week and time of week [s]."""
    lines = [
        _headed(f"{VERSION:>9}{'':11}{'OBSERVATION DATA':20}{'M: MIXED':20}", "RINEX VERSION / TYPE"),
        _headed(f"{_PROGRAM:20}{'':20}{_time_text(week, 0.0):20}", "PGM / RUN BY / DATE"),
        _headed(name, "MARKER NAME"),
        _headed("", "OBSERVER / AGENCY"),
        _headed(f"{'1':20}{'SIMULATED':20}{VERSION:20}", "REC # / TYPE / VERS"),
        _headed(f"{'1':20}{'ISOTROPIC':20}", "ANT # / TYPE"),
        _headed("".join(f"{value:14.4f}" for value in ecef_m), "APPROX POSITION XYZ"),
        _headed(f"{0.0:14.4f}" * 3, "ANTENNA: DELTA H/E/N"),
    ]
    for system in SYSTEMS.values():
        kinds = [f"{kind}{signal.code}" for signal in system.signals for kind in "CLDS"]
        text = f"{system.letter}  {len(kinds):3d}" + "".join(f" {kind}" for kind in kinds)
        lines.append(_headed(text, "SYS / # / OBS TYPES"))
        lines += [
            _headed(f"{system.letter} L{signal.code} {0.0:8.5f}", "SYS / PHASE SHIFT")
            for signal in system.signals
        ]
    when = _calendar(week, tow_s)
    day = f"{when.year:6d}{when.month:6d}{when.day:6d}{when.hour:6d}{when.minute:6d}"
    lines.append(
        _headed(f"{day}{when.second + when.microsecond * 1e-6:13.7f}{'GPS':>8}", "TIME OF FIRST OBS")
    )
    lines.append(_headed("", "END OF HEADER"))
    return "".join(lines)


def epoch_text(epoch: Mapping[str, Any], slipped: Sequence[bool]) -> str:
    """An epoch's observations.

    Args:
        epoch: Values of a `GnssRaw` by name.
        slipped: Whether the phase of each signal has lost its count since the epoch before.
    """
    by_satellite: dict[str, dict[str, int]] = {}
    for row, (satellite, code) in enumerate(zip(epoch["satellite"], epoch["code"], strict=True)):
        by_satellite.setdefault(satellite, {})[code] = row
    tenths = round(epoch["tow_s"] * 1e7)
    when = _calendar(epoch["week"], tenths // 10_000_000)
    seconds = f"{when.second + (tenths % 10_000_000) * 1e-7:11.7f}"
    lines = [f"> {when:%Y %m %d %H %M}{seconds}  0{len(by_satellite):3d}"]
    signals = {system.letter: system.signals for system in SYSTEMS.values()}
    for satellite, rows in by_satellite.items():
        text = satellite
        for signal in signals[satellite[0]]:
            own = rows.get(signal.code)
            text += " " * 64 if own is None else _observations(epoch, own, slipped[own])
        lines.append(text.rstrip())
    return "\n".join(lines) + "\n"


def _observations(epoch: Mapping[str, Any], row: int, slipped: bool) -> str:
    cn0 = epoch["cn0_dbhz"][row]
    strength = min(max(int(cn0 // 6), 1), 9)
    return (
        f"{epoch['pseudorange_m'][row]:14.3f} {strength}"
        f"{epoch['carrier_cycles'][row]:14.3f}{'1' if slipped else ' '}{strength}"
        f"{epoch['doppler_hz'][row]:14.3f}  {cn0:14.3f}  "
    )


def navigation_header(week: int) -> str:
    """Header of a mixed file of navigation messages."""
    lines = [
        _headed(f"{VERSION:>9}{'':11}{'N: GNSS NAV DATA':20}{'M: MIXED':20}", "RINEX VERSION / TYPE"),
        _headed(f"{_PROGRAM:20}{'':20}{_time_text(week, 0.0):20}", "PGM / RUN BY / DATE"),
    ]
    for name, values in (("GPSA", ALPHA), ("GPSB", BETA)):
        text = "".join(f"{value:12.4E}".replace("E", "D") for value in values)
        lines.append(_headed(f"{name} {text}", "IONOSPHERIC CORR"))
    lines.append(_headed(f"GPUT {_d(0.0, 17, 10)}{_d(0.0, 16, 9)}{0:7d}{week:5d}", "TIME SYSTEM CORR"))
    lines += [_headed(f"{LEAP_S:6d}", "LEAP SECONDS"), _headed("", "END OF HEADER")]
    return "".join(lines)


def navigation_text(record: Ephemeris) -> str:
    """A record of a navigation message."""
    system = record.system
    own_week, own_s = divmod(record.toe_s - system.ahead_s, WEEK_S)
    when = _calendar(own_week, own_s)
    issue = float(record.toe_s // system.record_s % _IODES)
    first = [record.clock_s, record.clock_rate, 0.0]
    delay = record.group_delay_s
    week = own_week - system.first_week
    tail: dict[str, list[list[float]]] = {
        "G": [[0.0, 1.0, week, 0.0], [_URA_M, 0.0, delay, issue], [own_s, 4.0]],
        "E": [[0.0, _INAV, week, 0.0], [_SISA_M, 0.0, delay, delay], [own_s]],
        "C": [
            [0.0, 0.0, week, 0.0],
            [_URA_M, 0.0, *(record.delay_s(signal.frequency_hz) for signal in system.signals)],
            [own_s, issue],
        ],
    }
    lines = [
        [issue, 0.0, record.rate_difference_radps, record.anomaly_rad],
        [0.0, 0.0, 0.0, system.radius_m**0.5],
        [own_s, 0.0, record.node_rad, 0.0],
        [record.inclination_rad, 0.0, 0.0, system.node_rate_radps],
        *tail[system.letter],
    ]
    text = f"{record.name} {when:%Y %m %d %H %M %S}" + "".join(_d(value) for value in first) + "\n"
    return text + "".join("    " + "".join(_d(value) for value in line) + "\n" for line in lines)


def _d(value: float, width: int = 19, digits: int = 12) -> str:
    return f"{value:{width}.{digits}E}".replace("E", "D")


def _headed(text: str, label: str) -> str:
    return f"{text:60}{label:20}".rstrip() + "\n"


def _calendar(week: int, tow_s: float) -> datetime:
    return _GPS_EPOCH + timedelta(weeks=week, seconds=tow_s)


def _time_text(week: int, tow_s: float) -> str:
    return f"{_calendar(week, tow_s):%Y%m%d %H%M%S} UTC"
