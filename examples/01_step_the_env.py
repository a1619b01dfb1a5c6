"""Step the Gymnasium environment: drive along the route with three lines of steering."""

import gymnasium
import numpy as np

from carlaloc_env import SensorRig, quat_to_rpy, wrap_angle

TARGET_SPEED_MPS = 8.0


def main(steps: int = 200, rig: str | SensorRig = "minimal") -> float:
    """Drive for some steps of 50 ms and return the distance along the route [m]."""
    env = gymnasium.make("CarlaLoc-Town03-v0", rig=rig, weather="ClearSunset", traffic="static")
    observation, info = env.reset(seed=1)
    for key, array in observation.items():
        print(f"{key:<12} {array.dtype!s:<8} {array.shape}")
    route = env.unwrapped.world.route  # type: ignore[attr-defined]
    for step in range(steps):
        # Towards a point 8 m ahead on the route, by the true pose; an agent would use the observation.
        ahead = route.at(info["route_s_m"] + 8.0).position_m[0]
        truth = info["truth"]
        towards = np.arctan2(*(ahead - truth.position_m)[1::-1])
        turn = wrap_angle(towards - quat_to_rpy(truth.quat_xyzw)[2])
        slower = float(observation["speed"][0]) > TARGET_SPEED_MPS
        action = np.array([np.clip(turn, -1, 1), 0.0 if slower else 0.4], np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        if step % 50 == 49:
            print(f"{info['stamp_ns'] / 1e9:5.1f} s  {info['route_s_m']:6.1f} m  reward {reward:.2f}")
        if terminated or truncated:
            break
    env.close()
    return float(info["route_s_m"])


if __name__ == "__main__":
    main()
