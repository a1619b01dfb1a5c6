"""A receiver's raw measurements: pseudorange, carrier phase, Doppler and C/N0 of every signal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.geodesy import GeoReference, geodetic_to_ecef
from carlaloc_env.raycast import RayScene
from carlaloc_env.samples.gnss_signals import BLOCKED, IN_SIGHT, REFLECTED, GnssRaw
from carlaloc_env.sensors.raw_gnss.atmosphere import L1_HZ, klobuchar_m, saastamoinen_m
from carlaloc_env.sensors.raw_gnss.config import RawConfig
from carlaloc_env.sensors.raw_gnss.orbits import Sky, ephemerides
from carlaloc_env.sensors.raw_gnss.position import COMMON, Ranges, locate, look_angles
from carlaloc_env.sensors.raw_gnss.reception import Reception, receive
from carlaloc_env.sensors.raw_gnss.systems import LIGHT_MPS, SYSTEMS, WEEK_S
from carlaloc_env.sensors.stochastic_processes import EventCount, GaussMarkov, SlowMarkov, white_noise
from carlaloc_env.timeline.timeline import Timeline

ORBITS_S = 3600.0
"""Correlation time of errors of orbits, satellite clocks and the air [s]."""
_CLOCK_RATE, _WANDER_S, _WANDER_TIME_S = 2e-7, 2e-8, 100.0
"""Spread of a receiver's clock rates, and size [s] and correlation time [s] of its wander."""
_LEAP_S = 1e-3
"""Leap of a receiver's clock, which keeps it within half of one [s]."""
_CARRIER_MULTIPATH = 0.01
"""Multipath of a carrier phase over that of a pseudorange."""
_REFLECTED_SLIPS = 100.0
"""Slips of reflected signals over those of others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Antenna:
    """A receiver's antenna at an instant."""

    position_m: Array
    """Its place, world [m], shape (3,)."""
    velocity_mps: Array
    """Its velocity, world [m/s], shape (3,)."""
    geodetic: Array
    """Latitude [deg], longitude [deg], height [m]."""
    ecef_m: Array
    """Its place, Earth-fixed [m], shape (3,)."""
    ecef_velocity_mps: Array
    """Its velocity, Earth-fixed [m/s], shape (3,)."""

    @classmethod
    def of(cls, geo: GeoReference, position_m: Array, velocity_mps: Array) -> Antenna:
        """The antenna at a place with a velocity, both in world axes."""
        around = position_m + np.array([[0.0], [0.5], [-0.5]]) * velocity_mps
        geodetic = geo.enu_to_geodetic(around)
        ecef = geodetic_to_ecef(geodetic)
        return cls(
            position_m=position_m, velocity_mps=velocity_mps, geodetic=geodetic[0], ecef_m=ecef[0],
            ecef_velocity_mps=ecef[1] - ecef[2],
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrivals:
    """What comes from each of M satellites above the mask, the same for all its signals."""

    row: NDArray[np.intp]
    """Rows of the satellites among all, shape (M,)."""
    azimuth_rad: Array
    """Azimuths, clockwise from true north [rad], shape (M,)."""
    elevation_rad: Array
    """Elevations [rad], shape (M,)."""
    ways: Reception
    """How the signals come."""
    range_m: Array
    """Pseudoranges without noise, ionosphere and group delays [m], shape (M,)."""
    rate_mps: Array
    """Their rates [m/s], shape (M,)."""
    ionosphere_m: Array
    """Delay by the ionosphere on L1 [m], shape (M,)."""
    cn0_dbhz: Array
    """Carrier to noise density [dB-Hz], shape (M,)."""


class RawReceiver:
    """Measures all signals of its systems.

    Args:
        name: Name of the stream; noise is keyed by it, errors of satellites and air by the seed alone.
        frame_id: Frame of the antenna.
        period_s: Time between epochs [s].
        config: Systems, date and errors.
        mask_deg: Satellites below this elevation are not measured [deg].
        seed: Seed of all noise.
        geo: Place of the world on the Earth.
    """

    def __init__(
        self, name: str, frame_id: str, period_s: float, config: RawConfig, mask_deg: float, seed: int,
        geo: GeoReference,
    ) -> None:  # fmt: skip
        self._name, self._frame, self._config, self._mask_deg = name, frame_id, config, mask_deg
        self._seed, self._geo, self._period_ns = seed, geo, round(period_s * 1e9 / TICK_NS) * TICK_NS
        self._sky: tuple[tuple[int, ...], Sky] | None = None
        sky = self.sky(config.gps_ns)
        self._satellites = np.array([record.name for record in sky.records])
        table = [(k, s) for k, record in enumerate(sky.records) for s in record.system.signals]
        self._of = np.array([k for k, _ in table])
        self._codes = np.array([signal.code for _, signal in table])
        self._hz = np.array([signal.frequency_hz for _, signal in table])
        self._noise = np.array([signal.noise for _, signal in table])
        numbers = [record.system.first_number + record.number for record in sky.records]
        self._numbers = np.array(numbers, np.int64)[self._of]
        self._first = np.array([s is sky.records[k].system.signals[0] for k, s in table])
        self._space_m = np.array([record.system.signal_in_space_m for record in sky.records])
        self._make_noise(period_s)

    def _make_noise(self, period_s: float) -> None:
        count, signals, errors = len(self._satellites), len(self._of), self._config.errors
        at = {"period_s": period_s, "time_constant_s": errors.multipath_s}
        self._multipath = GaussMarkov(self._seed, f"{self._name}/multipath", signals, **at)
        self._fading = GaussMarkov(self._seed, f"{self._name}/fading", count, **at)
        # Two receivers meet the same satellites and the same air.
        shared = {"time_constant_s": ORBITS_S}
        self._orbits = SlowMarkov(self._seed, "navigation satellites", 4 * count, **shared)
        self._air = SlowMarkov(self._seed, "navigation signals in air", 2 + count, **shared)
        self._wander = SlowMarkov(self._seed, f"{self._name}/clock", 1, time_constant_s=_WANDER_TIME_S)
        often = errors.slips_per_hour * period_s / 3600.0
        self._slips = tuple(
            EventCount(self._seed, f"{self._name}/{what}", signals, probability=min(chance, 1.0))
            for what, chance in (("slips", often), ("slips of reflected", _REFLECTED_SLIPS * often))
        )
        self._start = clock.stream(self._seed, f"{self._name}/clock start").standard_normal(2)
        key = clock.stream(self._seed, f"{self._name}/ambiguities").integers(1 << 62)
        self._key = np.uint64(key)

    @property
    def signals(self) -> int:
        """Number of all signals of all satellites."""
        return len(self._of)

    def sky(self, gps_ns: int) -> Sky:
        """Satellites with the records of a GPS time."""
        gps_s = gps_ns // 1_000_000_000
        systems = [SYSTEMS[name] for name in self._config.systems]
        key = tuple((gps_s - s.ahead_s - s.before_s) // s.record_s for s in systems)
        if self._sky is None or self._sky[0] != key:
            clocks = self._config.errors.satellite_clocks
            self._sky = key, Sky(ephemerides(self._config.systems, gps_s, clocks=clocks))
        return self._sky[1]

    def measure(self, stamp_ns: int, antenna: Antenna, rays: RayScene | None, timeline: Timeline) -> GnssRaw:
        """Measurements at a stamp [ns]; without rays, under open sky."""
        gps_ns, epoch = self._config.gps_ns + stamp_ns, stamp_ns // self._period_ns
        sky = self.sky(gps_ns)
        clock_s, clock_rate = self._clock(stamp_ns)
        arrivals = self._arrivals(sky, stamp_ns, antenna, rays, timeline)
        place = np.full(len(self._satellites), -1)
        place[arrivals.row] = np.where(arrivals.ways.state == BLOCKED, -1, np.arange(len(arrivals.row)))
        rows = np.flatnonzero(place[self._of] >= 0)
        at = place[self._of[rows]]
        columns = self._columns(sky, stamp_ns, arrivals, rows, at, (clock_s, clock_rate))
        columns.update(self._arcs(epoch, arrivals.ways, rows, at))
        # Phases begin near the range, at a whole number of cycles from it.
        if self._config.errors.ambiguities:
            mixed = _mixed(
                columns["arc"].astype(np.uint64) * np.uint64(4096) + rows.astype(np.uint64), self._key
            )
            columns["carrier_cycles"] += (mixed % np.uint64(2001)).astype(np.float64) - 1000.0
        week, tow_ns = divmod(gps_ns, WEEK_S * 1_000_000_000)
        # The time that the receiver's own clock shows is all that it knows.
        ways, errors, tag_ns = arrivals.ways, self._config.errors, gps_ns + round(clock_s * 1e9)
        fix = locate(sky, tag_ns, self._ranges(rows, columns), errors, antenna.ecef_m)
        return GnssRaw(
            sensor=self._name, frame_id=self._frame, stamp_ns=stamp_ns, epoch=epoch, week=week,
            tow_s=tow_ns * 1e-9 + clock_s, satellite=self._satellites[self._of[rows]],
            code=self._codes[rows], number=self._numbers[rows], frequency_hz=self._hz[rows], **columns,
            solution_deg_m=fix.geodetic, solution_covariance_m2=fix.covariance_m2,
            velocity_enu_mps=fix.velocity_mps, dop=fix.dop, models=np.array(errors.models),
            antenna_ecef_m=antenna.ecef_m, clock_s=clock_s, sky_satellite=self._satellites[arrivals.row],
            sky_azimuth_deg=np.degrees(arrivals.azimuth_rad) % 360.0,
            sky_elevation_deg=np.degrees(arrivals.elevation_rad), sky_way=ways.state,
            sky_extra_m=ways.extra_m, sky_wall_m=ways.wall_m, sky_wall_tag=ways.wall_tag,
        )  # fmt: skip

    def _arrivals(
        self, sky: Sky, stamp_ns: int, antenna: Antenna, rays: RayScene | None, timeline: Timeline
    ) -> Arrivals:
        """Geometry, ways and shared errors of all satellites above the mask."""
        errors, gps_ns, count = self._config.errors, self._config.gps_ns + stamp_ns, len(self._satellites)
        slow, slow_rate = self._orbits.at(stamp_ns)
        # Half of the error's variance is the clock's, half the orbit's.
        share = errors.signal_in_space * math.sqrt(0.5) * self._space_m
        moved = share[:, None] * slow[count:].reshape(count, 3)
        unit, distance, rate = sky.seen_from(antenna.ecef_m, antenna.ecef_velocity_mps, gps_ns, moved)
        azimuth, elevation = look_angles(antenna.geodetic, unit)
        up = np.flatnonzero(elevation > math.radians(self._mask_deg))
        unit, azimuth, elevation = unit[up], azimuth[up], elevation[up]
        to = self._geo.ecef_to_enu(antenna.ecef_m + distance[up, None] * unit) - antenna.position_m
        to /= np.sqrt(np.sum(to * to, axis=-1))[:, None]
        ways = Reception.open_sky(len(up))
        if rays is not None and errors.town and len(up):
            ways = receive(rays, timeline, stamp_ns, antenna.position_m, to)
        fading = self._fading.rows(np.array([stamp_ns // self._period_ns]))[0][up]
        cn0 = 33.0 + 16.0 * elementary.power(elementary.sin(elevation), 0.6) - ways.loss_db
        cn0 = cn0 + errors.cn0_noise_db * fading
        ways.state[cn0 < self._config.cn0_min_dbhz] = BLOCKED
        ion, tropo = self._delays(stamp_ns, antenna, azimuth, elevation, up)
        towards_wall = np.sum(ways.normal * antenna.velocity_mps, axis=-1)
        detour = 2.0 * towards_wall * np.sum(ways.normal * to, axis=-1)
        return Arrivals(
            row=up, azimuth_rad=azimuth, elevation_rad=elevation, ways=ways,
            range_m=(distance + share * slow[:count] - LIGHT_MPS * sky.clock_s(gps_ns))[up]
            + ways.extra_m + tropo,
            rate_mps=(rate + share * slow_rate[:count] - LIGHT_MPS * sky.clock_rate)[up] + detour,
            ionosphere_m=ion, cn0_dbhz=cn0,
        )  # fmt: skip

    def _delays(
        self, stamp_ns: int, antenna: Antenna, azimuth: Array, elevation: Array, up: NDArray[np.intp]
    ) -> tuple[Array, Array]:
        """Delays by the ionosphere on L1 and by the troposphere [m], the models' errors included, (M,)."""
        errors = self._config.errors
        (tropo_error, common, *own), _ = self._air.at(stamp_ns)
        ion = tropo = np.zeros(len(up))
        if errors.ionosphere > 0:
            tow_s = (self._config.gps_ns + stamp_ns) % (WEEK_S * 1_000_000_000) * 1e-9
            error = COMMON * common + math.sqrt(1.0 - COMMON * COMMON) * np.array(own)[up]
            ion = klobuchar_m(antenna.geodetic, azimuth, elevation, tow_s) * (1.0 + errors.ionosphere * error)
        if errors.troposphere_m > 0:
            tropo = saastamoinen_m(antenna.geodetic, elevation)
            tropo = tropo + errors.troposphere_m * tropo_error / elementary.sin(elevation)
        return ion, tropo

    def _clock(self, stamp_ns: int) -> tuple[float, float]:
        """How far the receiver's clock is ahead [s], and its rate."""
        if not self._config.errors.receiver_clock:
            return 0.0, 0.0
        wander, wander_rate = self._wander.at(stamp_ns)
        rate = _CLOCK_RATE * float(self._start[1])
        ahead = _LEAP_S * float(self._start[0]) + rate * stamp_ns * 1e-9 + _WANDER_S * float(wander[0])
        leaps = math.floor(ahead / _LEAP_S + 0.5)
        return ahead - leaps * _LEAP_S, rate + _WANDER_S * float(wander_rate[0])

    def _columns(
        self, sky: Sky, stamp_ns: int, arrivals: Arrivals, rows: NDArray[np.intp], at: NDArray[np.intp],
        ahead: tuple[float, float],
    ) -> dict[str, Any]:  # fmt: skip
        """Measurements of signals by rows; `at` has the places of their satellites among the arrivals."""
        errors, ways, hz = self._config.errors, arrivals.ways, self._hz[rows]
        code, phase, doppler = white_noise(
            self._seed, f"{self._name}/noise", stamp_ns, 3 * len(self._of)
        ).reshape(3, -1)[:, rows]
        multipath = self._multipath.rows(np.array([stamp_ns // self._period_ns]))[0][rows]
        cn0 = arrivals.cn0_dbhz[at]
        weak = elementary.power(10.0, (45.0 - cn0) / 20.0)
        low = np.sqrt(1.0 / np.maximum(elementary.sin(arrivals.elevation_rad[at]), 0.1))
        hidden = float(np.mean(ways.state != IN_SIGHT)) if len(ways.state) else 0.0
        bounce = errors.multipath_m * low * (1.0 + errors.multipath_growth * hidden)
        sigma_m = np.stack(
            [errors.code_noise_m * weak * self._noise[rows], errors.carrier_noise_m * weak,
             errors.doppler_noise_mps * weak], axis=-1,
        )  # fmt: skip
        length_m, offset_s, offset_rate = LIGHT_MPS / hz, *ahead
        ion = arrivals.ionosphere_m[at] * (L1_HZ / hz) ** 2
        base = arrivals.range_m[at] + LIGHT_MPS * offset_s
        delay = [sky.records[k].delay_s(f) for k, f in zip(self._of[rows].tolist(), hz.tolist(), strict=True)]
        carrier_m = base - ion + sigma_m[:, 1] * phase + _CARRIER_MULTIPATH * bounce * multipath
        rate = arrivals.rate_mps[at] + LIGHT_MPS * offset_rate + sigma_m[:, 2] * doppler
        deviation_m = np.stack(
            [np.hypot(sigma_m[:, 0], errors.multipath_m * low), sigma_m[:, 1], sigma_m[:, 2]], axis=-1
        )
        return {
            "pseudorange_m": base + ion + LIGHT_MPS * np.array(delay) + sigma_m[:, 0] * code
            + bounce * multipath,
            "carrier_cycles": carrier_m / length_m,
            "doppler_hz": -rate / length_m,
            "cn0_dbhz": cn0,
            "sigma": deviation_m / np.stack([np.ones(len(hz)), length_m, length_m], axis=-1),
        }  # fmt: skip

    def _arcs(
        self, epoch: int, ways: Reception, rows: NDArray[np.intp], at: NDArray[np.intp]
    ) -> dict[str, NDArray[Any]]:
        """Numbers of the stretches without slips, and whether one begins; a wall has its own."""
        numbers = np.array([epoch, max(epoch - 1, 0)])
        counts, earlier = np.stack([count.rows(numbers) for count in self._slips], axis=1)[:, :, rows]
        way = np.minimum(ways.state[at], REFLECTED)
        pick = np.arange(len(rows))
        arc = counts[way, pick].astype(np.int64)
        offset_m = np.sum(ways.normal * np.nan_to_num(ways.wall_m), axis=-1)
        wall = np.rint(np.concatenate([ways.normal[:, :2] * 50.0, offset_m[:, None]], axis=-1)).astype(
            np.int64
        )
        mixed = _mixed((wall[:, 0] * 1009 + wall[:, 1] * 100_003 + wall[:, 2]).astype(np.uint64), self._key)
        own = (mixed % np.uint64(1 << 20)).astype(np.int64) + 1
        arc += np.where(way == REFLECTED, own[at] << 20, 0)
        return {"arc": arc, "slip": counts[way, pick] != earlier[way, pick]}

    def _ranges(self, rows: NDArray[np.intp], columns: dict[str, Array]) -> Ranges:
        """Pseudoranges and Dopplers of first carriers, by which the receiver finds its place."""
        first = np.flatnonzero(self._first[rows])
        signals = rows[first]
        return Ranges(
            row=self._of[signals], frequency_hz=self._hz[signals],
            pseudorange_m=columns["pseudorange_m"][first], doppler_hz=columns["doppler_hz"][first],
            sigma_m=columns["sigma"][first, 0],
        )  # fmt: skip


def _mixed(values: NDArray[np.uint64], key: np.uint64) -> NDArray[np.uint64]:
    """Numbers that look random, the same for the same values and key (splitmix64; Steele et al. 2014)."""
    with np.errstate(over="ignore"):
        z = (values + key) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))
