"""Pictures of an instant of a drive: the left camera in several weathers, and the LiDAR from above."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.rigs.presets import flu_rig
from carlaloc_env.samples import DepthImage, Image, PointCloud, SemanticImage
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.presets import weather_by_name
from recorder.report.mosaic import (
    PANEL_HEIGHT_PX,
    PANEL_WIDTH_PX,
    depth_image,
    labelled_panel,
    lidar_image,
    semantic_image,
)


def pictures_of_instant(
    stage: SensorStage, timeline: Timeline, at_s: float, weathers: Sequence[str]
) -> dict[str, U8]:
    """Pictures of the left camera and of the LiDAR of the rig `flu`.

    Args:
        stage: Town and quality of the pictures.
        timeline: The drive.
        at_s: The instant [s], rounded to a step; after the drive its last one.
        weathers: Names of weathers.

    Returns:
        sRGB pictures by label: one for each weather, then ``depth``, ``semantics``, ``LiDAR from above``.
    """
    at_ns = min(round(at_s * 1e9), timeline.end_ns - STEP_NS) // STEP_NS * STEP_NS
    sensors = flu_rig().sensors
    camera = next(c for c in sensors if isinstance(c, CameraConfig) and c.name == "left")
    # Events, which are not shown, would follow the whole drive.
    left = replace(camera, outputs=("rgb", "depth", "semantic")).build(stage)
    lidar = next(c for c in sensors if c.kind == "lidar").build(stage)
    shots = left.measure_conditions(timeline, at_ns, [weather_by_name(name) for name in weathers])
    scans = [s for s in lidar.measure(timeline, [at_ns]) if isinstance(s, PointCloud) and s.tag is not None]
    pictures = {
        name: s.rgb for name, shot in zip(weathers, shots, strict=True) for s in shot if isinstance(s, Image)
    }
    pictures["depth"] = next(depth_image(s) for s in shots[0] if isinstance(s, DepthImage))
    pictures["semantics"] = next(semantic_image(s) for s in shots[0] if isinstance(s, SemanticImage))
    pictures["LiDAR from above"] = lidar_image(scans[0], PANEL_WIDTH_PX, PANEL_HEIGHT_PX)
    return pictures


def rows_of_three(pictures: Mapping[str, U8]) -> U8:
    """One sRGB image of labelled pictures, three in a row; their number is a multiple of three."""
    panels = [labelled_panel(picture, label) for label, picture in pictures.items()]
    return np.vstack([np.hstack(panels[k : k + 3]) for k in range(0, len(panels), 3)])
