"""Sizes of a rig's streams in messages and files, by the sky of a weather and the speed of the car."""

from collections.abc import Collection, Iterator

from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import (
    DepthImage,
    Events,
    FlowImage,
    Image,
    NormalImage,
    PointCloud,
    Sample,
    SemanticImage,
)
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.weather.schedule import Weather
from recorder.writers.topic_profiles import profile_by_name

Size = float | tuple[float, float, float, float]
"""Size of a pixel or point, or share of it; four where they differ by sky: bright, dim, fog, night."""
FOG_PER_M = 0.01
"""Extinction from which on a weather counts as fog, a visibility of 300 m [1/m]."""
DIM_DEG, DIM_MMPH = 30.0, 10.0
"""Height of the sun below which a day is dim [deg], and rain from which on [mm/h]."""
RETURNS = 0.9
"""Share of a LiDAR's rays that give a point."""
CAMERA_SAMPLES: dict[str, type[Sample]] = {
    "rgb": Image, "depth": DepthImage, "semantic": SemanticImage, "events": Events, "flow": FlowImage,
    "normal": NormalImage,
}  # fmt: skip
"""Samples of a camera's outputs."""
EVENT_BYTES, EVENT_BYTES_PER_MPS = (0.6, 0.4, 0.14, 0.6), (1.65, 0.9, 0.17, 1.23)
"""Size of a pixel's events in a picture: of a standing car, and what its speed adds [bytes, bytes s/m]."""
MESSAGE_BYTES: dict[str, Size] = {
    "image_rgb8": 3.0, "image_mono8": 1.0, "image_32fc1": 4.0, "image_tags": 1.0, "image_32fc2": 8.0,
    "image_32fc3": 12.0, "image_instances": 4.0, "event_array": 1.0, "points": 22.0, "points_labelled": 27.0,
    "points_of_the_town": 22.0, "video": 0.05, "cloud_draco": 1.75, "depth_png": 0.11, "tags_png": 0.02,
}  # fmt: skip
"""Size of a pixel, a point or a byte of events in a message."""
PACKED = ("video", "cloud_draco", "depth_png", "tags_png")
"""Messages that no bag makes smaller."""
BAG_SHARES: dict[str, dict[str, Size]] = {
    "rosbag1": {},
    "rosbag1_lz4": {
        "image_rgb8": (0.79, 0.68, 0.51, 1.0), "image_mono8": (0.77, 0.68, 0.51, 1.0), "image_32fc1": 0.93,
        "image_tags": 0.04, "image_instances": 0.015, "event_array": (0.6, 0.62, 0.7, 0.6), "points": 0.8,
        "points_labelled": 0.7, "points_of_the_town": 0.8, "other": 0.4,
    },
    "rosbag1_bz2": {
        "image_rgb8": (0.38, 0.31, 0.2, 0.67), "image_mono8": (0.43, 0.36, 0.23, 0.59), "image_32fc1": 0.75,
        "image_tags": 0.012, "image_instances": 0.003, "event_array": (0.35, 0.37, 0.43, 0.36),
        "points": 0.67, "points_labelled": 0.6, "points_of_the_town": 0.67, "other": 0.3,
    },
    "rosbag2": {
        "image_rgb8": (0.51, 0.42, 0.29, 0.79), "image_mono8": (0.55, 0.46, 0.3, 0.75), "image_32fc1": 0.67,
        "image_tags": 0.015, "image_instances": 0.006, "event_array": (0.39, 0.41, 0.48, 0.4),
        "points": 0.615, "points_labelled": 0.52, "points_of_the_town": 0.615, "other": 0.3,
    },
    "rosbag2_sqlite3": {},
}  # fmt: skip
"""Size of a message in a bag as a share of it; measured in five towns, as all figures here."""
FIRED = 1.47
"""How much more a packed point takes where a LiDAR's beams fire in turn: no two have the same time."""
_COLOUR = (1.1, 0.97, 0.73, 1.79)
FILE_BYTES: dict[str, dict[type[Sample], Size]] = {
    "euroc": {Image: (0.37, 0.33, 0.241, 0.537)},
    "kitti": {Image: _COLOUR, PointCloud: 20.0},
    "dsec": {Events: 0.4, DepthImage: 0.2},
    "nuscenes": {Image: (0.268, 0.22, 0.111, 0.388), PointCloud: 20.0},
    "colmap": {Image: _COLOUR, DepthImage: 0.28, SemanticImage: 0.01},
    "raw": {
        Image: _COLOUR, DepthImage: 2.5, SemanticImage: 0.045, FlowImage: 4.0, NormalImage: 6.0, Events: 0.37,
        PointCloud: 24.5,
    },
}  # fmt: skip
"""Size of a pixel, a point or a byte of events in the files of a format; flow and normals assumed."""
SMALL_BYTES_S, RADAR_BYTES, ACTOR_BYTES_S = 2.5e5, (15e3, 7e3), (4360.0, 1390.0)
"""In bags: a second of IMU, GNSS and truth; a radar's scan as points, as scan; a second of an actor as an
object, as a row of the table [bytes]."""
FILE_RADAR_BYTES = {"raw": 10e3, "nuscenes": 16e3}
FILE_OTHER_BYTES_S, FILE_ACTOR_BYTES_S = 1e5, 1200.0
"""In files of other formats: a radar's scan, a second of everything small, a second of an actor [bytes]."""


def sky_of(weather: Weather) -> int:
    """Place of a weather in a `Size`; of a schedule, that of its begin."""
    now = weather.at(0)
    if now.is_night:
        return 3
    if now.fog_extinction_per_m + now.uniform_extinction_per_m > FOG_PER_M:
        return 2
    return int(now.sun_altitude_angle < DIM_DEG or now.rain_mmph > DIM_MMPH)


def by_sky(size: Size, sky: int) -> float:
    """The size under a sky."""
    return size[sky] if isinstance(size, tuple) else size


def pixels_hz(config: CameraConfig) -> float:
    """Pixels that a camera takes a second."""
    return config.pinhole.width_px * config.pinhole.height_px * config.rate_hz


def large_streams(rig: SensorRig) -> Iterator[tuple[type[Sample], str, float, bool]]:
    """Kind, name, elements a second, and whether beams fire in turn, of each stream of cameras and LiDARs."""
    for config in rig.sensors:
        if isinstance(config, CameraConfig):
            for output in config.outputs:
                yield CAMERA_SAMPLES[output], f"{output}_{config.name}", pixels_hz(config), False
        if isinstance(config, LidarConfig):
            for output in config.outputs:
                name = config.name if output == "cloud" else f"{config.name}_semantic"
                yield PointCloud, name, RETURNS * config.rays * config.rate_hz, bool(config.firing_ns)


def element_bytes(
    topics: str, format_name: str, kind: type[Sample], stream: str, streams: Collection[str], sky: int
) -> tuple[float, float]:
    """Size of a pixel, a point or a byte of events in a format, before and after a bag packs it [bytes].

    Args:
        topics: Name of the profile of bags.
        format_name: Name of the format.
        kind: Kind of the stream's samples.
        stream: Name of the stream.
        streams: All streams of the rig.
        sky: That of `sky_of`.
    """
    if format_name not in BAG_SHARES:
        # Of a LiDAR's two clouds, these hold the one with labels.
        is_left_out = format_name in ("kitti", "nuscenes") and f"{stream}_semantic" in streams
        size = 0.0 if is_left_out else by_sky(FILE_BYTES[format_name].get(kind, 0.0), sky)
        return size, size
    shares = BAG_SHARES[format_name]
    whole = packed = 0.0
    for profile in (topics, *(["paper_seg"] if topics == "paper" else [])):
        for route in profile_by_name(profile).routes(kind, stream, streams):
            size = by_sky(MESSAGE_BYTES.get(route.message, 0.0), sky)
            whole += size
            packed += size * by_sky(shares.get(route.message, 1.0), sky)
    return whole, packed


def other_bytes_s(topics: str, format_name: str, radars_hz: float, actors: float) -> float:
    """Size of a second of all that is neither picture nor point in a format [bytes].

    Args:
        topics: Name of the profile of bags.
        format_name: Name of the format.
        radars_hz: Scans of all radars a second.
        actors: Number of the traffic's actors.
    """
    if format_name not in BAG_SHARES:
        own = radars_hz * FILE_RADAR_BYTES.get(format_name, 0.0)
        return own + FILE_OTHER_BYTES_S + (FILE_ACTOR_BYTES_S * actors if format_name == "raw" else 0.0)
    rules = profile_by_name(topics).rules
    sizes = {"radar_points": RADAR_BYTES[0] * radars_hz, "radar_scan": RADAR_BYTES[1] * radars_hz}
    sizes |= {"objects": ACTOR_BYTES_S[0] * actors, "object_table": ACTOR_BYTES_S[1] * actors}
    size = SMALL_BYTES_S + sum(sizes.get(rule.message, 0.0) for rule in rules)
    return size * by_sky(BAG_SHARES[format_name].get("other", 1.0), 0)
