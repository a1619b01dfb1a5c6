"""Finds the topic of a LiDAR by its first clouds: maps, boxes, radars and cameras have clouds, too."""

import logging
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from carlaloc_env.core.errors import EvaluationError, unknown_name
from recorder.bags.reader import open_bag, refused_in_one_line
from recorder.dataset.clouds import CLOUD, Cloud, read_cloud

_LOG = logging.getLogger(__name__)
READ = "sensor_msgs/PointCloud2 and livox_ros_driver2/CustomMsg, foxglove_msgs/CompressedPointCloud by Draco"
"""Types of messages that are read, for errors."""
DEFAULT_TOPICS = ("/lidar/points", "/lidar/draco")
"""Topics of the clouds of our bags."""
_SEEN = 12
"""Number of clouds by which a topic is judged."""
_WORLD = re.compile(r"(?:.*[/_])?(?:map|odom|world|camera_init|earth|global|utm|enu)", re.IGNORECASE)
"""Names of frames that do not move with a sensor."""
_OTHERS = {
    "boxes of objects": {"length", "width", "heading", "yaw", "yaw_rate", "size_x"},
    "detections of a radar": {"rcs", "doppler", "range_rate", "dyn_prop", "vx_comp", "v_r"},
    "costs": {"cost", "costs", "path_cost", "occ_cost", "total_cost", "occupancy"},
}
"""Other things than a LiDAR's points, and fields that show them."""
_OF_RADARS = {"velocity", "radial_velocity", "doppler_velocity", "radial_speed", "vx", "snr", "power"}
"""Fields of radars, and of some LiDARs, which have many more points."""
_COLOURS = {"rgb", "rgba"}
_RADAR_POINTS, _FEW_POINTS = 2000, 100
"""Most points of a radar's cloud, and fewest of a LiDAR's."""
_FLAT_M, _SMALL_M, _FAR_M, _CELL_M = 0.05, 1.0, 1000.0, 0.02
"""Least height and extent of a LiDAR's clouds, greatest distance, and least cell of a grid [m]."""
_SLOW_S = 1.5
"""Longest time between sweeps [s]."""


def cloud_connections(
    bag: Path, reader: AnyReader, wanted: str | None, *, is_ours: bool = False
) -> tuple[list[Connection], str]:
    """Connections of the topic whose clouds are read, and the frame of those that count (empty: any).

    Args:
        bag: The bag as the user named it.
        reader: It, open.
        wanted: Topic, or ``topic:frame`` where sensors share it; None: the one that looks like a LiDAR's.
        is_ours: Whether the topic is known to be a LiDAR's.

    Raises:
        EvaluationError: there is none, or there are several that may be meant.
    """
    topics: dict[str, list[Connection]] = {}
    for connection in reader.connections:
        if CLOUD.fullmatch(connection.msgtype):
            topics.setdefault(connection.topic, []).append(connection)
    if wanted is not None:
        topic, _, frame = wanted.partition(":")
        if topic not in topics:
            raise EvaluationError(without_clouds(bag, reader.connections, topic, sorted(topics)))
        if not is_ours and (doubt := doubt_of(bag, reader, topics[topic], frame)):
            _LOG.warning("%s: %s is read as asked for, but %s", bag, topic, doubt)
        return topics[topic], frame
    topics = {topic: chosen for topic, chosen in sorted(topics.items()) if any(c.msgcount for c in chosen)}
    doubts: dict[str, str] = {}
    for topic in sorted(topics, key=lambda topic: topic not in DEFAULT_TOPICS):
        doubts[topic] = doubt_of(bag, reader, topics[topic], "")
        if topic in DEFAULT_TOPICS and not doubts[topic]:
            return topics[topic], ""
    fitting = [topic for topic in topics if not doubts[topic]]
    others = "; ".join(f"{topic}: {doubts[topic]}" for topic in topics if doubts[topic])
    if not topics:
        raise EvaluationError(without_clouds(bag, reader.connections, None, []))
    if not fitting:
        raise EvaluationError(f"{bag}: no topic is surely a LiDAR's; --topic takes one even so ({others})")
    if len(fitting) > 1:
        names = ", ".join(fitting)
        raise EvaluationError(f"{bag} has several topics with clouds; choose by --topic: {names}")
    if others:
        _LOG.warning("%s: %s is read, --topic names another (%s)", bag, fitting[0], others)
    return topics[fitting[0]], ""


def lidar_topic(bag: Path) -> str:
    """The topic whose clouds are read of a bag where none is asked for.

    Raises:
        EvaluationError: there is none, or there are several that may be meant.
    """
    with open_bag(bag) as reader:
        return cloud_connections(bag, reader, None)[0][0].topic


def without_clouds(bag: Path, connections: Sequence[Connection], topic: str | None, topics: list[str]) -> str:
    """Why a bag has no clouds to be read on a topic, or (None) none at all."""
    others = {c.topic: c.msgtype for c in connections if topic in (None, c.topic)}
    if topic is not None and not others:
        return f"{bag}: {unknown_name('topic with point clouds', topic, topics)}"
    listed = ", ".join(f"{name} is {kind}" for name, kind in sorted(others.items(), key=_unlike_a_cloud))
    return f"{bag}: no point clouds that are read here ({READ}); {listed or 'it is empty'}"


def _unlike_a_cloud(item: tuple[str, str]) -> tuple[bool, str]:
    return not re.search("scan|packet|cloud|lidar|laser", item[1], re.IGNORECASE), item[0]


def doubt_of(bag: Path, reader: AnyReader, connections: list[Connection], frame: str) -> str:
    """Why a topic is hardly one LiDAR's, by its first clouds; empty: it looks like one's."""
    clouds: list[Cloud] = []
    try:
        with refused_in_one_line(bag):
            for connection, _, raw in islice(reader.messages(connections=connections), _SEEN):
                cloud = read_cloud(reader, connection, raw)
                frame = frame or cloud.frame_id
                if frame == cloud.frame_id and len(cloud.points_xyz_m):
                    clouds.append(cloud)
    except EvaluationError as error:
        return str(error)
    return next(_doubts(clouds), "") if clouds else ""


def of_one_frame(clouds: Iterator[tuple[int, Cloud]], where: str, frame: str) -> Iterator[tuple[int, Cloud]]:
    """Clouds of a frame, each with its time of recording; empty: there must be one alone.

    Raises:
        EvaluationError: there are clouds of two frames, and none is asked for.
    """
    first = frame
    for at_ns, cloud in clouds:
        first = first or cloud.frame_id
        if cloud.frame_id == first:
            yield at_ns, cloud
        elif not frame:
            names = " or ".join(f"{where.rpartition(' ')[2]}:{name}" for name in (first, cloud.frame_id))
            raise EvaluationError(f"{where} has clouds of two sensors; choose by --topic {names}")


def _doubts(clouds: Sequence[Cloud]) -> Iterator[str]:
    """Reasons why clouds of one frame are hardly the sweeps of a LiDAR."""
    fields = {name.lower() for name in clouds[0].fields}
    count = median(len(cloud.points_xyz_m) for cloud in clouds)
    for kind, names in _OTHERS.items():
        if names_seen := ", ".join(sorted(fields & names)):
            yield f"it holds {kind} ({names_seen})"
    if count < _RADAR_POINTS and (names_seen := ", ".join(sorted(fields & _OF_RADARS))):
        yield f"it holds detections of a radar ({names_seen}, {count:.0f} points)"
    if fields & _COLOURS and not (clouds[0].times or clouds[0].ring is not None):
        yield "it holds a camera's coloured points"
    if count < _FEW_POINTS:
        yield f"its clouds have {count:.0f} points"
    yield from _odd_extents(np.concatenate([thinned(cloud.points_xyz_m) for cloud in clouds]))
    if _WORLD.fullmatch(clouds[0].frame_id):
        yield f"its frame '{clouds[0].frame_id}' moves with no sensor: a map, or clouds registered already"
    times_s = np.unique([cloud.stamp_ns for cloud in clouds]) * 1e-9
    if len(times_s) > 1 and (step_s := float(np.median(np.diff(times_s)))) > _SLOW_S:
        yield f"it has a cloud every {step_s:.1f} s"
    if 1 < len(times_s) <= 0.75 * len(clouds) or _take_turns(clouds):
        yield "two sensors of one frame share it: record a topic for each"


def thinned(points_xyz_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most 4000 points of a cloud, at steps that no number of rings divides."""
    count = len(points_xyz_m)
    rows = np.linspace(0, count - 1, min(count, 4000)).astype(int)
    return np.asarray(points_xyz_m[rows])


def _odd_extents(points_xyz_m: NDArray[np.float64]) -> Iterator[str]:
    """Ways in which points do not lie around a LiDAR."""
    low, high = np.percentile(points_xyz_m, [5, 95], axis=0)
    if np.ptp(points_xyz_m[:, 2]) < _FLAT_M:
        yield "all of its points lie in one plane"
    if (size_m := (high - low).max()) < _SMALL_M:
        yield f"its points lie within {size_m:.1g} m"
    if (away_m := float(np.median(np.linalg.norm(points_xyz_m, axis=1)))) > _FAR_M:
        yield f"its points lie {away_m / 1000:.0f} km away, in coordinates of a map"
    lines_m = np.unique(points_xyz_m[:, 0])
    if len(lines_m) < 0.05 * len(points_xyz_m) and np.median(np.diff(lines_m)) > _CELL_M:
        yield "its points are cells of a grid"


def _take_turns(clouds: Sequence[Cloud]) -> bool:
    """Whether every second cloud resembles the last but one, and not the last."""
    middles = np.array([cloud.points_xyz_m.mean(axis=0) for cloud in clouds])
    if len(middles) < 6:
        return False
    one, two = (np.median(np.linalg.norm(middles[k:] - middles[:-k], axis=1)) for k in (1, 2))
    return bool(one > 0.5 and two < 0.3 * one)
