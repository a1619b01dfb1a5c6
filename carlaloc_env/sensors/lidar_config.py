"""Settings of LiDARs, and the beams of LiDARs that have a name.

No ray caster is imported, so that a rig can be read before a scene is loaded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.sensors.base import Mount, SensorConfig
from carlaloc_env.sensors.limits import LIMITS

PAPER_ELEVATIONS_DEG: tuple[float, ...] = tuple(round(-30.0 + 40.0 * i / 31, 9) for i in range(32))
"""32 beams evenly from −30° to +10°, as CARLA's LiDAR spaces them [deg]."""
HDL32E_ELEVATIONS_DEG: tuple[float, ...] = (
    -30.67, -29.33, -28.0, -26.67, -25.33, -24.0, -22.67, -21.33, -20.0, -18.67, -17.33, -16.0, -14.67,
    -13.33, -12.0, -10.67, -9.33, -8.0, -6.67, -5.33, -4.0, -2.67, -1.33, 0.0, 1.33, 2.67, 4.0, 5.33,
    6.67, 8.0, 9.33, 10.67,
)  # fmt: skip
"""Beams of the Velodyne HDL-32E [deg]; user manual, page 13."""
HDL32E_FIRING_NS: tuple[int, ...] = tuple(1152 * (2 * r if r < 16 else 2 * (r - 16) + 1) for r in range(32))
"""When each beam of the HDL-32E fires in its 46.08 µs cycle [ns]: lower and upper bank alternate."""
OUTPUTS = ("cloud", "semantic")
"""Streams that a LiDAR can give."""
OWN_ROOF_M, OWN_CAR_M = 2.0, 3.0
"""Distances within which a LiDAR on the roof may see the car: roof and rack, bonnet and boot as well [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverConfig:
    """Receiver that measures the echoes of a LiDAR; the defaults are those of the Velodyne HDL-32E.

    Manual: the HDL-32E's user manual (63-9113), and "HDL32E Software Version 2.0 Description" (2012).
    """

    reach_m: float = 55.0
    """Distance to which a surface of 10 % reflectance is seen face on [m]; of others, as its third power.

    The darkest codes of a scan in nuScenes (Caesar et al., CVPR 2020) are 1 at 25 m, 3 at 35 m, 10 at 55 m,
    17 at 65 m and 40 at 90 m. So 60 % are seen to 100 m, where the manual's usable returns end."""
    focus_m: float = 4.0
    """Distance below which ever less of an echo falls on the detector [m]; intensities show it.

    The share 1 − exp(−(R/focus_m)²) is that of Fang et al., "Intensity correction of terrestrial laser
    scanning data by estimating laser transmission function" (2015). Roads in nuScenes' scans (Caesar
    et al. 2020) are half as bright at 3 to 4.5 m as at 6 to 8 m; here they are 0.6 times as bright."""
    pulse_m: float = 0.25
    """Standard deviation of the pulse along the ray, there and back [m]: Velodyne's 4 ns at half power."""
    weak_noise_m: float = 0.02
    """Deviation of ranges of the weakest echoes that are seen [m], the data sheet's accuracy.

    It falls as 1/amplitude: the Cramér–Rao bound of a pulse's time in noise (Kay, "Fundamentals of
    statistical signal processing", 1993, example 3.13)."""
    noise_amplitude: float = 0.12
    """Deviation of the receiver's noise over the weakest echo that is seen, 0.12 = an eighth."""
    laser_offset_m: float = 0.007
    """Deviation of the lasers' constant range errors [m], which no calibration file names.

    7 mm were measured in public scans of a building by an HDL-32E (Koide), the same 0.4 s later. Chan and
    Lichti, "Automatic in situ calibration of a spinning beam LiDAR system" (Remote Sensing 7, 2015), estimate
    such errors."""
    laser_gain: float = 2e-4
    """Deviation of the lasers' errors in proportion to the range, 2e-4 = 2 mm in 10 m."""
    range_quantum_m: float = 0.002
    """Step of the ranges [m], 0.002 = manual, appendix B; 0: none."""
    whole_intensity: bool = True
    """Whether intensities are whole numbers: 0–100 diffuse, 101–255 retro-reflectors (Software Version 2.0
    Description, page 16)."""
    power_levels: int = 11
    """Powers of a laser, each half of the one before, of which its last echo decides; 1: always the full one.

    "One of 11 laser powers that the sensor has dynamically chosen based on best signal to noise ratio on the
    detector for the previous shot from that laser" (Software Version 2.0 Description)."""
    full_scale: float = 24.0
    """Largest amplitude that is converted, over the weakest that is seen, as the laser's power is chosen.

    In nuScenes' scan half of the first shots past a surface whose echo is 10 to 30 times as strong are lost.
    """
    overload: float = 3.0
    """Amplitude over the full scale above which a laser at more than its least power gets no time.

    In nuScenes' scan half of the first shots on a surface whose echo is 4 to 8 times as strong as the one
    before are lost, and nearly all above that."""
    beam_mrad: tuple[float, float] = (3.0, 1.5)
    """Width of the beam along and across the scan [mrad]: 4 by 2 inches at 100 feet (manual, appendix D)."""
    edge_rays: int = 4
    """Rays besides the middle one of a beam whose neighbours lie elsewhere, so that edges mix; 0: none."""
    relief: bool = True
    """Whether what meshes lack shows: grains of the ground, its waves shorter than 10 m, which wheels feel,
    panes and frames of windows, angles of leaves, and coats of things."""

    def __post_init__(self) -> None:
        if min(self.reach_m, self.focus_m, self.pulse_m, self.full_scale, *self.beam_mrad) <= 0:
            raise ConfigError("receiver: reach_m, focus_m, pulse_m, full_scale, beam_mrad must be above 0")
        if self.overload < 1:
            raise ConfigError(f"receiver: overload is {self.overload}; give a number ≥ 1")
        sizes = (self.weak_noise_m, self.laser_offset_m, self.laser_gain, self.range_quantum_m)
        if min(*sizes, self.noise_amplitude, self.edge_rays) < 0 or not 1 <= self.power_levels <= 32:
            raise ConfigError("receiver: errors and edge_rays must be ≥ 0, power_levels 1 to 32")
        if self.edge_rays > 16:
            raise ConfigError(f"receiver: edge_rays is {self.edge_rays}; give 0 to 16")


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarConfig(SensorConfig):
    """A spinning LiDAR; the defaults are the CARLA-Loc paper's.

    ``preset: hdl32e`` has the angles, firing order and timing of the Velodyne HDL-32E, its elevations
    0.02° higher so that none lies on the edge of A-LOAM's ring bins.
    """

    kind: ClassVar[str] = "lidar"
    sensor: ClassVar[str] = "carlaloc_env.sensors.lidar.lidar:LidarSensor"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "paper": {},
        "hdl32e": {
            "elevations_deg": HDL32E_ELEVATIONS_DEG,
            "elevation_offset_deg": 0.02,
            "firing_ns": HDL32E_FIRING_NS,
            "columns": 1085,
        },
        "hdl32e_road": {
            "elevations_deg": HDL32E_ELEVATIONS_DEG,
            "elevation_offset_deg": 0.02,
            "firing_ns": HDL32E_FIRING_NS,
            "columns": 1085,
            "range_min_m": 0.3,
            "range_max_m": 100.0,
            "range_noise_m": 0.003,
            "dropoff_general": 0.007,
            "attenuation_per_m": 0.0,
            "ego_returns": True,
            "roof_rack": True,
            "receiver": ReceiverConfig(),
        },
    }

    name: str = "lidar"
    """Name of the sensor, its first stream and its frame."""
    mount: Mount = field(default_factory=Mount)
    """Where it sits on the car."""
    rate_hz: float = 20.0
    """Revolutions per second [Hz]."""
    elevations_deg: tuple[float, ...] = PAPER_ELEVATIONS_DEG
    """Elevation of each beam, lowest first [deg]."""
    elevation_offset_deg: float = 0.0
    """Added to every elevation [deg]; +0.02 keeps A-LOAM's ring formula off its bin edges."""
    firing_ns: tuple[int, ...] = ()
    """When each beam fires after its column began [ns]; none = all at once."""
    columns: int = 2078
    """Firings of all beams in one revolution."""
    range_min_m: float = 1.0
    """Nearest return [m]."""
    range_max_m: float = 120.0
    """Farthest return [m]."""
    range_noise_m: float = 0.02
    """Standard deviation along the ray [m]."""
    attenuation_per_m: float = 0.004
    """Loss of intensity over distance, exp(−a·R) [1/m]; CARLA's default."""
    drop_weak: bool = False
    """Whether surfaces too dark for their distance give no return."""
    sectors: int = 0
    """Parts of a revolution, each measured at one instant, 10 = CARLA at 200 Hz; 0: one time per column."""
    divergence_mrad: float = 0.0
    """Width of the beam [mrad]; above 0 five rays per beam are weighed, which mixes near edges."""
    dropoff_general: float = 0.0
    """Fraction of points lost at random, as CARLA's, 0.45 = its default."""
    dropoff_intensity_limit: float = 0.8
    """Intensity exp(−a·R) above which no point is lost for weakness, 1 = at the sensor."""
    dropoff_zero_intensity: float = 0.0
    """Fraction of points of no intensity that are lost, as CARLA's, 0.4 = its default."""
    weather: bool = False
    """Whether fog, rain, spray and wet ground have effect; weak returns are dropped then."""
    ego_returns: bool = False
    """Whether hits on the ego's own body are reported; they always throw a shadow."""
    roof_rack: bool = False
    """Whether a rack with the housings of other sensors stands on the roof, which LiDARs alone see."""
    receiver: ReceiverConfig | None = None
    """Echoes as a real sensor measures them; None: as CARLA does, with noise that is the same everywhere."""
    outputs: tuple[str, ...] = OUTPUTS
    """Streams: ``cloud`` (named as the sensor) and ``semantic`` (with ``_semantic`` behind)."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        what = f"LiDAR '{self.name}'"
        if not self.elevations_deg or any(abs(e) > 90 for e in self.elevations_deg):
            raise ConfigError(f"{what}: elevations_deg needs angles from −90 to 90")
        if list(self.elevations_deg) != sorted(self.elevations_deg):
            raise ConfigError(f"{what}: list elevations_deg from the lowest to the highest")
        if self.firing_ns and len(self.firing_ns) != len(self.elevations_deg):
            raise ConfigError(f"{what}: {len(self.firing_ns)} firing_ns for {len(self.elevations_deg)} beams")
        column_ns = 1e9 / (self.rate_hz * max(self.columns, 1))
        if self.firing_ns and not 0 <= min(self.firing_ns) <= max(self.firing_ns) < column_ns:
            raise ConfigError(f"{what}: firing_ns must lie within one column")
        if self.columns < 1 or not 0 <= self.range_min_m < self.range_max_m or self.range_noise_m < 0:
            raise ConfigError(f"{what}: needs columns ≥ 1, 0 ≤ range_min_m < range_max_m, range_noise_m ≥ 0")
        fractions = (self.dropoff_general, self.dropoff_intensity_limit, self.dropoff_zero_intensity)
        if not all(0.0 <= fraction <= 1.0 for fraction in fractions) or self.dropoff_intensity_limit == 0.0:
            raise ConfigError(f"{what}: drop-off figures must lie in 0…1, the intensity limit above 0")
        if self.sectors < 0 or self.divergence_mrad < 0:
            raise ConfigError(f"{what}: sectors and divergence_mrad must not be negative")
        if not self.outputs or set(self.outputs) - set(OUTPUTS):
            raise ConfigError(f"{what}: outputs {list(self.outputs)}; choose from {', '.join(OUTPUTS)}")

    @classmethod
    def file_values(cls, values: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
        """As for any sensor; ``beams: 64`` spaces that many beams evenly from the lowest to the highest.

        Raises:
            ConfigError: `beams` is no whole number, out of range, or beside `elevations_deg`.
        """
        merged = super(LidarConfig, cls).file_values(values, base)
        if "beams" not in merged:
            return merged
        beams, most = merged.pop("beams"), int(LIMITS["lidar"]["elevations_deg"].high)
        if not isinstance(beams, int) or not 2 <= beams <= most:
            raise ConfigError(f"beams: {beams!r}; give a whole number from 2 to {most}")
        if "elevations_deg" in values:
            raise ConfigError("beams and elevations_deg exclude each other; give one of them")
        span_deg = merged.get("elevations_deg", PAPER_ELEVATIONS_DEG)
        merged["elevations_deg"] = np.linspace(span_deg[0], span_deg[-1], beams).round(9).tolist()
        if "firing_ns" not in values:
            merged["firing_ns"] = ()  # those of another number of beams
        return merged

    @property
    def near_m(self) -> float:
        """Distance from which returns are not of the car itself [m]; systems use those alone."""
        car_m = OWN_CAR_M if self.ego_returns else OWN_ROOF_M
        return car_m if self.range_min_m < car_m < self.range_max_m else self.range_min_m

    @property
    def sweep_ns(self) -> int:
        """Length of a revolution [ns]."""
        return round(1e9 / self.rate_hz)

    @property
    def rays(self) -> int:
        """Rays in one revolution, the most points a cloud can have."""
        return self.columns * len(self.elevations_deg)
