"""Draw docs/pictures/sensors.jpg, the README's picture: `python docs/scripts/make_pictures.py [DRIVE]`."""

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.transforms import quat_conjugate, quat_rotate
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.build import load_town
from carlaloc_env.weather.presets import weather_by_name
from recorder.demo.story import DEMO_DRIVE
from recorder.episode.actor_messages import actor_states
from recorder.episode.episode import Episode
from recorder.report.instant import pictures_of_instant, rows_of_three

PICTURE = Path(__file__).parents[1] / "pictures" / "sensors.jpg"
WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
LARGEST_BYTES = 600_000


def draw(episode: Episode, at_s: float, quality: str) -> NDArray[np.uint8]:
    """Six panels of one instant, sRGB: the left camera in three weathers, depth, semantics, LiDAR."""
    town = load_town(episode.header.map_name)
    stage = SensorStage(town, seed=episode.header.seed, weather=weather_by_name(WEATHERS[0]), quality=quality)
    picture = rows_of_three(pictures_of_instant(stage, episode.timeline(), at_s, WEATHERS))
    stage.close()
    return picture


def busiest_s(episode: Episode) -> float:
    """Second in which most others are within 40 m before the moving car, and none close to it [s]."""
    ego, others = episode.ego[:-200:200], actor_states(episode.steps).position_m
    others = others[: 20 * len(ego) : 20]
    ego = ego[: len(others)]
    ahead = quat_rotate(
        quat_conjugate(ego["quat_xyzw"])[:, None], others.astype(np.float64) - ego["position_m"][:, None]
    )
    seen = (ahead[..., 0] > 5) & (ahead[..., 0] < 40) & (np.abs(ahead[..., 1]) < ahead[..., 0])
    hidden = ((np.abs(ahead[..., 0]) < 15) & (np.abs(ahead[..., 1]) < 6)).any(axis=1)
    return float(np.argmax(seen.sum(axis=1) + 100 * ((ego["speed_mps"] > 3.0) & ~hidden)))


def main(drive: Path, at_s: float | None, quality: str, out: Path = PICTURE) -> Path:
    """Draw the picture, as good as 600 kB allow."""
    episode = Episode.load(drive)
    at_s = busiest_s(episode) if at_s is None else at_s
    picture = cv2.cvtColor(draw(episode, at_s, quality), cv2.COLOR_RGB2BGR)
    out.parent.mkdir(parents=True, exist_ok=True)
    for percent in range(92, 20, -4):
        cv2.imwrite(str(out), picture, [cv2.IMWRITE_JPEG_QUALITY, percent])
        if out.stat().st_size <= LARGEST_BYTES:
            break
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "episode", type=Path, nargs="?", default=DEMO_DRIVE, help="else that of the demo (.mcap)"
    )
    parser.add_argument("--at", type=float, help="instant to draw [s]; else the busiest")
    parser.add_argument("--quality", default="medium", help="low, medium or high")
    arguments = parser.parse_args()
    main(arguments.episode, arguments.at, arguments.quality)
