"""Film docs/pictures/agent.mp4: the agent of example 19 drives Town01's route among unseen traffic.

`python docs/scripts/make_learning_film.py`, with the extra `learn`.
"""

import sys
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from make_observation_picture import from_above
from numpy.typing import NDArray

from carlaloc_env.envs.carlaloc_env import CarlaLocEnv

ROOT = Path(__file__).parents[2]
FILM = ROOT / "docs" / "pictures" / "agent.mp4"
SEED, HEIGHT_PX, FRAME_RATE_HZ = 10_002, 270, 20
"""Four times as fast as real time, at five actions a second."""


def main() -> None:
    """Drive and film."""
    sys.path.insert(0, str(ROOT / "examples"))
    from stable_baselines3.common.vec_env import DummyVecEnv

    from learning.agent import act, load, new_agent
    from learning.drive_env import drive_env
    from learning.others import apart

    env = CarlaLocEnv(map="Town01", rig="bev", action="ackermann", frame_skip=4, render_mode="rgb_array")
    agent = new_agent(DummyVecEnv([lambda: drive_env(["Town01"])]))
    load(agent, ROOT / "examples" / "learning" / "town01_agent.pt")
    observation, info = env.reset(seed=SEED)
    with av.open(str(FILM), "w") as film:
        stream = film.add_stream("libx264", rate=FRAME_RATE_HZ, options={"crf": "32", "preset": "slow"})
        stream.pix_fmt, stream.width, stream.height = "yuv420p", 750, HEIGHT_PX
        while info["ended_by"] is None:
            picture = frame(env.render(), observation["bev"], info, env.world.state.speed_mps)
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            observation, _, _, _, info = env.step(act(agent, apart(observation["state"])))
        film.mux(stream.encode())
    env.close()


def frame(
    seat: NDArray[np.uint8] | None, bev: NDArray[np.uint8], info: dict[str, Any], speed_mps: float
) -> NDArray[np.uint8]:
    """The view from the seat, the bird's-eye view, and how far and how fast."""
    assert seat is not None
    view = cv2.resize(seat, (480, HEIGHT_PX), interpolation=cv2.INTER_AREA)
    text = f"{3.6 * abs(speed_mps):3.0f} km/h   {info['route_s_m']:4.0f} of {info['route_length_m']:.0f} m"
    for colour, width in ((0, 3), (255, 1)):
        cv2.putText(view, text, (10, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (colour,) * 3, width, cv2.LINE_AA)
    return np.hstack([np.asarray(view, np.uint8), from_above(bev, HEIGHT_PX)])


if __name__ == "__main__":
    main()
