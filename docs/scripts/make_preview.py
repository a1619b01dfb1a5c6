"""Draw docs/gallery/sensor_preview.png, what the paper's rig gives: `python docs/scripts/make_preview.py`.

Nine panels of one instant, as in the CARLA-Loc paper: the left camera in three weathers; its depth,
semantics and events; the same street without traffic, and the LiDAR with and without it.
Without an episode it records one first, a minute and a half of the scripted driver in Town10.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from make_pictures import busiest_s
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.samples import DepthImage, Events, Image, PointCloud, Sample, SemanticImage
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.base import Camera
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.build import load_town
from carlaloc_env.weather.presets import weather_by_name
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.episode.traffic_level import traffic_level
from recorder.report.mosaic import depth_image, lidar_image, semantic_image

PICTURE = Path(__file__).parents[1] / "gallery" / "sensor_preview.png"
WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
CAPTIONS = (
    "(a) Clear noon", "(b) Foggy noon", "(c) Rainy night",
    "(d) Depth camera", "(e) Semantic segmentation", "(f) Event camera",
    "(g) Static scenario", "(h) LiDAR (dynamic)", "(i) LiDAR (static)",
)  # fmt: skip
PANEL_PX = (464, 261)
CAPTION_PX = 44
Picture = NDArray[np.uint8]


def draw(episode: Episode, at_s: float, quality: str) -> Picture:
    """The nine panels with their captions, sRGB."""
    dynamic = episode.timeline()
    static = traffic_level("static").select(dynamic)
    at_ns = min(round(at_s * 1e9), dynamic.end_ns - 2 * STEP_NS) // STEP_NS * STEP_NS
    weathers = [weather_by_name(name) for name in WEATHERS]
    stage = SensorStage(
        load_town(episode.header.map_name), seed=episode.header.seed, weather=weathers[0], quality=quality
    )
    rig = rig_by_name("paper").build(stage)
    camera = next(s for s in rig.sensors if isinstance(s, Camera))
    lidar = next(s for s in rig.sensors if s.config.kind == "lidar")
    shots = camera.measure_conditions(dynamic, at_ns, weathers)
    empty = camera.measure_conditions(static, at_ns, weathers[:1])

    def scan(timeline: Timeline) -> Picture:
        cloud = _one(lidar.measure(timeline, [at_ns]), PointCloud)
        return lidar_image(cloud, *PANEL_PX)

    panels = [
        *(_one(shot, Image).rgb for shot in shots),
        depth_image(_one(shots[0], DepthImage)),
        semantic_image(_one(shots[0], SemanticImage)),
        events_image(_one(shots[0], Events)),
        _one(empty[0], Image).rgb,
        scan(dynamic),
        scan(static),
    ]
    stage.close()
    labelled = [_panel(picture, caption) for picture, caption in zip(panels, CAPTIONS, strict=True)]
    return np.vstack([np.hstack(labelled[row : row + 3]) for row in (0, 3, 6)])


def events_image(events: Events) -> Picture:
    """Pixels that fired within 10 ms: red where brighter, blue where darker, sRGB (H, W, 3)."""
    rows = events.events
    rows = rows[rows["t"] > rows["t"].max(initial=0) - 10_000_000]
    picture = np.zeros((events.height_px, events.width_px, 3), np.uint8)
    picture[rows["y"], rows["x"]] = np.where(rows["p"][:, None] > 0, (255, 60, 60), (70, 70, 255))
    return picture


def _one(samples: list[Sample], kind: type[Any]) -> Any:
    return next(s for s in samples if isinstance(s, kind))


def _panel(picture: Picture, caption: str) -> NDArray[Any]:
    small = cv2.resize(picture, PANEL_PX, interpolation=cv2.INTER_AREA)
    strip = np.full((CAPTION_PX, PANEL_PX[0], 3), 255, np.uint8)
    font, size = cv2.FONT_HERSHEY_TRIPLEX, 0.7
    width = cv2.getTextSize(caption, font, size, 1)[0][0]
    place = ((PANEL_PX[0] - width) // 2, 29)
    cv2.putText(strip, caption, place, font, size, (0, 0, 0), 1, cv2.LINE_AA)
    framed = np.vstack([small, strip])
    return cv2.copyMakeBorder(framed, 1, 0, 1, 1, cv2.BORDER_CONSTANT, value=(255, 255, 255))


def main(drive: Path | None, at_s: float | None, quality: str, out: Path = PICTURE) -> Path:
    """Draw the picture and write it."""
    with tempfile.TemporaryDirectory() as folder:
        if drive is None:
            config = RecordConfig(out=Path(folder) / "drive.mcap", map="Town10", duration_s=90.0, seed=3)
            drive = record(config).path
        episode = Episode.load(drive)
        picture = draw(episode, busiest_s(episode) if at_s is None else at_s, quality)
    out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(out), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("episode", type=Path, nargs="?", help="a recorded drive (.mcap)")
    parser.add_argument("--at", type=float, help="instant to draw [s]; else the busiest")
    parser.add_argument("--quality", default="medium", help="low, medium or high")
    parser.add_argument("--out", type=Path, default=PICTURE, help="the picture")
    arguments = parser.parse_args()
    main(arguments.episode, arguments.at, arguments.quality, arguments.out)
