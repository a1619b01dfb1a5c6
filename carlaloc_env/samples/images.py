"""Samples of cameras, LiDARs and radars."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.samples.base import Sample, check_arrays

EVENT = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
"""One event, 13 bytes: time since the drive began [ns], column, row [px], 1 = brighter or 0 = darker."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Image(Sample):
    """A colour picture."""

    rgb: NDArray[np.uint8]
    """sRGB values 0–255, shape (H, W, 3)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.uint8, (None, None, 3), "rgb")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class DepthImage(Sample):
    """Distance along the optical axis of every pixel."""

    depth_m: NDArray[np.float32]
    """Planar depth z [m], 0 = sky, shape (H, W)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.float32, (None, None), "depth_m")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class SemanticImage(Sample):
    """Tag and instance of every pixel."""

    tag: NDArray[np.uint8]
    """`Tag` of the surface, no unit, shape (H, W)."""
    instance: NDArray[np.uint32]
    """Instance id, 0 = none, shape (H, W)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.uint8, (None, None), "tag")
        check_arrays(self, np.uint32, (None, None), "instance")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FlowImage(Sample):
    """Optical flow: motion of every pixel's surface point until the camera's next picture."""

    flow_px: NDArray[np.float32]
    """Rightwards and downwards [px], of the sky by the camera's turning alone, shape (H, W, 2)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.float32, (None, None, 2), "flow_px")

    def observed(self) -> NDArray[np.float32]:
        """The flow [px]."""
        return self.flow_px


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class NormalImage(Sample):
    """Surface normals of every pixel, towards the camera."""

    normal: NDArray[np.float32]
    """Unit shading normal in the optical frame, zero for the sky, shape (H, W, 3)."""

    def __post_init__(self) -> None:
        check_arrays(self, np.float32, (None, None, 3), "normal")

    def observed(self) -> NDArray[np.float32]:
        """The normals."""
        return self.normal


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Events(Sample):
    """Events of an event camera in one period; `stamp_ns` is the end of the period."""

    events: NDArray[np.void]
    """Rows of `EVENT`, none later than `stamp_ns`, ordered by time, shape (N,)."""
    width_px: int
    """Width of the sensor [px]."""
    height_px: int
    """Height of the sensor [px]."""
    period_ns: int
    """Length of the period [ns]; all events lie after its beginning."""

    def __post_init__(self) -> None:
        if self.events.dtype != EVENT or self.events.ndim != 1:
            raise ValueError(f"Events.events is {self.events.dtype}{list(self.events.shape)}, not EVENT[N]")

    def observed(self) -> NDArray[np.uint8]:
        """Counts of brighter and darker events per pixel, 255 = 255 or more, shape (H, W, 2)."""
        e = self.events
        flat = (e["y"].astype(np.int64) * self.width_px + e["x"]) * 2 + (1 - e["p"].astype(np.int64))
        counts = np.bincount(flat, minlength=2 * self.width_px * self.height_px)
        shape = (self.height_px, self.width_px, 2)
        return np.minimum(counts, 255).astype(np.uint8).reshape(shape)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class PointCloud(Sample):
    """One LiDAR revolution in the sensor frame (FLU), each point where the sensor was at its time.

    `stamp_ns` is the start of the sweep. Rays without a return are left out.
    """

    points_xyz_m: NDArray[np.float32]
    """Hit points [m] in the instantaneous sensor frame, shape (N, 3)."""
    intensity: NDArray[np.float32]
    """Return strength 0–255, shape (N,)."""
    ring: NDArray[np.uint16]
    """Beam index, 0 = lowest unless the LiDAR has `rings_from_top`; of a Livox its line; shape (N,)."""
    offset_ns: NDArray[np.uint32]
    """Time after `stamp_ns` [ns], non-decreasing, shape (N,)."""
    sweep_ns: int
    """Length of the sweep [ns]."""
    tag: NDArray[np.uint8] | None = None
    """Semantic `Tag`, shape (N,); only in the semantic cloud."""
    instance: NDArray[np.uint32] | None = None
    """Instance id, shape (N,); only in the semantic cloud."""
    cos_incidence: NDArray[np.float32] | None = None
    """Cosine between ray and surface normal, shape (N,); only in the semantic cloud."""
    doppler_mps: NDArray[np.float32] | None = None
    """Rate of the range [m/s], positive = moving away, shape (N,); only of LiDARs with `doppler`."""

    def __post_init__(self) -> None:
        count = len(self.points_xyz_m)
        check_arrays(self, np.float32, (count, 3), "points_xyz_m")
        check_arrays(self, np.float32, (count,), "intensity", "cos_incidence", "doppler_mps")
        check_arrays(self, np.uint16, (count,), "ring")
        check_arrays(self, np.uint32, (count,), "offset_ns", "instance")
        check_arrays(self, np.uint8, (count,), "tag")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class RadarScan(Sample):
    """Detections of one radar frame, nearest first, in the radar's frame (FLU)."""

    range_m: NDArray[np.float32]
    """Distance [m], shape (N,)."""
    azimuth_rad: NDArray[np.float32]
    """Angle to the left of the x axis [rad], shape (N,)."""
    elevation_rad: NDArray[np.float32]
    """Angle above the x-y plane [rad], shape (N,)."""
    doppler_mps: NDArray[np.float32]
    """Rate of the distance [m/s]: positive = moving away from the radar, shape (N,)."""
    snr_db: NDArray[np.float32]
    """Measured signal-to-noise ratio [dB], shape (N,)."""
    rcs_dbsm: NDArray[np.float32]
    """Radar cross-section that explains the ratio [dBsm], shape (N,)."""
    tag: NDArray[np.uint8]
    """Truth: semantic `Tag` of the strongest scatterer, 0 for clutter and ghosts, shape (N,)."""
    instance: NDArray[np.uint32]
    """Truth: instance id of the strongest scatterer, 0 = none, shape (N,)."""
    origin: NDArray[np.uint8]
    """Truth: 0 = a thing, 1 = its mirror image (ghost), 2 = clutter, shape (N,)."""

    def __post_init__(self) -> None:
        count = len(self.range_m)
        measured = "range_m", "azimuth_rad", "elevation_rad", "doppler_mps", "snr_db", "rcs_dbsm"
        check_arrays(self, np.float32, (count,), *measured)
        check_arrays(self, np.uint8, (count,), "tag", "origin")
        check_arrays(self, np.uint32, (count,), "instance")

    @property
    def points_xyz_m(self) -> NDArray[np.float32]:
        """Detections as points [m] in the radar's frame, shape (N, 3)."""
        flat = self.range_m * elementary.cos(self.elevation_rad)
        up = self.range_m * elementary.sin(self.elevation_rad)
        ahead, left = flat * elementary.cos(self.azimuth_rad), flat * elementary.sin(self.azimuth_rad)
        return np.stack([ahead, left, up], axis=-1)
