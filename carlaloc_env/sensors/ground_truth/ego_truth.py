"""Ground truth: the spline itself, read at any frame fixed to the car."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from carlaloc_env.samples import Odometry
from carlaloc_env.timeline.timeline import Timeline


def truth_at(
    timeline: Timeline, stamps_ns: Sequence[int], T_base_sensor: ArrayLike, *, frame_id: str = "base_link"
) -> list[Odometry]:
    """True motion of a frame on the car, one `Odometry` per stamp.

    Args:
        timeline: Where the ego was.
        stamps_ns: Times since the drive began [ns].
        T_base_sensor: Maps the frame's coordinates to `base_link`, shape (4, 4).
        frame_id: Name of the frame.
    """
    if not len(stamps_ns):
        return []
    motion = timeline.ego_motion(stamps_ns).at_mount(T_base_sensor)
    return [
        Odometry(
            sensor="truth",
            frame_id=frame_id,
            stamp_ns=int(stamp),
            position_m=motion.position_m[i].copy(),
            quat_xyzw=motion.quat_xyzw[i].copy(),
            velocity_world_mps=motion.velocity_world_mps[i].copy(),
            angular_rate_radps=motion.omega_body_radps[i].copy(),
            acceleration_world_mps2=motion.acceleration_world_mps2[i].copy(),
        )
        for i, stamp in enumerate(stamps_ns)
    ]
