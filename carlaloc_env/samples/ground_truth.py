"""Samples of the truth: motion of the car, and boxes of all other road users."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.samples.base import Sample, check_arrays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
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
        vectors = "position_m", "velocity_world_mps", "angular_rate_radps", "acceleration_world_mps2"
        check_arrays(self, np.float64, (3,), *vectors)
        check_arrays(self, np.float64, (4,), "quat_xyzw")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
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
    roll_rad: NDArray[np.float64]
    """Left side up positive [rad], shape (N,)."""
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
        check_arrays(self, np.uint32, (count,), "id")
        check_arrays(self, np.uint8, (count,), "tag")
        check_arrays(self, np.float64, (count, 3), "position_m", "size_m", "velocity_mps")
        angles = "heading_rad", "pitch_rad", "roll_rad", "yaw_rate_radps"
        check_arrays(self, np.float64, (count,), *angles, "visible", "distance_m")

    def __repr__(self) -> str:
        """One line: how many there are."""
        return f"ObjectList(stamp_ns={self.stamp_ns}, {len(self.id)} objects)"

    @property
    def quat_xyzw(self) -> NDArray[np.float64]:
        """Attitudes, map box to world, shape (N, 4)."""
        return transforms.rpy_to_quat(self.roll_rad, -self.pitch_rad, self.heading_rad)
