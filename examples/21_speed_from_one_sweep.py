"""The car's velocity from one sweep of an FMCW LiDAR, whose points have the rate of their range.

carlaloc record --map Town03 --device scripted --duration 20 --out drive.mcap
python examples/21_speed_from_one_sweep.py drive.mcap
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import LidarConfig, Mount, PointCloud, SensorStage, weather_by_name
from recorder import Episode, town_of

MOUNT = Mount(position_m=(1.2, 0.0, 1.85))


def velocity_of(cloud: PointCloud, rounds: int = 10) -> NDArray[np.float64]:
    """Velocity of the LiDAR in its own frame [m/s]: of a thing at rest along u the rate is −u·v.

    Points that do not agree, such as those of other cars, lose their weight from round to round.
    """
    assert cloud.doppler_mps is not None
    along = cloud.points_xyz_m / np.linalg.norm(cloud.points_xyz_m, axis=1, keepdims=True)
    weight, velocity = np.ones(len(along)), np.zeros(3)
    for _ in range(rounds):
        rows = along * weight[:, None]
        velocity = np.linalg.lstsq(rows, -cloud.doppler_mps * weight, rcond=None)[0]
        weight = 1.0 / (1.0 + ((cloud.doppler_mps + along @ velocity) / 0.1) ** 2)
    return velocity


def main(drive: Path, at_s: float = 10.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Print measured and true velocity in the middle of a sweep."""
    episode = Episode.load(drive)
    stage = SensorStage(town_of(episode), seed=1, weather=weather_by_name("ClearNoon"))
    config = LidarConfig(**{**LidarConfig.preset_values("aeries2"), "mount": MOUNT, "outputs": ("cloud",)})
    timeline, stamp_ns = episode.timeline(), round(at_s * 10) * config.sweep_ns
    cloud = config.build(stage).measure(timeline, [stamp_ns])[0]
    assert isinstance(cloud, PointCloud)
    motion = timeline.ego_motion([stamp_ns + config.sweep_ns // 2]).at_mount(MOUNT.T_base_sensor)
    truth = motion.T_world_frame[0, :3, :3].T @ motion.velocity_world_mps[0]
    measured = velocity_of(cloud)
    print(f"{len(cloud.ring)} points: {measured.round(3)} m/s forward, left, up; truth {truth.round(3)}")
    return measured, truth


if __name__ == "__main__":
    main(Path(sys.argv[1]))
