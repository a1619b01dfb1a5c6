"""A picture of a town from above, with its name and a scale."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from carlaloc_env.errors import WriterError
from carlaloc_env.geometry import from_rotation
from carlaloc_env.pinhole import Pinhole
from carlaloc_env.scene import Instances
from carlaloc_env.stage import SensorStage
from carlaloc_env.town.town import Town
from carlaloc_env.weather import weather_by_name

_FOV_DEG = 60.0


def draw_town(town: Town, out: Path, *, width_px: int = 1600, height_px: int = 1200) -> Path:
    """Draw a town obliquely from the south, in clear weather.

    Args:
        town: The town.
        out: PNG to write.
        width_px: Width of the picture [px].
        height_px: Height of the picture [px].

    Raises:
        RenderError: OpenGL is missing.
        WriterError: the picture exists or cannot be written.
    """
    if out.exists():
        raise WriterError(f"{out} exists; choose another --out or delete it first")
    driving = [lane.index for lane in town.network.lanes if lane.type == "driving"]
    tables = town.network.tables
    roads = tables.position_m[np.isin(np.repeat(np.arange(len(tables.count)), tables.count), driving)]
    low, high = roads.min(axis=0), roads.max(axis=0)
    centre, reach = 0.5 * (low + high), float(np.max((high - low)[:2]))
    distance = 0.56 * reach / np.tan(np.radians(_FOV_DEG / 2))
    down = np.radians(50.0)
    forward = np.array([0.0, np.cos(down), -np.sin(down)])
    right = np.array([1.0, 0.0, 0.0])
    pose = from_rotation(
        np.stack([right, np.cross(forward, right), forward], axis=1), centre - distance * forward
    )
    stage = SensorStage(town, seed=0, weather=weather_by_name("ClearNoon"), quality="high")
    try:
        renderer = stage.renderer()
        picture = renderer.draw(Pinhole.from_fov(width_px, height_px, _FOV_DEG), pose, Instances())
        rgb = renderer.shade(picture, stage.weather, stamp_ns=0, seed=0)
    finally:
        stage.close()
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(f".part-{out.name}")
    if out.suffix.lower() != ".png" or not cv2.imwrite(str(part), cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)):
        raise WriterError(f"cannot write {out}; give a name that ends in .png in a folder you may write to")
    return part.replace(out)
