"""Film docs/pictures/drive.webp, with which README opens: `python docs/scripts/make_film.py [DRIVE]`.

The same metres in clear air, in fog, in rain at night and among traffic, and below the LiDAR from above.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image as Picture

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.rigs.presets import flu_rig
from carlaloc_env.samples import Image, PointCloud
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.build import load_town
from carlaloc_env.weather.presets import weather_by_name
from recorder.demo.story import DEMO_DRIVE
from recorder.episode.episode import Episode
from recorder.episode.traffic_level import traffic_level
from recorder.report.mosaic import labelled_panel, lidar_image

FILM = Path(__file__).parents[1] / "pictures" / "drive.webp"
STATIC = {"clear noon": "ClearNoon", "fog": "FoggyNoon", "rain at night": "RainyNight"}
"""Weathers of the panels without movers, by label."""
BEGIN_S, LENGTH_S, EVERY_STEPS = 17.0, 6.0, 2
"""Where the demo's drive crosses among others [s], length [s], steps of the drive from frame to frame."""
LARGEST_BYTES = 5_000_000
WIDTH_PX = 960


def frames(episode: Episode, begin_s: float, quality: str) -> Iterator[U8]:
    """Frames of the film, sRGB."""
    town = load_town(episode.header.map_name)
    stage = SensorStage(town, seed=episode.header.seed, weather=weather_by_name("ClearNoon"), quality=quality)
    sensors = flu_rig().sensors
    camera = next(c for c in sensors if isinstance(c, CameraConfig) and c.name == "left")
    left = replace(camera, outputs=("rgb",)).build(stage)
    lidar = next(c for c in sensors if c.kind == "lidar").build(stage)
    among = episode.timeline()
    alone = traffic_level("static").select(among)

    def shots(timeline: Timeline, stamp_ns: int, weathers: list[str]) -> list[U8]:
        conditions = left.measure_conditions(timeline, stamp_ns, [weather_by_name(name) for name in weathers])
        return [next(s.rgb for s in shot if isinstance(s, Image)) for shot in conditions]

    def sweep(timeline: Timeline, stamp_ns: int, width_px: int, height_px: int) -> U8:
        samples = lidar.measure(timeline, [stamp_ns])
        cloud = next(s for s in samples if isinstance(s, PointCloud) and s.tag is not None)
        return lidar_image(cloud, width_px, height_px)

    first = round(begin_s * 1e9) // STEP_NS
    for step in range(first, first + round(LENGTH_S * 1e9) // STEP_NS, EVERY_STEPS):
        stamp_ns = step * STEP_NS
        panels = [
            labelled_panel(picture, label)
            for label, picture in zip(STATIC, shots(alone, stamp_ns, [*STATIC.values()]), strict=True)
        ]
        panels.append(labelled_panel(shots(among, stamp_ns, ["ClearNoon"])[0], "among traffic"))
        points = [
            labelled_panel(sweep(timeline, stamp_ns, 640, 360), label)
            for timeline, label in ((alone, "LiDAR"), (among, "LiDAR among traffic"))
        ]
        rows = [panels[:2], panels[2:], points]
        yield np.vstack([np.hstack(row) for row in rows])
    stage.close()


def main(drive: Path, begin_s: float, quality: str, out: Path = FILM) -> Path:
    """Film it, as good as 5 MB allow."""
    episode = Episode.load(drive)
    pictures = [Picture.fromarray(frame) for frame in frames(episode, begin_s, quality)]
    size = WIDTH_PX, round(WIDTH_PX * pictures[0].height / pictures[0].width)
    small = [picture.resize(size, Picture.Resampling.LANCZOS) for picture in pictures]
    milliseconds = EVERY_STEPS * STEP_NS // 1_000_000
    for percent in range(85, 20, -5):
        small[0].save(
            out,
            save_all=True,
            append_images=small[1:],
            quality=percent,
            method=6,
            duration=milliseconds,
            loop=0,
        )
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
    parser.add_argument("--begin", type=float, default=BEGIN_S, help="first instant [s]")
    parser.add_argument("--quality", default="medium", help="low, medium or high")
    arguments = parser.parse_args()
    main(arguments.episode, arguments.begin, arguments.quality)
