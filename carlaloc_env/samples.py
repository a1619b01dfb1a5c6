"""What sensors put out: one frozen dataclass per kind, checked for dtype and shape when made.

Every sample names its `sensor` (the observation key), its `frame_id` and its `stamp_ns`, the time
of measurement since the drive began.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import geometry


def _check(sample: object, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]) -> None:
    array: NDArray[Any] = getattr(sample, name)
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if array.dtype != np.dtype(dtype) or not fits:
        raise ValueError(
            f"{type(sample).__name__}.{name} is {array.dtype}{list(array.shape)}, "
            f"not {np.dtype(dtype)}{[n if n is not None else 'N' for n in shape]}"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """Common part of all samples."""

    sensor: str
    """Name of the stream, e.g. ``rgb_left``; also the observation key."""
    frame_id: str
    """Coordinate frame of the data, e.g. ``camera_left``."""
    stamp_ns: int
    """Time of measurement since the drive began [ns]."""

    def __eq__(self, other: object) -> bool:
        """Whether kind, names, stamp and every number are the same."""
        if type(self) is not type(other):
            return NotImplemented
        return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    __hash__ = None  # type: ignore[assignment]


def _same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(a == b)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image(Sample):
    """A colour picture."""

    rgb: NDArray[np.uint8]
    """sRGB values 0–255, shape (H, W, 3)."""

    def __post_init__(self) -> None:
        _check(self, "rgb", np.uint8, (None, None, 3))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthImage(Sample):
    """Distance along the optical axis of every pixel."""

    depth_m: NDArray[np.float32]
    """Planar depth z [m], 0 = sky, shape (H, W)."""

    def __post_init__(self) -> None:
        _check(self, "depth_m", np.float32, (None, None))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SemanticImage(Sample):
    """What every pixel shows."""

    tag: NDArray[np.uint8]
    """`Tag` of the surface, no unit, shape (H, W)."""
    instance: NDArray[np.uint32]
    """Instance id, 0 = none, shape (H, W)."""

    def __post_init__(self) -> None:
        _check(self, "tag", np.uint8, (None, None))
        _check(self, "instance", np.uint32, (None, None))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlowImage(Sample):
    """Optical flow: how far what every pixel shows moves until the camera's next picture."""

    flow_px: NDArray[np.float32]
    """Rightwards and downwards [px], of the sky by the camera's turning alone, shape (H, W, 2)."""

    def __post_init__(self) -> None:
        _check(self, "flow_px", np.float32, (None, None, 2))

    def observed(self) -> NDArray[np.float32]:
        """The flow [px]."""
        return self.flow_px


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NormalImage(Sample):
    """Surface normals of every pixel, towards the camera."""

    normal: NDArray[np.float32]
    """Unit shading normal in the optical frame, zero for the sky, shape (H, W, 3)."""

    def __post_init__(self) -> None:
        _check(self, "normal", np.float32, (None, None, 3))

    def observed(self) -> NDArray[np.float32]:
        """The normals."""
        return self.normal


EVENT = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
"""One event, 13 bytes: time since the drive began [ns], column, row [px], 1 = brighter or 0 = darker."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Events(Sample):
    """What an event camera fired in one period; `stamp_ns` is the end of the period."""

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointCloud(Sample):
    """One LiDAR revolution in the sensor frame (FLU), each point where the sensor was at its time.

    `stamp_ns` is the start of the sweep. Rays without a return are left out.
    """

    points_xyz_m: NDArray[np.float32]
    """Hit points [m] in the instantaneous sensor frame, shape (N, 3)."""
    intensity: NDArray[np.float32]
    """Return strength 0–255, shape (N,)."""
    ring: NDArray[np.uint16]
    """Beam index, 0 = lowest, shape (N,)."""
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

    def __post_init__(self) -> None:
        count = len(self.points_xyz_m)
        _check(self, "points_xyz_m", np.float32, (count, 3))
        _check(self, "intensity", np.float32, (count,))
        _check(self, "ring", np.uint16, (count,))
        _check(self, "offset_ns", np.uint32, (count,))
        if self.tag is not None:
            _check(self, "tag", np.uint8, (count,))
        if self.instance is not None:
            _check(self, "instance", np.uint32, (count,))
        if self.cos_incidence is not None:
            _check(self, "cos_incidence", np.float32, (count,))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
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
        for name in ("range_m", "azimuth_rad", "elevation_rad", "doppler_mps", "snr_db", "rcs_dbsm"):
            _check(self, name, np.float32, (count,))
        _check(self, "tag", np.uint8, (count,))
        _check(self, "instance", np.uint32, (count,))
        _check(self, "origin", np.uint8, (count,))

    @property
    def points_xyz_m(self) -> NDArray[np.float32]:
        """Detections as points [m] in the radar's frame, shape (N, 3)."""
        flat = self.range_m * np.cos(self.elevation_rad)
        up = self.range_m * np.sin(self.elevation_rad)
        return np.stack([flat * np.cos(self.azimuth_rad), flat * np.sin(self.azimuth_rad), up], axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Imu(Sample):
    """One inertial measurement in the IMU frame; at rest the up axis reads +9.81 m/s²."""

    specific_force_mps2: NDArray[np.float64]
    """Specific force [m/s²], frame `frame_id`, shape (3,)."""
    angular_rate_radps: NDArray[np.float64]
    """Body rate [rad/s], frame `frame_id`, shape (3,)."""
    quat_xyzw: NDArray[np.float64] | None = None
    """Attitude: maps `frame_id` to world (ENU), unit quaternion xyzw, shape (4,); None: not estimated."""
    orientation_noise_rad: float = 0.0
    """Standard deviation of the attitude per axis [rad]."""

    def __post_init__(self) -> None:
        _check(self, "specific_force_mps2", np.float64, (3,))
        _check(self, "angular_rate_radps", np.float64, (3,))
        if self.quat_xyzw is not None:
            _check(self, "quat_xyzw", np.float64, (4,))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GnssFix(Sample):
    """One satellite fix on WGS84."""

    latitude_deg: float
    """Latitude [deg]."""
    longitude_deg: float
    """Longitude [deg]."""
    altitude_m: float
    """Height above the ellipsoid [m]."""
    covariance_enu_m2: NDArray[np.float64]
    """Covariance of the position, east, north, up [m²], shape (3, 3)."""
    has_fix: bool = True
    """Whether enough satellites were seen; without a fix the place is NaN."""
    solution: str = "single"
    """How the place was found: ``none``, ``single``, or with a base station ``float`` or ``fixed``."""
    satellites: int = 0
    """Number of satellites used [1]; 0 where none are modelled."""

    def __post_init__(self) -> None:
        _check(self, "covariance_enu_m2", np.float64, (3, 3))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Speed(Sample):
    """The speedometer."""

    speed_mps: float
    """Forward speed of base_link [m/s], negative backwards."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WheelTicks(Sample):
    """Counters of the wheels: front left, front right, rear left, rear right."""

    ticks: NDArray[np.int64]
    """Ticks counted since the drive began, less when rolling back, shape (4,)."""
    rate_radps: NDArray[np.float64]
    """Spin over the last period, from the ticks in it [rad/s], shape (4,)."""
    ticks_per_turn: int
    """Ticks in one turn of a wheel [1]; 96 = two of each of 48 teeth."""

    def __post_init__(self) -> None:
        _check(self, "ticks", np.int64, (4,))
        _check(self, "rate_radps", np.float64, (4,))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CanState(Sample):
    """What a car tells on its CAN bus, rounded to the bus' steps."""

    steering_wheel_rad: float
    """Angle of the steering wheel, left positive [rad]."""
    speed_mps: float
    """Speed on the dashboard: mean of the rear wheels', negative backwards [m/s]."""
    wheel_speed_mps: NDArray[np.float64]
    """Speed of each wheel's tread: front left, front right, rear left, rear right [m/s], shape (4,)."""
    throttle: float
    """Throttle pedal [0–1], 1 = down."""
    brake: float
    """Brake pedal [0–1], 1 = down."""
    gear: int
    """Selected gear [1 or −1]: 1 = forwards, −1 = reverse."""
    handbrake: bool
    """Whether the handbrake is pulled, 1 = pulled."""

    def __post_init__(self) -> None:
        _check(self, "wheel_speed_mps", np.float64, (4,))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry(Sample):
    """True motion of a frame; `frame_id` is the frame whose motion this is."""

    position_m: NDArray[np.float64]
    """Position in the world [m], shape (3,)."""
    quat_xyzw: NDArray[np.float64]
    """Attitude: maps `frame_id` to world, unit quaternion xyzw, shape (4,)."""
    velocity_world_mps: NDArray[np.float64]
    """Velocity in world axes [m/s], shape (3,)."""
    angular_rate_radps: NDArray[np.float64]
    """Body rate in `frame_id` [rad/s], shape (3,)."""
    acceleration_world_mps2: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """Acceleration in world axes, gravity not included [m/s²], shape (3,)."""

    def __post_init__(self) -> None:
        _check(self, "position_m", np.float64, (3,))
        _check(self, "quat_xyzw", np.float64, (4,))
        _check(self, "velocity_world_mps", np.float64, (3,))
        _check(self, "angular_rate_radps", np.float64, (3,))
        _check(self, "acceleration_world_mps2", np.float64, (3,))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectList(Sample):
    """True boxes of all other road users, whether seen or not, parallel arrays of N."""

    id: NDArray[np.uint32]
    """Instance id, the one that points and pixels carry, shape (N,)."""
    tag: NDArray[np.uint8]
    """Semantic `Tag`, shape (N,)."""
    position_m: NDArray[np.float64]
    """Middle of the box in the world [m], shape (N, 3)."""
    heading_rad: NDArray[np.float64]
    """Direction the object faces, anticlockwise from east [rad], shape (N,)."""
    pitch_rad: NDArray[np.float64]
    """Nose up positive [rad], shape (N,)."""
    size_m: NDArray[np.float64]
    """Length, width, height [m], shape (N, 3)."""
    velocity_mps: NDArray[np.float64]
    """Velocity in world axes [m/s], shape (N, 3)."""
    yaw_rate_radps: NDArray[np.float64]
    """Rate of the heading [rad/s], shape (N,)."""
    visible: NDArray[np.float64]
    """Share that is not hidden behind other things, 0–1; NaN beyond 120 m or unknown, shape (N,)."""
    distance_m: NDArray[np.float64]
    """Distance from where visibility is judged [m], shape (N,)."""

    def __post_init__(self) -> None:
        count = len(self.id)
        _check(self, "id", np.uint32, (count,))
        _check(self, "tag", np.uint8, (count,))
        for name in ("position_m", "size_m", "velocity_mps"):
            _check(self, name, np.float64, (count, 3))
        for name in ("heading_rad", "pitch_rad", "yaw_rate_radps", "visible", "distance_m"):
            _check(self, name, np.float64, (count,))

    @property
    def occluded(self) -> NDArray[np.float64]:
        """Share that is hidden behind other things, shape (N,)."""
        return 1.0 - self.visible

    @property
    def quat_xyzw(self) -> NDArray[np.float64]:
        """Attitudes, map box to world, shape (N, 4)."""
        return geometry.rpy_to_quat(np.zeros(len(self.id)), -self.pitch_rad, self.heading_rad)
