"""How large a dataset becomes, told before any of it is made; roughly, from the rig and the formats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from carlaloc_env.rigs.rig import SensorRig
from recorder.replaying.conditions import Condition
from recorder.replaying.plan import ReplayOptions
from recorder.writers.topics import profile_by_name

_IMAGE_BYTES = {"rgb": 3.0, "depth": 4.0, "semantic": 1.0, "flow": 8.0, "normal": 12.0}
"""Bytes of a pixel in bags [bytes]."""
_SLAM_BYTES = {"rgb": 1.0}
_COMPACT_BYTES = {"rgb": 0.055, "depth": 0.11, "semantic": 0.018}
"""The same in the profiles `compact` and `compact_full`."""
_GREY_PNG_BYTES, _COLOUR_PNG_BYTES = 0.55, 1.7
"""Bytes of a pixel as PNG, noise included [bytes]."""
_EVENTS_BYTES_PER_PIXEL_S, _EVENTS_H5_SHARE = 60.0, 0.3
"""Events of a second of driving for each pixel, as messages [bytes], and what DSEC's files take of that."""
_POINT_BYTES, _KITTI_POINT_BYTES, _COMPACT_POINT_BYTES = 34.0, 20.0, 1.8
_OTHERS_BYTES_PER_S = 400_000.0
"""IMU, truth, objects and so on [bytes/s]."""
_PANELS, _PANEL_BYTES = 2, 640 * 360 * 3
"""Panels of a film that each weather has of its own, about, and the size of one [bytes]."""
_RAW_PIXEL_BYTES, _RAW_POINT_BYTES = 3.2, 29.0
"""A pixel with colour, depth and labels, and a point, as PNG, npz and PLY [bytes]."""
_ZSTD_SHARE, _LZ4_SHARE = 0.5, 0.65
"""What zstd or bzip2, and LZ4, leave of a bag."""


def bytes_per_second(rig: SensorRig, formats: Sequence[str], topics: str) -> float:
    """Size of one sequence for each second of the drive [bytes/s].

    Args:
        rig: The sensors.
        formats: Names of dataset formats.
        topics: Topic profile of bags.
    """
    profile = profile_by_name(topics).name
    bag = _OTHERS_BYTES_PER_S + sum(_bag_bytes(sensor, profile) for sensor in rig.sensors)
    cameras = [sensor for sensor in rig.sensors if sensor.kind == "camera"]
    pixels = sum(_pixels_per_s(camera) for camera in cameras)
    events = sum(_EVENTS_BYTES_PER_PIXEL_S * _pixels(c) for c in cameras if "events" in _outputs(c))
    rays = sum(_rays_per_s(sensor) for sensor in rig.sensors)
    sizes = {
        "rosbag1": bag,
        "rosbag2_sqlite3": bag,
        "euroc": _GREY_PNG_BYTES * pixels + _OTHERS_BYTES_PER_S,
        "kitti": _COLOUR_PNG_BYTES * pixels + _KITTI_POINT_BYTES * rays,
        "dsec": _EVENTS_H5_SHARE * events,
        "raw": _RAW_PIXEL_BYTES * pixels + _RAW_POINT_BYTES * rays + _EVENTS_H5_SHARE * events,
    }
    bags = {"rosbag1_lz4": _LZ4_SHARE, "rosbag1_bz2": _ZSTD_SHARE, "rosbag2": _ZSTD_SHARE}
    for name, share in bags.items():
        sizes[name] = bag if profile.startswith("compact") else share * bag
    return sum(sizes[name] for name in dict.fromkeys(formats))


def spool_bytes_per_second(rig: SensorRig, config: ReplayOptions, conditions: Sequence[Condition]) -> float:
    """Pieces of a traffic level that wait to be assembled, for each second of the drive [bytes/s].

    The larger level counts: the spools of one go when its sequences stand. What all weathers share lies
    there once, but is counted for each, which leaves some room.

    Args:
        rig: The sensors.
        config: Formats, topics and whether there are films, whose panels lie there as pixels.
        conditions: All sequences.
    """
    names = [name.replace("rosbag2", "rosbag1").split("_")[0] for name in config.formats]
    one = sum(bytes_per_second(rig, (name,), config.topics) for name in names)
    cameras, lidars = ([s for s in rig.sensors if s.kind == kind] for kind in ("camera", "lidar"))
    if config.preview and (cameras or lidars):
        panels = _PANELS if cameras else 1
        one += panels * _PANEL_BYTES * float((cameras or lidars)[0].rate_hz)
    levels = dict.fromkeys(condition.traffic for condition in conditions)
    return one * max(sum(condition.traffic == level for condition in conditions) for level in levels)


def _bag_bytes(sensor: Any, profile: str) -> float:
    if sensor.kind == "camera":
        known = {"standard": _IMAGE_BYTES, "full": _IMAGE_BYTES, "compact_full": _COMPACT_BYTES}.get(
            profile, _SLAM_BYTES
        )
        if profile == "compact":
            known = {"rgb": _COMPACT_BYTES["rgb"]}
        size = sum(known.get(output, 0.0) for output in _outputs(sensor)) * _pixels_per_s(sensor)
        if profile == "full" and "events" in _outputs(sensor):
            size += _EVENTS_BYTES_PER_PIXEL_S * _pixels(sensor)
        return size
    return (_COMPACT_POINT_BYTES if profile.startswith("compact") else _POINT_BYTES) * _rays_per_s(sensor)


def _outputs(camera: Any) -> tuple[str, ...]:
    outputs: tuple[str, ...] = camera.outputs
    return outputs


def _pixels(camera: Any) -> float:
    return float(camera.pinhole.width_px * camera.pinhole.height_px)


def _pixels_per_s(camera: Any) -> float:
    return _pixels(camera) * float(camera.rate_hz)


def _rays_per_s(sensor: Any) -> float:
    return float(sensor.rays * sensor.rate_hz) if sensor.kind == "lidar" else 0.0
