"""Settings of radars; no ray caster is imported, so that a rig can be read before a scene is loaded."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.sensors.base import Mount, SensorConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class RadarConfig(SensorConfig):
    """A 4-D imaging radar; range, field of view and rate are the CARLA-Loc paper's (Oculii Falcon).

    Resolutions are those usual for 4-D radars of its kind; the paper does not print them.
    """

    kind: ClassVar[str] = "radar"
    sensor: ClassVar[str] = "carlaloc_env.sensors.radar:RadarSensor"

    name: str = "front"
    """Name of the radar; its stream and its frame are ``radar_<name>``."""
    mount: Mount = field(default_factory=Mount)
    """Where it sits on the car; it looks along its x axis."""
    rate_hz: float = 20.0
    """Frames per second [Hz]."""
    range_min_m: float = 1.0
    """Nearest detection [m]."""
    range_max_m: float = 200.0
    """Farthest detection [m]."""
    azimuth_fov_deg: float = 120.0
    """Width of the field of view [deg]."""
    elevation_fov_deg: float = 30.0
    """Height of the field of view [deg]."""
    range_resolution_m: float = 0.5
    """Size of a range cell [m]."""
    azimuth_resolution_deg: float = 1.5
    """Size of an azimuth cell [deg]."""
    elevation_resolution_deg: float = 2.0
    """Size of an elevation cell [deg]."""
    doppler_resolution_mps: float = 0.2
    """Size of a Doppler cell [m/s]."""
    reference_range_m: float = 100.0
    """Distance at which a target of 0 dBsm is detected with `reference_pd` [m]."""
    reference_pd: float = 0.9
    """Probability of detection at the reference, 0.9 = nine frames in ten."""
    pfa: float = 1e-6
    """Probability of a false alarm in one cell; sets the threshold, 1e-6 = −ln(1e-6) = 11.4 dB."""
    clutter_mean: float = 4.0
    """Mean number of false detections in a frame, Poisson distributed, 4 = 1.6 % of 250."""
    ghosts: bool = True
    """Whether mirror images of road users in walls, rails and the road are seen."""
    reflection_loss_db: float = 7.0
    """Loss of a wall's or rail's reflection, each way [dB]; the road's is 5 dB more."""
    edge_loss_db: float = 6.0
    """Two-way loss at the edges of the field of view [dB]."""
    columns: int = 160
    """Rays across the field of view with which scenery is sought."""
    rows: int = 24
    """Rays over its height."""
    rays_per_actor: int = 24
    """Rays aimed at each actor in view."""
    detections_max: int = 500
    """Most detections of a frame; the weakest are left out."""
    weather: bool = False
    """Whether rain weakens echoes (ITU-R P.838-3)."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        what = f"radar '{self.name}'"
        if not 0 < self.range_min_m < self.range_max_m or min(self.cell) <= 0:
            raise ConfigError(f"{what}: needs 0 < range_min_m < range_max_m and resolutions > 0")
        if not (0 < self.azimuth_fov_deg <= 180 and 0 < self.elevation_fov_deg <= 90):
            raise ConfigError(f"{what}: azimuth_fov_deg must lie in 0…180, elevation_fov_deg in 0…90")
        if not (0 < self.pfa < self.reference_pd < 1):
            raise ConfigError(f"{what}: needs 0 < pfa < reference_pd < 1")
        if min(self.columns, self.rows, self.rays_per_actor, self.detections_max) < 1:
            raise ConfigError(f"{what}: columns, rows, rays_per_actor and detections_max must be at least 1")
        if self.clutter_mean < 0:
            raise ConfigError(f"{what}: clutter_mean {self.clutter_mean}; give a number ≥ 0")

    @property
    def half_fov_rad(self) -> tuple[float, float]:
        """Half the width and half the height of the field of view [rad]."""
        return 0.5 * math.radians(self.azimuth_fov_deg), 0.5 * math.radians(self.elevation_fov_deg)

    @property
    def cell(self) -> tuple[float, float, float, float]:
        """Sizes of a cell in range [m], azimuth and elevation [rad], and Doppler [m/s]."""
        azimuth, elevation = (
            math.radians(deg) for deg in (self.azimuth_resolution_deg, self.elevation_resolution_deg)
        )
        return self.range_resolution_m, azimuth, elevation, self.doppler_resolution_mps

    @property
    def stream(self) -> str:
        """Name of the stream."""
        return f"radar_{self.name}"

    @property
    def frame_id(self) -> str:
        """Name of the radar's frame."""
        return self.stream
