"""What sensors put out: one frozen dataclass per kind, checked for dtype and shape when made.

Every sample names its `sensor` (the observation key), its `frame_id` and its `stamp_ns`, the time
of measurement since the drive began.
"""

from carlaloc_env.samples.base import Sample
from carlaloc_env.samples.clouds import PointCloud, RadarScan
from carlaloc_env.samples.pictures import (
    EVENT,
    DepthImage,
    Events,
    FlowImage,
    Image,
    NormalImage,
    SemanticImage,
)
from carlaloc_env.samples.states import CanState, GnssFix, Imu, Speed, WheelTicks
from carlaloc_env.samples.truth import ObjectList, Odometry

__all__ = [
    "EVENT",
    "CanState",
    "DepthImage",
    "Events",
    "FlowImage",
    "GnssFix",
    "Image",
    "Imu",
    "NormalImage",
    "ObjectList",
    "Odometry",
    "PointCloud",
    "RadarScan",
    "Sample",
    "SemanticImage",
    "Speed",
    "WheelTicks",
]
