"""Use your own sensor rig from a YAML file, and change it in Python."""

from dataclasses import replace
from pathlib import Path

import cv2
import gymnasium
import numpy as np

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env import LidarConfig, SensorRig

RIG_FILE = Path(__file__).with_suffix(".yaml")
REAR_PICTURE = Path("rear.png")


def main(rig_file: Path = RIG_FILE, out: Path = REAR_PICTURE) -> SensorRig:
    """Reset an environment with the rig of a file and save the camera's picture."""
    rig = with_columns(SensorRig.load(rig_file), 450)
    for frame, T_base_sensor in rig.frames.items():
        print(f"{frame:<12} at {T_base_sensor[:3, 3]} m in base_link")
    env = gymnasium.make("CarlaLoc-Town03-v0", rig=rig, weather="FoggyNoon")
    observation, _ = env.reset(seed=1)
    for _ in range(3):
        observation, *_ = env.step(np.zeros(2, np.float32))
    env.close()
    cv2.imwrite(str(out), cv2.cvtColor(observation["rgb_rear"], cv2.COLOR_RGB2BGR))
    points = observation["roof"][: int(observation["roof_count"][0])]
    nearest_m = np.sqrt(np.sum(points[:, :3] ** 2, axis=1)).min()
    print(f"{out}; {len(points)} points, the nearest {nearest_m:.2f} m away")
    return rig


def with_columns(rig: SensorRig, columns: int) -> SensorRig:
    """The same rig with so many LiDAR columns per revolution; configurations are never changed in place."""
    sensors = tuple(replace(s, columns=columns) if isinstance(s, LidarConfig) else s for s in rig.sensors)
    return replace(rig, sensors=sensors)


if __name__ == "__main__":
    main()
