"""GNSS: the antenna's true position on the WGS84 ellipsoid, with white noise or the errors of a receiver."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.samples import GnssFix, Sample
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.gnss_satellites import CONSTELLATIONS, dilution, least_squares, sky_directions
from carlaloc_env.sensors.raw_gnss.config import RawConfig
from carlaloc_env.sensors.raw_gnss.receiver import Antenna, RawReceiver
from carlaloc_env.sensors.stochastic_processes import GaussMarkov, white_noise
from carlaloc_env.timeline.timeline import Timeline

MODELS = ("white", "satellites")
"""What `GnssConfig.model` may be."""
RAW, BASE = "_raw", "_base"
"""Endings of the streams of raw measurements, the car's and the base station's."""
_SIGHT_M = 800.0
"""Distance within which buildings and hills hide satellites [m]."""
_SKY_RAYS = 48
"""Rays that measure how much of the sky is hidden."""
_LEAF_LOSS = 2.0
"""Factor on the noise of a satellite behind leaves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GnssConfig(SensorConfig):
    """A satellite receiver; the defaults are the CARLA-Loc paper's white noise.

    ``preset: realistic`` looks at satellites through the town instead: errors of their ranges grow
    between walls and correlate in time, and there is no fix where fewer than four are in view.
    ``preset: rtk`` adds a base station's corrections. ``raw: true`` gives pseudoranges, carrier phases,
    Doppler and C/N0 of every signal besides, for RTK and tightly coupled systems.
    """

    kind: ClassVar[str] = "gnss"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "paper": {},
        "realistic": {"model": "satellites"},
        "rtk": {"model": "satellites", "rtk": True},
    }

    name: str = "gnss"
    """Name of the sensor, its stream and its frame."""
    mount: Mount = field(default_factory=Mount)
    """Where the antenna sits on the car."""
    rate_hz: float = 5.0
    """Fixes per second [Hz]."""
    model: str = "white"
    """Where errors come from: ``white`` (`noise_enu_m` alone) or ``satellites`` (all figures below)."""
    noise_enu_m: tuple[float, float, float] = (3.0, 3.0, 5.0)
    """Standard deviation east, north, up of the white model [m]."""
    constellations: tuple[str, ...] = ("galileo", "beidou", "glonass")
    """Satellite systems received: ``galileo``, ``beidou``, ``glonass``."""
    mask_deg: float = 7.0
    """Satellites below this elevation are not used [deg]."""
    pdop_max: float = 12.0
    """Dilution of precision beyond which no fix is given, 12 = errors of ranges grow twelvefold."""
    epoch_s: float = 0.0
    """Time of the satellites' orbits when the drive begins [s]."""
    code_noise_m: float = 0.3
    """White noise of a pseudo-range overhead; grows as 1/sin of the elevation [m]."""
    orbit_and_air_m: float = 0.8
    """Residual error of orbit, clock and atmosphere of a range, correlated over `slow_s` [m]."""
    slow_s: float = 600.0
    """Correlation time of orbit, clock and atmosphere [s]."""
    multipath_m: float = 0.4
    """Multipath of a range under open sky, correlated over `multipath_s` [m]."""
    multipath_s: float = 40.0
    """Correlation time of multipath [s]."""
    multipath_growth: float = 5.0
    """Growth of multipath with the hidden fraction b of the sky: factor 1 + growth·b, 5 = 3.5 at half."""
    rtk: bool = False
    """Whether a base station's corrections are received."""
    phase_noise_m: float = 0.004
    """White noise of a carrier-phase range, RTK fixed [m]."""
    float_m: float = 0.3
    """Error of a range while ambiguities are not fixed, RTK float [m]."""
    raw: bool = False
    """Whether `receiver` makes raw measurements, and positions from them; `model` does not count then."""
    receiver: RawConfig = field(default_factory=RawConfig)
    """Satellites, date, base station and errors of raw measurements."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        what = f"GNSS '{self.name}'"
        if not all(np.isfinite(s) and s >= 0 for s in self.noise_enu_m):
            raise ConfigError(f"{what}: noise_enu_m {self.noise_enu_m}; give numbers ≥ 0")
        if self.model not in MODELS:
            raise ConfigError(f"{what}: {unknown_name('model', self.model, MODELS)}")
        for name in self.constellations:
            if name not in CONSTELLATIONS:
                raise ConfigError(f"{what}: {unknown_name('constellation', name, CONSTELLATIONS)}")
        noises, times = (self.code_noise_m, self.phase_noise_m, self.float_m), (self.slow_s, self.multipath_s)
        if not all(math.isfinite(v) and v > 0 for v in (*noises, *times, self.pdop_max)):
            raise ConfigError(
                f"{what}: code, phase and float noise, correlation times and pdop_max must be above 0"
            )
        if min(self.orbit_and_air_m, self.multipath_m, self.multipath_growth) < 0:
            raise ConfigError(f"{what}: orbit_and_air_m, multipath_m and multipath_growth must be at least 0")
        if not self.constellations or not 0 <= self.mask_deg < 90:
            raise ConfigError(f"{what}: needs a constellation and 0 ≤ mask_deg < 90")

    def build(self, world: World) -> GnssSensor:
        """The receiver in a world."""
        return GnssSensor(self, world)


class GnssSensor(Sensor):
    """Puts its mount's true position on the ellipsoid and adds errors in metres, never in degrees."""

    config: GnssConfig

    def __init__(self, config: GnssConfig, world: World) -> None:
        super().__init__(config)
        self._world, self._seed = world, world.seed
        self._T_base_antenna = config.mount.T_base_sensor
        self._sigma_m = np.array(config.noise_enu_m, dtype=np.float64)
        width = sum(CONSTELLATIONS[name].satellites for name in config.constellations)
        self._slow, self._multipath = (
            GaussMarkov(
                self._seed,
                f"{config.name}/{what}",
                width,
                period_s=1.0 / config.rate_hz,
                time_constant_s=time,
            )
            for what, time in (("slow", config.slow_s), ("multipath", config.multipath_s))
        )
        self._raw, self._base = (
            RawReceiver(
                name,
                config.frame_id,
                1.0 / config.rate_hz,
                config.receiver,
                config.mask_deg,
                world.seed,
                world.geo,
            )
            if config.raw
            else None
            for name in (f"{config.name}{RAW}", f"{config.name}{BASE}")
        )
        if config.raw:
            self.padded_streams = tuple(name for name in self.streams() if name != config.name)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Latitude [deg], longitude [deg], altitude [m], 1 where there is a fix; zeros without."""
        low, high = np.array([-90.0, -180.0, -1e5, 0.0]), np.array([90.0, 180.0, 1e5, 1.0])
        streams: dict[str, spaces.Space[Any]] = {self.config.name: spaces.Box(low, high, dtype=np.float64)}
        if self._raw is not None:
            signals = spaces.Box(-np.inf, np.inf, (self._raw.signals, 6), dtype=np.float64)
            names = (RAW, BASE) if self.config.receiver.base else (RAW,)
            streams.update({f"{self.config.name}{name}": signals for name in names})
        return streams

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `GnssFix` per stamp [ns]."""
        if not stamps_ns:
            return []
        if self._raw is not None:
            return [sample for stamp in stamps_ns for sample in self._measured(timeline, int(stamp))]
        truth = timeline.ego_motion(stamps_ns).at_mount(self._T_base_antenna).position_m
        if self.config.model == "satellites":
            return [
                self._received(timeline, int(stamp), position)
                for stamp, position in zip(stamps_ns, truth, strict=True)
            ]
        name = f"{self.config.name}/position"
        noise = np.array([white_noise(self._seed, name, stamp, 3) for stamp in stamps_ns])
        covariance = np.diag(self._sigma_m**2)
        return [
            self._fix(int(stamp), position, covariance, "single", 0)
            for stamp, position in zip(stamps_ns, truth + self._sigma_m * noise, strict=True)
        ]

    def _measured(self, timeline: Timeline, stamp_ns: int) -> list[Sample]:
        """The fix and the raw measurements that it is made of, and those of the base station."""
        assert self._raw is not None
        assert self._base is not None
        geo, settings = self._world.geo, self.config.receiver
        motion = timeline.ego_motion([stamp_ns]).at_mount(self._T_base_antenna)
        antenna = Antenna.of(geo, motion.position_m[0], motion.velocity_world_mps[0])
        rays = self._world.rays() if settings.errors.town else None
        raw = self._raw.measure(stamp_ns, antenna, rays, timeline)
        has_fix = bool(np.isfinite(raw.solution_deg_m[0]))
        latitude, longitude, altitude = raw.solution_deg_m.tolist()
        fix = GnssFix(
            sensor=self.config.name, frame_id=self.config.frame_id, stamp_ns=stamp_ns, latitude_deg=latitude,
            longitude_deg=longitude, altitude_m=altitude, covariance_enu_m2=raw.solution_covariance_m2,
            has_fix=has_fix, solution="single" if has_fix else "none", satellites=len(set(raw.satellite)),
        )  # fmt: skip
        samples: list[Sample] = [fix, raw]
        if settings.base is not None:
            still = Antenna.of(geo, np.array(settings.base.position_m), np.zeros(3))
            samples.append(self._base.measure(stamp_ns, still, None, timeline))
        return samples

    def sky(self, timeline: Timeline, stamp_ns: int, position_m: Array) -> tuple[Array, Array, float]:
        """Sky that an antenna sees.

        Args:
            timeline: Where everything is.
            stamp_ns: When [ns].
            position_m: The antenna, world [m], shape (3,).

        Returns:
            Unit vectors to all satellites (N, 3); how each one's noise is multiplied, inf where it is
            hidden or below the mask (N,); the hidden fraction of the sky above the mask, 0–1.
        """
        config = self.config
        to = sky_directions(config.constellations, self._world.geo, config.epoch_s + stamp_ns * 1e-9)
        mask = elementary.sin(math.radians(config.mask_deg))
        directions = np.concatenate([to, _even_sky(mask)])
        up = np.flatnonzero(directions[:, 2] > mask)
        hits = self._world.rays().cast(
            np.broadcast_to(position_m, (len(up), 3)),
            directions[up],
            np.full(len(up), stamp_ns, dtype=np.int64),
            timeline,
            _SIGHT_M,
            ego=False,
        )
        met = np.isfinite(hits.range_m)
        leaves = met & (hits.tag == Tag.VEGETATION)
        factor = np.full(len(directions), np.inf)
        factor[up] = np.where(met & ~leaves, np.inf, np.where(leaves, _LEAF_LOSS, 1.0))
        return to, factor[: len(to)], float(np.mean(np.isinf(factor[len(to) :])))

    def _received(self, timeline: Timeline, stamp_ns: int, position_m: Array) -> GnssFix:
        config = self.config
        directions, factor, hidden = self.sky(timeline, stamp_ns, position_m)
        used = np.flatnonzero(np.isfinite(factor))
        solution = self._solution(len(used), hidden)
        if solution == "none" or dilution(directions[used]) > config.pdop_max:
            return self._fix(stamp_ns, np.full(3, np.nan), np.zeros((3, 3)), "none", len(used))
        number = np.array([stamp_ns // (self.schedule.period_ticks * TICK_NS)])
        noise = white_noise(self._seed, f"{config.name}/code", stamp_ns, len(factor))[used]
        slow, echo = self._slow.rows(number)[0, used], self._multipath.rows(number)[0, used]
        weak = factor[used] / np.maximum(directions[used, 2], 0.1)
        grown = 1.0 + config.multipath_growth * hidden
        parts: tuple[tuple[Array, Array], ...]
        if solution == "single":
            parts = (
                (config.code_noise_m * weak, noise),
                (np.full(len(used), config.orbit_and_air_m), slow),
                (config.multipath_m * grown * np.sqrt(weak), echo),
            )
        elif solution == "float":
            parts = ((config.float_m * np.sqrt(weak), echo), (config.phase_noise_m * weak, noise))
        else:
            # Carrier-phase multipath stays below a quarter of the wavelength, some centimetres.
            parts = ((config.phase_noise_m * weak, noise), (0.25 * config.phase_noise_m * grown * weak, echo))
        error = sum((sigma * unit for sigma, unit in parts), np.zeros(len(used)))
        variance = sum((sigma * sigma for sigma, _ in parts), np.zeros(len(used)))
        off, covariance = least_squares(directions[used], np.sqrt(variance), error)
        return self._fix(stamp_ns, position_m + off, covariance, solution, len(used))

    def _solution(self, count: int, hidden: float) -> str:
        """Four satellites give a position; ambiguities need more of them and an open sky."""
        if count < 4:
            return "none"
        if not self.config.rtk or count < 6:
            return "single"
        return "fixed" if count >= 8 and hidden < 0.5 else "float"

    def _fix(self, stamp_ns: int, position_m: Array, covariance: Array, solution: str, count: int) -> GnssFix:
        has_fix = solution != "none"
        fix = self._world.geo.enu_to_geodetic(position_m) if has_fix else np.full(3, np.nan)
        return GnssFix(
            sensor=self.config.name,
            frame_id=self.config.frame_id,
            stamp_ns=stamp_ns,
            latitude_deg=float(fix[0]),
            longitude_deg=float(fix[1]),
            altitude_m=float(fix[2]),
            covariance_enu_m2=self._world.geo.covariance_enu(covariance),
            has_fix=has_fix,
            solution=solution,
            satellites=count,
        )


def _even_sky(lowest_sine: float) -> Array:
    """Directions spread evenly over the sky above an elevation (golden spiral), shape (N, 3)."""
    k = np.arange(_SKY_RAYS) + 0.5
    up = lowest_sine + (1.0 - lowest_sine) * k / _SKY_RAYS
    azimuth = math.pi * (3.0 - math.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - up * up)
    return np.stack([flat * elementary.cos(azimuth), flat * elementary.sin(azimuth), up], axis=-1)
