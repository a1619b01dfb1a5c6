"""Draw docs/pictures/observations.jpg: an agent's observations, and the view from the seat.

`python docs/scripts/make_observation_picture.py`
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.envs.task.birds_eye_view import CHANNELS, LIGHTS, WALKER
from carlaloc_env.envs.task.state_vector import state_names
from carlaloc_env.traffic.signals import SignalState

PICTURE = Path(__file__).parents[1] / "pictures" / "observations.jpg"
SEED, STEPS, PICTURE_PX = 3, 130, 480
COLOURS_RGB = {"road": (70, 70, 75), "lanes": (215, 215, 215), "route": (40, 90, 190)}
LIGHT_RGB = {
    SignalState.RED: (235, 40, 30),
    SignalState.YELLOW: (240, 190, 30),
    SignalState.GREEN: (40, 200, 80),
}
SHOWN = (
    "speed", "speed_limit", "lateral_offset", "heading_error_sin", "route_left_4", "route_curvature_4",
    "light_distance", "light_red", "light_green", "gap", "gap_closing", "neighbour_0_forward",
    "neighbour_0_left", "neighbour_0_forward_velocity",
)  # fmt: skip


def main() -> None:
    """Drive for some seconds and draw."""
    env = CarlaLocEnv(map="Town03", rig="bev", render_mode="rgb_array")
    observation, _ = env.reset(seed=SEED)
    for _ in range(STEPS):
        observation = env.step(_follow(observation["state"]))[0]
    seat = env.render()
    assert seat is not None
    env.close()
    height = PICTURE_PX
    view = cv2.resize(seat, (round(640 * height / 360), height), interpolation=cv2.INTER_AREA)
    parts: list[NDArray[Any]] = [
        view,
        from_above(observation["bev"], height),
        numbers(observation["state"], height),
    ]
    picture = cv2.cvtColor(np.hstack(parts), cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(PICTURE), picture, [cv2.IMWRITE_JPEG_QUALITY, 90])


def _follow(state: NDArray[np.float32]) -> NDArray[np.float32]:
    """Steer towards the route and keep off what is ahead."""
    observed = dict(zip(state_names(), state.tolist(), strict=True))
    room_m = min(
        100.0 * observed["gap"], 100.0 * observed["light_distance"] if observed["light_red"] else 100.0
    )
    wanted_mps = min(8.0, max(0.5 * (room_m - 5.0), 0.0))
    pedal = np.clip(0.3 * (wanted_mps - 40.0 * observed["speed"]), -0.6, 0.5)
    return np.array([np.clip(1.6 * observed["route_left_2"], -1.0, 1.0), pedal], np.float32)


def from_above(bev: NDArray[np.uint8], size_px: int) -> NDArray[np.uint8]:
    """The bird's-eye view in colours."""
    shown = np.full((*bev.shape[:2], 3), 25, np.uint8)
    for name, colour in COLOURS_RGB.items():
        shown[bev[..., CHANNELS.index(name)] > 0] = colour
    actors, lights = bev[..., CHANNELS.index("actors")], bev[..., CHANNELS.index("lights")]
    shown[actors > WALKER], shown[actors == WALKER] = (250, 190, 60), (240, 90, 200)
    for state, value in LIGHTS.items():
        shown[lights == value] = LIGHT_RGB[state]
    return np.asarray(cv2.resize(shown, (size_px, size_px), interpolation=cv2.INTER_NEAREST), np.uint8)


def numbers(state: NDArray[np.float32], height_px: int) -> NDArray[np.uint8]:
    """Some entries of the state vector as bars from −1 to 1."""
    panel = np.full((height_px, 430, 3), 250, np.uint8)
    observed = dict(zip(state_names(), state.tolist(), strict=True))
    step = height_px // len(SHOWN)
    for number, name in enumerate(SHOWN):
        y = number * step + step // 2
        _write(panel, name, (10, y + 5))
        middle, end = 340, 340 + round(80 * observed[name])
        cv2.rectangle(panel, (middle - 80, y - 7), (middle + 80, y + 7), (225, 225, 225), -1)
        cv2.rectangle(panel, (min(middle, end), y - 7), (max(middle, end), y + 7), (40, 90, 190), -1)
        cv2.line(panel, (middle, y - 9), (middle, y + 9), (120, 120, 120), 1)
    return panel


def _write(panel: NDArray[Any], text: str, at: tuple[int, int]) -> None:
    cv2.putText(panel, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (30, 30, 30), 1, cv2.LINE_AA)


if __name__ == "__main__":
    main()
