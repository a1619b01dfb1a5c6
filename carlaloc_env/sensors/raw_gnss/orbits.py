"""Broadcast navigation messages of nominal orbits, and where they put the satellites."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.sensors.raw_gnss.systems import LIGHT_MPS, SYSTEMS, WEEK_S, System

_CLOCKS_FROM_S = 1_262_304_000
"""GPS time at which the satellites' clocks have their first offsets: 2020-01-06 [s]."""
_AF0_S, _AF1, _TGD_S = 3e-4, 5e-12, 5e-9
"""Spread of clock offsets [s], of their rates, and of group delays on the first carrier [s]."""
ROUNDS = 3
"""Rounds of the light-time iteration; the third changes less than a micrometre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ephemeris:
    """One record of a satellite's navigation message: a circular Kepler orbit and a clock."""

    system: System
    """Its system."""
    number: int
    """Its number there (PRN)."""
    toe_s: int
    """Reference time of orbit and clock, GPS time [s]."""
    anomaly_rad: float
    """Mean anomaly then, the argument of latitude [rad]."""
    node_rad: float
    """Longitude of the ascending node at the beginning of the week [rad]."""
    rate_difference_radps: float
    """Rate along the orbit above Kepler's [rad/s]."""
    clock_s: float
    """Offset of the satellite's clock at `toe_s` [s]."""
    clock_rate: float
    """Rate of the clock [s/s]."""
    group_delay_s: float
    """Group delay on the first carrier against a signal of both [s]."""

    @property
    def name(self) -> str:
        """Name in RINEX, e.g. ``G05``."""
        return f"{self.system.letter}{self.number:02d}"

    @property
    def inclination_rad(self) -> float:
        """Tilt against the equator [rad]."""
        return math.radians(self.system.inclination_deg)

    @property
    def system_toe_s(self) -> int:
        """Reference time in the system's own week [s]."""
        return (self.toe_s - self.system.ahead_s) % WEEK_S

    def delay_s(self, frequency_hz: float) -> float:
        """Group delay of a carrier against the satellite's clock [s]; it falls as 1/f²."""
        reference, first = self.system.clock_reference_hz, self.system.signals[0].frequency_hz
        own = (first / frequency_hz) ** 2 - ((first / reference) ** 2 if reference else 0.0)
        return self.group_delay_s * own


def ephemerides(names: Sequence[str], gps_s: int, *, clocks: bool = True) -> list[Ephemeris]:
    """Records that all satellites of some systems broadcast at a time.

    Args:
        names: Names of the systems.
        gps_s: GPS time [s since 1980-01-06].
        clocks: Whether the satellites' clocks have offsets and group delays.
    """
    return [
        _record(SYSTEMS[name], plane, slot, gps_s, clocks)
        for name in names
        for plane, along in enumerate(SYSTEMS[name].along_deg)
        for slot in range(len(along))
    ]


def record_of(satellite: str, gps_s: int, *, clocks: bool = True) -> Ephemeris:
    """Record that one satellite, e.g. ``G05``, broadcasts at a GPS time [s]; `clocks` as in `ephemerides`."""
    system = next(system for system in SYSTEMS.values() if system.letter == satellite[0])
    place = system.numbers.index(int(satellite[1:]))
    return _record(system, *divmod(place, len(system.along_deg[0])), gps_s, clocks)


def _record(system: System, plane: int, slot: int, gps_s: int, clocks: bool) -> Ephemeris:
    each = len(system.along_deg[plane])
    number = system.numbers[plane * each + slot]
    # Records begin with the hours of the system's own time.
    own_s = gps_s - system.ahead_s
    toe_s = (own_s - system.before_s) // system.record_s * system.record_s + system.ahead_s
    since_s = toe_s - (system.reference_unix_s - 315_964_800)
    rate = system.rate_radps or _kepler(system)
    anomaly = (math.radians(system.along_deg[plane][slot]) + rate * since_s) % (2.0 * math.pi)
    # Against the Earth by the message's own rate: a sidereal time at each record would leap by a metre.
    days = system.reference_unix_s / 86_400.0 + 2_440_587.5 - 2_451_545.0
    node = math.radians((system.nodes_deg[plane] - 280.46061837 - 360.98564736629 * days) % 360.0)
    node += (system.node_rate_radps - system.earth_rate_radps) * since_s
    node = (node + system.earth_rate_radps * ((toe_s - system.ahead_s) % WEEK_S)) % (2.0 * math.pi)
    draw = clock.stream(0, f"navigation clock/{system.letter}", index=number).uniform(-1.0, 1.0, 3)
    offset, drift, delay = (draw * [_AF0_S, _AF1, _TGD_S]).tolist() if clocks else (0.0, 0.0, 0.0)
    return Ephemeris(
        system=system,
        number=number,
        toe_s=toe_s,
        anomaly_rad=anomaly,
        node_rad=node,
        rate_difference_radps=rate - _kepler(system),
        clock_s=offset + drift * (toe_s - _CLOCKS_FROM_S),
        clock_rate=drift,
        group_delay_s=delay,
    )


def _kepler(system: System) -> float:
    radius = system.radius_m
    return math.sqrt(system.gm_m3ps2 / (radius * radius * radius))


class Sky:
    """Satellites of one set of records, as arrays.

    Args:
        records: The records.
    """

    def __init__(self, records: Sequence[Ephemeris]) -> None:
        self.records = tuple(records)
        systems = [record.system for record in records]
        self._toe_s = np.array([record.toe_s for record in records], dtype=np.int64)
        self._anomaly = np.array([record.anomaly_rad for record in records])
        self._rate = np.array([_kepler(r.system) + r.rate_difference_radps for r in records])
        self._radius_m = np.array([system.radius_m for system in systems])
        tilt = np.radians([system.inclination_deg for system in systems])
        self._cos_tilt, self._sin_tilt = elementary.cos(tilt), elementary.sin(tilt)
        spin = np.array([system.earth_rate_radps for system in systems])
        self._node = np.array([r.node_rad for r in records]) - spin * [r.system_toe_s for r in records]
        self._node_rate = np.array([system.node_rate_radps for system in systems]) - spin
        self._spin = spin
        self._clock = np.array([(record.clock_s, record.clock_rate) for record in records])

    def at(self, gps_ns: int, back_s: Array | float = 0.0) -> tuple[Array, Array]:
        """Earth-fixed positions [m] and velocities [m/s] at a GPS time less some seconds, each (N, 3)."""
        since_s = (gps_ns - self._toe_s * 1_000_000_000) * 1e-9 - back_s
        along, node = self._anomaly + self._rate * since_s, self._node + self._node_rate * since_s
        x, y = elementary.cos(along), elementary.sin(along)
        c, s = elementary.cos(node), elementary.sin(node)
        flat = y * self._cos_tilt
        unit = np.stack([x * c - flat * s, x * s + flat * c, y * self._sin_tilt], axis=-1)
        ahead = np.stack(
            [-y * c - x * self._cos_tilt * s, -y * s + x * self._cos_tilt * c, x * self._sin_tilt], axis=-1
        )
        turning = np.stack([-unit[:, 1], unit[:, 0], np.zeros(len(unit))], axis=-1)
        velocity = self._rate[:, None] * ahead + self._node_rate[:, None] * turning
        return self._radius_m[:, None] * unit, self._radius_m[:, None] * velocity

    def clock_s(self, gps_ns: int) -> Array:
        """Offsets of the satellites' clocks [s], shape (N,)."""
        since_s = (gps_ns - self._toe_s * 1_000_000_000) * 1e-9
        offsets: Array = self._clock[:, 0] + self._clock[:, 1] * since_s
        return offsets

    @property
    def clock_rate(self) -> Array:
        """Rates of the satellites' clocks, shape (N,)."""
        rates: Array = self._clock[:, 1]
        return rates

    def seen_from(
        self, ecef_m: Array, velocity_mps: Array, gps_ns: int, moved_m: Array | float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Where the light comes from that arrives at a place at a GPS time.

        The satellite's place at the time of transmission is turned with the Earth for the time that the
        light needs (IS-GPS-200, 20.3.3.4.3.4), into axes of the Earth at reception.

        Args:
            ecef_m: The antenna [m], shape (3,).
            velocity_mps: Its velocity, Earth-fixed [m/s], shape (3,).
            gps_ns: Time of reception [ns].
            moved_m: True places less those of the records, Earth-fixed [m], shape (N, 3).

        Returns:
            Unit vectors to the satellites (N, 3), distances [m] (N,), and their rates [m/s] (N,).
        """
        light_s: Array = np.full(len(self.records), 0.075)
        for _ in range(ROUNDS):
            position, velocity = self.at(gps_ns, light_s)
            there = turned(position + moved_m, self._spin * light_s)
            to = there - ecef_m
            distance = np.sqrt(np.sum(to * to, axis=-1))
            light_s = distance / LIGHT_MPS
        unit = to / distance[:, None]
        # While the light's way grows, transmission lags behind reception, and the turn grows.
        leaving = np.sum(unit * turned(velocity, self._spin * light_s), axis=-1)
        turning = self._spin * (unit[:, 0] * there[:, 1] - unit[:, 1] * there[:, 0])
        rate = leaving - np.sum(unit * velocity_mps, axis=-1)
        return unit, distance, rate / (1.0 + (leaving - turning) / LIGHT_MPS)


def turned(vectors: Array, angle_rad: Array) -> Array:
    """Vectors in axes that have turned about z by an angle."""
    c, s = elementary.cos(angle_rad), elementary.sin(angle_rad)
    x, y, z = vectors.T
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)
