"""Faults of LiDARs: dead and biased beams, lost points, other LiDARs' pulses, dirt, a mount that sways."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.faults.fields import fault
from carlaloc_env.faults.timing import Draws, MountedFaults
from carlaloc_env.samples import PointCloud, Sample

_ROBO3D = "Kong et al. (Robo3D), ICCV 2023"
GHOST_MIN_M = 1.0
"""Least range of a pulse of another LiDAR [m]."""
_BEAMS_MAX = 1024
SWAY_HZ, _SWAY_WIDTH, _SWAY_PARTS = 13.0, 0.1, 8
"""Resonance of a rack of sensors [Hz], half of its width over it, and the sines that make it up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarFaults(MountedFaults):
    """Faults of a LiDAR; plain and labelled clouds have the same."""

    dead_beam_share: float = fault(
        "1", "probability that a beam is dead, drawn once for each", worst=1.0, low=0.0, high=1.0,
        source=_ROBO3D,
    )  # fmt: skip
    beam_bias_m: float = fault(
        "m", "standard deviation of a constant error of range, drawn once for each beam", worst=0.3, low=0.0
    )
    range_bias_m: float = fault("m", "added to every range", worst=0.5)
    point_drop_share: float = fault(
        "1", "share of the points that is lost, each by itself", worst=0.99, low=0.0, high=1.0
    )
    crosstalk_share: float = fault(
        "1", "share of the points that another LiDAR's pulse replaces, evenly between 1 m and the true range",
        worst=0.9, low=0.0, high=1.0, source=_ROBO3D,
    )  # fmt: skip
    blocked_deg: float = fault(
        "deg", "width of a sector without points, dirt on the window at a drawn azimuth", worst=350.0,
        low=0.0, high=360.0,
    )  # fmt: skip
    sway_deg: float = fault(
        "deg", "root mean square of a roll of the mount about its x axis at 13 Hz, which the truth lacks",
        worst=2.0, low=0.0, source="NavLab 11's rack: resonance of 13 Hz, CMU",
    )  # fmt: skip

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A cloud of a faulty LiDAR."""
        if not isinstance(sample, PointCloud):
            return sample
        cloud, xyz, tag = sample, sample.points_xyz_m, sample.tag

        def uniform(what: str, index: int = 0) -> Array:
            key = int(draws.at(f"{what}{index}", cloud.stamp_ns).integers(2**63))
            return ray_uniform(key, cloud.ring, cloud.offset_ns)

        kept = np.ones(len(xyz), bool)
        if self.dead_beam_share:
            kept &= draws.at("dead").random(_BEAMS_MAX)[cloud.ring] >= self.dead_beam_share
        if self.point_drop_share:
            kept &= uniform("point") >= self.point_drop_share
        if self.blocked_deg:
            kept &= ~_is_blocked(cloud, math.radians(self.blocked_deg), draws)
        bias_m = np.full(len(xyz), self.range_bias_m)
        if self.beam_bias_m:
            bias_m += self.beam_bias_m * draws.at("beam").standard_normal(_BEAMS_MAX)[cloud.ring]
        if bias_m.any():
            xyz = _at_range(xyz, _range_m(xyz) + bias_m)
        if self.crosstalk_share:
            ghost = uniform("crosstalk") < self.crosstalk_share
            beyond_m = np.maximum(_range_m(xyz), GHOST_MIN_M) - GHOST_MIN_M
            ghosts = _at_range(xyz, GHOST_MIN_M + uniform("crosstalk", 1) * beyond_m)
            xyz = np.where(ghost[:, None], ghosts, xyz)
            tag = None if tag is None else np.where(ghost, np.uint8(0), tag)
        if self.sway_deg:
            xyz = _rolled(xyz, _sway(cloud, draws) * math.radians(-self.sway_deg))
        arrays = ("intensity", "ring", "offset_ns", "instance", "cos_incidence", "doppler_mps")
        some = {name: value[kept] for name in arrays if (value := getattr(cloud, name)) is not None}
        return replace(cloud, points_xyz_m=xyz[kept], tag=None if tag is None else tag[kept], **some)


def ray_uniform(key: int, ring: NDArray[np.uint16], offset_ns: NDArray[np.uint32]) -> Array:
    """A number in [0, 1) for every ray, by splitmix64 of its beam and time, shape (N,).

    Which other rays have a return does not matter to it (Steele et al., OOPSLA 2014).
    """
    z = (offset_ns.astype(np.uint64) << np.uint64(16)) + ring.astype(np.uint64)
    z = (z + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(key)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    z ^= z >> np.uint64(31)
    share: Array = (z >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return share


def _range_m(xyz: NDArray[np.float32]) -> Array:
    x, y, z = xyz.T.astype(np.float64)
    range_m: Array = np.sqrt(x * x + y * y + z * z)
    return range_m


def _at_range(xyz: NDArray[np.float32], range_m: Array) -> NDArray[np.float32]:
    """Points on the same rays at other ranges, never behind the sensor."""
    scale: Array = np.maximum(range_m, 0.0) / np.maximum(_range_m(xyz), 1e-9)
    moved: NDArray[np.float32] = (xyz * scale[:, None]).astype(np.float32)
    return moved


def _sway(cloud: PointCloud, draws: Draws) -> Array:
    """Sway at the time of each point, of a root mean square of 1: sines about the resonance, shape (N,)."""
    draw = draws.at("sway").random((2, _SWAY_PARTS))
    share = (np.arange(_SWAY_PARTS) + draw[0]) / _SWAY_PARTS
    hz = SWAY_HZ * (1.0 + _SWAY_WIDTH * (2.0 * share - 1.0))
    time_s = 1e-9 * (cloud.stamp_ns + cloud.offset_ns.astype(np.float64))
    phases = 2.0 * math.pi * (time_s[:, None] * hz + draw[1])
    sway: Array = math.sqrt(2.0 / _SWAY_PARTS) * elementary.sin(phases).sum(axis=1)
    return sway


def _rolled(xyz: NDArray[np.float32], roll_rad: Array) -> NDArray[np.float32]:
    """Points turned about the x axis."""
    x, y, z = xyz.T.astype(np.float64)
    c, s = elementary.cos(roll_rad), elementary.sin(roll_rad)
    return np.stack([x, c * y - s * z, s * y + c * z], axis=-1).astype(np.float32)


def _is_blocked(cloud: PointCloud, width_rad: float, draws: Draws) -> NDArray[np.bool_]:
    middle = 2.0 * math.pi * draws.at("dirt").random()
    x, y = cloud.points_xyz_m[:, 0].astype(np.float64), cloud.points_xyz_m[:, 1].astype(np.float64)
    away = (elementary.arctan2(y, x) - middle + math.pi) % (2.0 * math.pi) - math.pi
    blocked: NDArray[np.bool_] = np.abs(away) < 0.5 * width_rad
    return blocked
