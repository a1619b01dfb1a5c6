"""Draw docs/gallery/, one sheet per town, and maps/*/preview.png.

`python docs/scripts/make_gallery.py [TOWN ...]`.

Each shows the town from above with its lanes, route, spawn points and lights, and four street views.
With `--weathers` it draws docs/gallery/weathers.jpg instead: every town in the paper's three weathers. With
`--winter` it draws docs/gallery/winter.jpg: three towns in snow.
"""

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.map.sources import known_towns
from carlaloc_env.render.geometry.gbuffer import GBuffer
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.snapshot import Snapshot
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.standing_traffic import standing_traffic
from carlaloc_env.weather.presets import weather_by_name
from recorder.report.town_preview import street_poses, town_sheet

GALLERY = Path(__file__).parents[1] / "gallery"
LARGEST_BYTES = 490_000
LARGEST_PREVIEW_BYTES = 690_000
WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
WINTER = ("SnowyNoon", "WinterNoon", "SnowyNight")
WINTER_TOWNS = ("Town03", "Town07", "Town10")
PANEL_PX = (480, 270)
VEHICLES = 260
CLEAR_M = 9.0
"""No car stands nearer to the camera than this [m]."""
LEAST_SKY = 0.12
"""Share of a picture that is sky, so that none shows the inside of an underpass."""


def draw(name: str, folder: Path = GALLERY, quality: str = "medium") -> Path:
    """Write a town's sheet as a JPEG, as good as `LARGEST_BYTES` allow.

    Args:
        name: Town.
        folder: Where it goes.
        quality: Render quality.
    """
    sheet = cv2.cvtColor(town_sheet(load_town(name), quality=quality), cv2.COLOR_RGB2BGR)
    return _write(sheet, folder / f"{name}.jpg")


def draw_weathers(names: list[str], out: Path, quality: str, weathers: tuple[str, ...] = WEATHERS) -> Path:
    """Write one street of every town in some weathers, a row per town."""
    rows = [np.hstack(street_in_weathers(name, quality, weathers)) for name in names]
    return _write(cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR), out)


def street_in_weathers(name: str, quality: str, weathers: tuple[str, ...]) -> list[NDArray[np.uint8]]:
    """One street with standing traffic under each of some weathers, sRGB."""
    town = load_town(name)
    stage = SensorStage(town, seed=0, weather=weather_by_name(weathers[0]), quality=quality)
    first, *others = street_poses(town, 4)
    for T in (*others, first):
        gbuffer = _busy_street(stage, town, T)
        if np.mean(gbuffer.depth_m() == 0.0) > LEAST_SKY:
            break
    pictures = []
    for weather in weathers:
        rgb = stage.renderer().shade(gbuffer, weather_by_name(weather), stamp_ns=10**9)
        small = np.asarray(cv2.resize(rgb, PANEL_PX, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        words, font = f"{name} {weather}", cv2.FONT_HERSHEY_SIMPLEX
        (width, _), _ = cv2.getTextSize(words, font, 0.5, 1)
        small[2:28, 4 : 12 + width] = 0
        cv2.putText(small, words, (8, 20), font, 0.5, (255, 255, 255), 1)
        pictures.append(small)
    stage.close()
    return pictures


def _busy_street(stage: SensorStage, town: Town, T_world_camera: NDArray[np.float64]) -> GBuffer:
    """Picture of a car's camera among standing traffic."""
    catalog, frame = standing_traffic(town.network, VEHICLES)
    far = np.flatnonzero(np.hypot(*(frame.position_m[:, :2] - T_world_camera[:2, 3]).T) > CLEAR_M)
    green = np.full(int(town.outline.lenses.signal.max(initial=-1)) + 1, 3, np.uint8)
    mount = next(c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig)).mount
    snapshot = Snapshot(
        stamp_ns=0,
        T_world_base=T_world_camera @ np.linalg.inv(mount.T_base_sensor),
        catalog=catalog.take(far),
        actors=frame.take(far),
        signals=green,
    )
    seen = instances_at(stage.library, town.outline.lenses, snapshot)
    return stage.renderer().draw(Pinhole(), T_world_camera, seen)


def _write(sheet: NDArray[Any], out: Path) -> Path:
    """Write a JPEG, as good as `LARGEST_BYTES` allow."""
    out.parent.mkdir(parents=True, exist_ok=True)
    for percent in range(92, 20, -3):
        _, data = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, percent])
        if len(data) <= LARGEST_BYTES:
            break
    out.write_bytes(data.tobytes())
    return out


def shrink(sheet: Path, out: Path) -> Path:
    """Write a sheet as a PNG, as large as `LARGEST_PREVIEW_BYTES` allow."""
    whole = np.asarray(cv2.imread(str(sheet)))
    for width in range(1200, 400, -80):
        small = cv2.resize(
            whole, (width, width * whole.shape[0] // whole.shape[1]), interpolation=cv2.INTER_AREA
        )
        _, data = cv2.imencode(".png", small, [cv2.IMWRITE_PNG_COMPRESSION, 9])
        if len(data) <= LARGEST_PREVIEW_BYTES:
            break
    out.write_bytes(data.tobytes())
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("towns", nargs="*", help="all when left out")
    parser.add_argument("--out", type=Path, default=GALLERY, help="folder of the pictures")
    parser.add_argument("--quality", default="medium", help="low, medium or high")
    parser.add_argument("--weathers", action="store_true", help="every town in three weathers instead")
    parser.add_argument("--winter", action="store_true", help="three towns in snow instead")
    arguments = parser.parse_args()
    if arguments.weathers:
        names = arguments.towns or list(known_towns())
        draw_weathers(names, arguments.out / "weathers.jpg", arguments.quality)
        raise SystemExit
    if arguments.winter:
        names = arguments.towns or list(WINTER_TOWNS)
        draw_weathers(names, arguments.out / "winter.jpg", arguments.quality, WINTER)
        raise SystemExit
    for town in arguments.towns or known_towns():
        picture = draw(town, arguments.out, arguments.quality)
        if arguments.out == GALLERY:
            shrink(picture, known_towns()[town].with_name("preview.png"))
