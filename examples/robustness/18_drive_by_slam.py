"""Closed-loop driving: your own policy drives by the pose of a SLAM system in place of the true one.

python examples/robustness/18_drive_by_slam.py Town06 small_gicp
"""

import sys
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from carlaloc_env import DriverView
from recorder import EstimatedPoseEnv, PoseSource, SystemPose


def keep_lane(view: DriverView) -> NDArray[np.float32]:
    """Steer towards the route's line, at 8 m/s at most; this policy uses nothing else."""
    ahead = view.route.at(view.route_s_m + 0.5 * view.speed_mps)
    turn = np.sin(view.heading_rad - float(ahead.heading_rad[0]))
    steer = np.clip(-0.1 * view.offset_m - 1.2 * turn, -1.0, 1.0)
    return np.array([steer, 0.5 * (view.speed_mps < 8.0), 0.0, 0.0, 0.0], np.float32)


def main(town: str, source: PoseSource, rig: str = "lidar", seconds: float = 20.0) -> dict[str, Any]:
    """Drive for some time, and print how far the car and its believed pose strayed."""
    env = EstimatedPoseEnv(
        gymnasium.make(
            "CarlaLoc-v0", map=town, rig=rig, action="controls", traffic="static", info=("samples",)
        ),
        source,
    )
    _, info = env.reset(seed=0)
    ended, steps = False, 0
    while not ended and steps < 20 * seconds:
        _, _, terminated, truncated, info = env.step(keep_lane(env.world.driver_view()))
        ended, steps = terminated or truncated, steps + 1
    print(f"{info['route_s_m']:.0f} m driven, {info['route_offset_m']:+.2f} m left of the line, "
          f"pose {info['pose_error_m']:.2f} m off, ended by {info['ended_by']}")  # fmt: skip
    env.close()
    return info


if __name__ == "__main__":
    main(sys.argv[1], SystemPose(sys.argv[2]))
