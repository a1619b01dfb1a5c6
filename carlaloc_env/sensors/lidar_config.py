"""Settings of LiDARs.

No ray caster is imported, so that a rig can be read before a scene is loaded.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.sensors.lidar_patterns import FanPattern, WedgePattern
from carlaloc_env.sensors.lidar_presets import HDL32E, PRESETS
from carlaloc_env.sensors.limits import LIMITS

PAPER_ELEVATIONS_DEG: tuple[float, ...] = tuple(round(-30.0 + 40.0 * i / 31, 9) for i in range(32))
"""32 beams evenly from −30° to +10°, as CARLA's LiDAR spaces them [deg]."""
OUTPUTS = ("cloud", "semantic")
"""Streams that a LiDAR can give."""
LAYOUTS = (
    *("velodyne", "ouster", "ouster_2021", "hesai", "robosense", "aeva"),
    *("livox", "livox_ros_driver", "livox_ros_driver2", "livox_points"),
)
"""Drivers whose messages a bag can have. `livox` is the message of livox_ros_driver in bags of ROS 1 and of
livox_ros_driver2 in those of ROS 2; the two after it fix the package; `livox_points` is a PointCloud2."""
_PER_BEAM = ("firing_ns", "azimuth_offsets_deg", "origins_m")
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
    """A LiDAR that spins, or whose beams follow a pattern; the defaults are the CARLA-Loc paper's.

    ``preset: hdl32e`` has the angles, firing order and timing of the Velodyne HDL-32E, its elevations
    0.02° higher so that none lies on the edge of A-LOAM's ring bins. docs/lidars.md has all presets.
    """

    kind: ClassVar[str] = "lidar"
    sensor: ClassVar[str] = "carlaloc_env.sensors.lidar.lidar:LidarSensor"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "paper": {},
        "hdl32e": HDL32E,
        "hdl32e_road": {
            **HDL32E,
            "range_min_m": 0.3,
            "range_max_m": 100.0,
            "range_noise_m": 0.003,
            "dropoff_general": 0.007,
            "attenuation_per_m": 0.0,
            "ego_returns": True,
            "roof_rack": True,
            "receiver": ReceiverConfig(),
        },
        **PRESETS,
    }

    name: str = "lidar"
    """Name of the sensor, its first stream and its frame."""
    rate_hz: float = 20.0
    """Revolutions per second [Hz]."""
    elevations_deg: tuple[float, ...] = PAPER_ELEVATIONS_DEG
    """Elevation of each beam, lowest first [deg]; with a pattern, before its optics."""
    elevation_offset_deg: float = 0.0
    """Added to every elevation [deg]; +0.02 keeps A-LOAM's ring formula off its bin edges."""
    firing_ns: tuple[int, ...] = ()
    """When each beam fires after its column began [ns]; none = all at once."""
    azimuth_offsets_deg: tuple[float, ...] = ()
    """Azimuth of each beam beside its column's, left positive [deg]; none = 0."""
    origins_m: tuple[tuple[float, float, float], ...] = ()
    """Where each beam begins, or all of them, in axes that turn with the column: ahead, left, up [m]."""
    rings_from_top: bool = False
    """Whether ring 0 is the highest beam, as Ouster's and Hesai's drivers number them, or the lowest."""
    columns: int = 2078
    """Firings of all beams in one revolution; 0: they follow from `cycle_ns`."""
    cycle_ns: float = 0.0
    """Time from column to column [ns], in a revolution also a fractional number of them; 0: by `columns`."""
    span_deg: float = 360.0
    """Azimuth that the columns cover from left to right, its middle ahead [deg], 360 = a revolution."""
    pattern: WedgePattern | FanPattern | None = None
    """Optics in place of a revolution; every column is then a firing of all lines."""
    range_min_m: float = 1.0
    """Nearest return [m]."""
    range_max_m: float = 120.0
    """Farthest return [m]."""
    range_noise_m: float = 0.02
    """Standard deviation along the ray [m]."""
    attenuation_per_m: float = 0.004
    """Loss of intensity over distance, exp(−a·R) [1/m]; CARLA's default."""
    diffuse_intensity: float = 100.0
    """Intensity of a white surface face on [1]; retro-reflectors lie above it, up to 255."""
    doppler: bool = False
    """Whether points have the rate of their range, as FMCW LiDARs measure it."""
    doppler_noise_mps: float = 0.03
    """Standard deviation of that rate [m/s]; Aeva states 3 cm/s."""
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
    """Whether fog, rain, snow, spray and wet ground have effect; weak returns are dropped then."""
    ego_returns: bool = False
    """Whether hits on the ego's own body are reported; they always throw a shadow."""
    roof_rack: bool = False
    """Whether a rack with the housings of other sensors stands on the roof, which LiDARs alone see."""
    receiver: ReceiverConfig | None = None
    """Echoes as a real sensor measures them; None: as CARLA does, with noise that is the same everywhere."""
    outputs: tuple[str, ...] = OUTPUTS
    """Streams: ``cloud`` (named as the sensor) and ``semantic`` (with ``_semantic`` behind)."""
    layout: str | None = None
    """Driver whose message the cloud has in bags beside the project's own; None: none."""
    time_unit: str = "s"
    """Unit of points' times in the layout `velodyne` [s or us]; FAST-LIO2's velodyne.yaml wants ``us``."""

    def __post_init__(self) -> None:
        what = f"LiDAR '{self.name}'"
        if (self.columns > 0) == (self.cycle_ns > 0) or min(self.columns, self.cycle_ns) < 0:
            raise ConfigError(f"{what}: give columns or cycle_ns, and 0 for the other")
        SensorConfig.__post_init__(self)
        if not self.elevations_deg or any(abs(e) > 90 for e in self.elevations_deg):
            raise ConfigError(f"{what}: elevations_deg needs angles from −90 to 90")
        if list(self.elevations_deg) != sorted(self.elevations_deg):
            raise ConfigError(f"{what}: list elevations_deg from the lowest to the highest")
        self._check_beams(what)
        if not 0 <= self.range_min_m < self.range_max_m or self.range_noise_m < 0:
            raise ConfigError(f"{what}: needs 0 ≤ range_min_m < range_max_m, range_noise_m ≥ 0")
        fractions = (self.dropoff_general, self.dropoff_intensity_limit, self.dropoff_zero_intensity)
        if not all(0.0 <= fraction <= 1.0 for fraction in fractions) or self.dropoff_intensity_limit == 0.0:
            raise ConfigError(f"{what}: drop-off figures must lie in 0…1, the intensity limit above 0")
        if min(self.sectors, self.divergence_mrad, self.doppler_noise_mps) < 0:
            raise ConfigError(f"{what}: sectors, divergence_mrad, doppler_noise_mps must not be negative")
        if not 0 <= self.diffuse_intensity <= 255 or (self.receiver and self.diffuse_intensity != 100):
            given = f"{what}: diffuse_intensity is {self.diffuse_intensity:g}"
            raise ConfigError(f"{given}; give 0 to 255, and 100 with a receiver, which is Velodyne's")
        if self.layout is not None and self.layout not in LAYOUTS:
            raise ConfigError(f"{what}: {unknown_name('layout', self.layout, LAYOUTS)}")
        if self.sectors and self.layout is not None:
            raise ConfigError(f"{what}: sectors give many columns one time, as no driver does; drop layout")
        if self.time_unit != "s" and (self.time_unit, self.layout) != ("us", "velodyne"):
            raise ConfigError(f"{what}: time_unit is {self.time_unit}; give s, or us with layout velodyne")
        if not self.outputs or set(self.outputs) - set(OUTPUTS):
            raise ConfigError(f"{what}: outputs {list(self.outputs)}; choose from {', '.join(OUTPUTS)}")

    def _check_beams(self, what: str) -> None:
        """Refuse beams and columns that do not fit each other."""
        beams = len(self.elevations_deg)
        for name in _PER_BEAM:
            entries = len(getattr(self, name))
            if entries not in (0, beams) and not (name == "origins_m" and entries == 1):
                raise ConfigError(f"{what}: {entries} {name} for {beams} beams")
        column_ns = self.sweep_ns / self.columns_per_sweep
        if self.firing_ns and not 0 <= min(self.firing_ns) <= max(self.firing_ns) < column_ns:
            raise ConfigError(f"{what}: firing_ns must lie within one column")
        if self.columns_per_sweep < 1 or not 0 < self.span_deg <= 360:
            raise ConfigError(f"{what}: needs a column in a sweep, and span_deg from 0 to 360")
        if self.sectors and (self.cycle_ns or self.pattern):
            raise ConfigError(f"{what}: sectors need columns, not cycle_ns or a pattern")

    @classmethod
    def file_values(cls, values: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
        """As for any sensor; ``beams: 64`` spaces that many beams evenly over a range of elevations.

        The range is that of ``elevations_deg: [low, high]`` beside it, or of the preset. Of `columns` and
        `cycle_ns`, the one that the file names replaces the other.

        Raises:
            ConfigError: `beams` is no whole number, out of range, or beside more than two elevations.
        """
        merged = super(LidarConfig, cls).file_values(values, base)
        for name, other in (("columns", "cycle_ns"), ("cycle_ns", "columns")):
            if name in values and other not in values:
                merged[other] = 0
        if "beams" not in merged:
            return merged
        beams, most = merged.pop("beams"), int(LIMITS["lidar"]["elevations_deg"].high)
        if not isinstance(beams, int) or not 2 <= beams <= most:
            raise ConfigError(f"beams: {beams!r}; give a whole number from 2 to {most}")
        span_deg = merged.get("elevations_deg", PAPER_ELEVATIONS_DEG)
        if "elevations_deg" in values and len(span_deg) != 2:
            raise ConfigError("beside beams give elevations_deg of two figures: [lowest, highest]")
        merged["elevations_deg"] = np.linspace(span_deg[0], span_deg[-1], beams).round(9).tolist()
        # Those of another number of beams.
        return merged | {name: () for name in _PER_BEAM if name not in values}

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
    def columns_per_sweep(self) -> Fraction:
        """Firings of all beams in one sweep; where it is no whole number, sweeps have one more or less."""
        if self.columns:
            return Fraction(self.columns)
        return Fraction(self.sweep_ns / self.cycle_ns).limit_denominator(10_000)

    @property
    def columns_most(self) -> int:
        """Columns of the sweep that has the most."""
        return math.ceil(self.columns_per_sweep)

    @property
    def rings(self) -> int:
        """Number of beams; of a pattern, of lines."""
        return len(self.elevations_deg)

    @property
    def rays(self) -> int:
        """Rays in one sweep, the most points a cloud can have."""
        return self.columns_most * self.rings

    @property
    def is_spinning(self) -> bool:
        """Whether beams of constant elevation go all round, as range pictures and ring formulas assume."""
        return self.pattern is None and self.span_deg == 360.0

    @property
    def field_deg(self) -> tuple[float, float]:
        """Lowest and highest elevation of the field of view [deg]."""
        if self.pattern is not None:
            return self.pattern.field_deg
        low, high = self.elevations_deg[0], self.elevations_deg[-1]
        return low + self.elevation_offset_deg, high + self.elevation_offset_deg

    @property
    def width_deg(self) -> float:
        """Width of the field of view, its middle ahead [deg]."""
        return self.pattern.width_deg if self.pattern is not None else self.span_deg
