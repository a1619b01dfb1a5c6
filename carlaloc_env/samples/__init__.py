"""Samples of sensors: one frozen dataclass per kind, checked for dtype and shape when made.

Every sample names its `sensor` (the observation key), its `frame_id` and its `stamp_ns`, the time
of measurement since the drive began.
"""

from carlaloc_env.samples.base import Sample, SampleList
from carlaloc_env.samples.gnss_signals import GnssRaw
from carlaloc_env.samples.ground_truth import ObjectList, Odometry
from carlaloc_env.samples.images import (
    EVENT,
    DepthImage,
    Events,
    FlowImage,
    Image,
    NormalImage,
    PointCloud,
    RadarScan,
    SemanticImage,
)
from carlaloc_env.samples.vehicle_states import (
    GnssFix,
    Imu,
    Speed,
    WheelTicks,
)

__all__ = [
    "EVENT",
    "DepthImage",
    "Events",
    "FlowImage",
    "GnssFix",
    "GnssRaw",
    "Image",
    "Imu",
    "NormalImage",
    "ObjectList",
    "Odometry",
    "PointCloud",
    "RadarScan",
    "Sample",
    "SampleList",
    "SemanticImage",
    "Speed",
    "WheelTicks",
]
