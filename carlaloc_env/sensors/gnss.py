"""GNSS: the antenna's true place on the WGS84 ellipsoid, with white noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from carlaloc_env.errors import ConfigError
from carlaloc_env.geodesy import GeoReference
from carlaloc_env.samples import GnssFix, Sample
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.noise import white
from carlaloc_env.timeline import Timeline


@dataclass(frozen=True, slots=True, kw_only=True)
class GnssConfig(SensorConfig):
    """A satellite receiver; the defaults are the CARLA-Loc paper's."""

    kind: ClassVar[str] = "gnss"

    name: str = "gnss"
    """Name of the sensor, its stream and its frame."""
    mount: Mount = field(default_factory=Mount)
    """Where the antenna sits on the car."""
    rate_hz: float = 5.0
    """Fixes per second [Hz]."""
    noise_enu_m: tuple[float, float, float] = (3.0, 3.0, 5.0)
    """Standard deviation east, north, up [m]."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        if not all(np.isfinite(s) and s >= 0 for s in self.noise_enu_m):
            raise ConfigError(f"GNSS '{self.name}': noise_enu_m {self.noise_enu_m}; give numbers ≥ 0")

    def build(self, world: World) -> GnssSensor:
        """The receiver in a world."""
        return GnssSensor(self, world.seed, world.geo)


class GnssSensor(Sensor):
    """Puts its mount's true position on the ellipsoid and adds noise in metres, never in degrees."""

    config: GnssConfig

    def __init__(self, config: GnssConfig, seed: int, geo: GeoReference) -> None:
        super().__init__(config)
        self._seed, self._geo = seed, geo
        self._T_base_antenna = config.mount.T_base_sensor
        self._sigma_m = np.array(config.noise_enu_m, dtype=np.float64)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Latitude [deg], longitude [deg], altitude [m], 1 where there is a fix."""
        low, high = np.array([-90.0, -180.0, -1e5, 0.0]), np.array([90.0, 180.0, 1e5, 1.0])
        return {self.config.name: spaces.Box(low, high, dtype=np.float64)}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `GnssFix` per stamp [ns]."""
        if not stamps_ns:
            return []
        truth = timeline.ego_motion(stamps_ns).at_mount(self._T_base_antenna).position_m
        name = f"{self.config.name}/position"
        noise = np.array([white(self._seed, name, stamp, 3) for stamp in stamps_ns])
        fixes = self._geo.enu_to_geodetic(truth + self._sigma_m * noise)
        return [
            GnssFix(
                sensor=self.config.name,
                frame_id=self.config.frame_id,
                stamp_ns=int(stamp),
                latitude_deg=float(fix[0]),
                longitude_deg=float(fix[1]),
                altitude_m=float(fix[2]),
                covariance_enu_m2=np.diag(self._sigma_m**2),
            )
            for stamp, fix in zip(stamps_ns, fixes, strict=True)
        ]
