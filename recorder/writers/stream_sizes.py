"""Sizes of a rig's streams in messages and files, by the sky of a weather and the speed of the car."""

from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

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
from recorder.writers.topic_profiles import profile_for
from recorder.writers.topics import TopicProfile

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
    "points_of_the_town": 22.0, "points_us": 22.0, "points_ouster": 53.0, "points_ouster_2021": 48.0,
    "points_hesai": 26.0, "points_robosense": 29.0, "points_aeva": 48.0, "points_livox": 29.0, "livox": 21.0,
    "livox_1": 21.0, "livox_2": 22.0, "video": 0.05, "cloud_draco": 1.75, "depth_png": 0.11, "tags_png": 0.02,
}  # fmt: skip
"""Size of a pixel, a point or a byte of events in a message."""
BAGS = ("rosbag1", "rosbag1_lz4", "rosbag1_bz2", "rosbag2", "rosbag2_sqlite3")
SHARES: dict[str, Size] = {
    "image_rgb8": (0.51, 0.42, 0.29, 0.79), "image_mono8": (0.55, 0.46, 0.3, 0.75), "image_32fc1": 0.67,
    "image_tags": 0.015, "image_instances": 0.006, "event_array": (0.39, 0.41, 0.48, 0.4), "points": 0.615,
    "points_labelled": 0.52, "points_of_the_town": 0.615, "other": 0.3,
}  # fmt: skip
"""Size of a message packed by zstd as a share of it; measured in five towns, as all figures here."""
PACKING = {"rosbag2": (1.0, 1.0), "rosbag1_lz4": (1.55, 1.35), "rosbag1_bz2": (0.77, 1.1)}
"""Size of what a bag packs over that of zstd: of pictures, labels and events; of points and depth."""
FIRED = 1.47
"""How much more a packed point takes where a LiDAR's beams fire in turn: no two have the same time."""
_COLOUR = (1.1, 0.97, 0.73, 1.79)
FILE_BYTES: dict[str, dict[type[Sample], Size]] = {
    "euroc": {Image: (0.37, 0.33, 0.241, 0.537)},
    "kitti": {Image: _COLOUR, PointCloud: 20.0},
    "dsec": {Events: 0.4, DepthImage: 0.2},
    "nuscenes": {Image: (0.268, 0.22, 0.111, 0.388), PointCloud: 20.0},
    "opv2v": {Image: (0.55, 0.49, 0.37, 0.9), PointCloud: 8.0},
    "colmap": {Image: _COLOUR, DepthImage: 0.28, SemanticImage: 0.01},
    "doppler_icp": {PointCloud: 16.0},
    "rinex": {},
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


class Stretch(NamedTuple):
    """What of a drive is replayed."""

    whole_s: float
    """Length of all sensors' stretch [s]."""
    images_s: float
    """Length of the pictures [s]."""
    past_s: float = 0.0
    """Length of the images that cameras must see before [s]."""
    speed_mps: float = 5.0
    """Mean speed during the pictures [m/s]."""
    actors: float = 150.0
    """Number of the traffic's actors, the mean of all levels."""


@dataclass(frozen=True, slots=True)
class StreamSize:
    """Size of a stream in a format."""

    format_name: str
    """Name of the format."""
    kind: type[Sample] | None
    """Kind of its samples; None: all small ones together."""
    written: float
    """Size in the sequences [bytes]."""
    spooled: float
    """Size in the spools [bytes]."""
    _: KW_ONLY
    is_sure: bool
    """Whether a bag holds it as it is."""


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


def event_bytes(sky: int, speed_mps: float) -> float:
    """Size of a pixel's events in a picture [bytes]."""
    return EVENT_BYTES[sky] + EVENT_BYTES_PER_MPS[sky] * speed_mps


def pixels_hz(config: CameraConfig) -> float:
    """Pixels that a camera takes a second."""
    return config.pinhole.width_px * config.pinhole.height_px * config.rate_hz


def stream_sizes(
    rig: SensorRig, formats: Sequence[str], topics: str, skies: Sequence[int], stretch: Stretch
) -> Iterator[StreamSize]:
    """Sizes of all streams of a stretch under a traffic level, in every format and under every sky.

    Args:
        rig: The sensors.
        formats: Names of the formats.
        topics: Name of the profile of bags.
        skies: That of each weather.
        stretch: What is replayed.
    """
    streams: list[tuple[type[Sample], str, float, float]] = []
    for config in rig.sensors:
        if isinstance(config, CameraConfig):
            count = stretch.images_s * pixels_hz(config)
            streams += [(CAMERA_SAMPLES[o], f"{o}_{config.name}", count, 1.0) for o in config.outputs]
        if isinstance(config, LidarConfig):
            count, fired = (
                stretch.whole_s * RETURNS * config.rays * config.rate_hz,
                FIRED if config.firing_ns else 1.0,
            )
            ends = ["" if output == "cloud" else "_semantic" for output in config.outputs]
            streams += [(PointCloud, f"{config.name}{end}", count, fired) for end in ends]
    names = [stream for _, stream, _, _ in streams]
    profiles = [profile_for(name, rig.sensors) for name in (topics, "paper_seg")[: 1 + (topics == "paper")]]
    radars_hz = sum(sensor.rate_hz for sensor in rig.of_kind("radar"))
    for name in formats:
        other = stretch.whole_s * _other_bytes_s(profiles[0], name, radars_hz, stretch.actors)
        yield StreamSize(name, None, other * len(skies), other, is_sure=False)
        for kind, stream, count, fired in streams:
            # Of a LiDAR's two clouds, these hold the one with labels.
            if name in ("kitti", "nuscenes", "opv2v", "doppler_icp") and f"{stream}_semantic" in names:
                continue
            for number, sky in enumerate(skies):
                whole, packed = _element_bytes(profiles, name, kind, stream, names, sky)
                packed = min(whole, fired * packed) if packed < whole else packed
                some = count * (event_bytes(sky, stretch.speed_mps) if kind is Events else 1.0)
                spooled = some * whole * (number == 0 or kind in (Image, Events))
                is_sure = name in BAGS and packed == whole and kind is not Events
                yield StreamSize(name, kind, some * packed, spooled, is_sure=is_sure)


def _element_bytes(
    profiles: Sequence[TopicProfile],
    format_name: str,
    kind: type[Sample],
    stream: str,
    streams: Sequence[str],
    sky: int,
) -> tuple[float, float]:
    """Size of a pixel, a point or a byte of events in a format, before and after a bag packs it [bytes]."""
    if format_name not in BAGS:
        size = by_sky(FILE_BYTES[format_name].get(kind, 0.0), sky)
        return size, size
    whole = packed = 0.0
    for profile in profiles:
        for route in profile.routes(kind, stream, streams):
            size = by_sky(MESSAGE_BYTES.get(route.message, 0.0), sky)
            whole += size
            packed += size * _share(format_name, route.message, sky)
    return whole, packed


def _share(format_name: str, message: str, sky: int) -> float:
    """Size of a message in a bag as a share of it."""
    if format_name not in PACKING:
        return 1.0
    factor = PACKING[format_name][message.startswith(("points", "image_32"))]
    return min(1.0, by_sky(SHARES[message], sky) * factor) if message in SHARES else 1.0


def _other_bytes_s(profile: TopicProfile, format_name: str, radars_hz: float, actors: float) -> float:
    """Size of a second of all that is neither picture nor point in a format [bytes]."""
    if format_name not in BAGS:
        own = radars_hz * FILE_RADAR_BYTES.get(format_name, 0.0)
        return own + FILE_OTHER_BYTES_S + (FILE_ACTOR_BYTES_S * actors if format_name == "raw" else 0.0)
    sizes = {"radar_points": RADAR_BYTES[0] * radars_hz, "radar_scan": RADAR_BYTES[1] * radars_hz}
    sizes |= {"objects": ACTOR_BYTES_S[0] * actors, "object_table": ACTOR_BYTES_S[1] * actors}
    size = SMALL_BYTES_S + sum(sizes.get(rule.message, 0.0) for rule in profile.rules)
    return size * _share(format_name, "other", 0)
