"""The tables of nuScenes v1.0: fixed ones, and those of a sequence made from what was written of it.

Names, indices and fields are those of nuscenes-devkit's ``schema_nuscenes.md`` and of nuScenes' own tables
(Caesar et al., "nuScenes: A multimodal dataset for autonomous driving", CVPR 2020).
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import matrix_to_quat
from carlaloc_env.scene.semantic_tags import Tag
from recorder.writers.formats.nuscenes_boxes import PARKED_ID

VERSION = "v1.0-trainval"
"""Folder of the tables; converters of others take this name, and scenes by nuScenes' own numbers."""
CATEGORIES = (
    "noise", "animal", "human.pedestrian.adult", "human.pedestrian.child",
    "human.pedestrian.construction_worker", "human.pedestrian.personal_mobility",
    "human.pedestrian.police_officer", "human.pedestrian.stroller", "human.pedestrian.wheelchair",
    "movable_object.barrier", "movable_object.debris", "movable_object.pushable_pullable",
    "movable_object.trafficcone", "static_object.bicycle_rack", "vehicle.bicycle", "vehicle.bus.bendy",
    "vehicle.bus.rigid", "vehicle.car", "vehicle.construction", "vehicle.emergency.ambulance",
    "vehicle.emergency.police", "vehicle.motorcycle", "vehicle.trailer", "vehicle.truck",
    "flat.driveable_surface", "flat.other", "flat.sidewalk", "flat.terrain", "static.manmade",
    "static.other", "static.vegetation", "vehicle.ego",
)  # fmt: skip
"""Categories; their indices are those of lidarseg."""
BOX_CATEGORY: dict[int, str] = {
    Tag.CAR: "vehicle.car", Tag.TRUCK: "vehicle.truck", Tag.BUS: "vehicle.bus.rigid",
    Tag.MOTORCYCLE: "vehicle.motorcycle", Tag.BICYCLE: "vehicle.bicycle",
    Tag.PEDESTRIAN: "human.pedestrian.adult",
}  # fmt: skip
"""Categories of boxes by semantic tag."""
_POINT_CATEGORY = {
    **BOX_CATEGORY, Tag.RIDER: "vehicle.bicycle", Tag.TRAIN: "vehicle.truck",
    Tag.ROAD: "flat.driveable_surface", Tag.ROAD_LINE: "flat.driveable_surface",
    Tag.SIDEWALK: "flat.sidewalk", Tag.GROUND: "flat.other", Tag.WATER: "flat.other",
    Tag.RAIL_TRACK: "flat.other", Tag.TERRAIN: "flat.terrain", Tag.VEGETATION: "static.vegetation",
    Tag.BUILDING: "static.manmade", Tag.WALL: "static.manmade", Tag.FENCE: "static.manmade",
    Tag.POLE: "static.manmade", Tag.TRAFFIC_LIGHT: "static.manmade", Tag.TRAFFIC_SIGN: "static.manmade",
    Tag.BRIDGE: "static.manmade", Tag.GUARD_RAIL: "static.manmade", Tag.STATIC: "static.other",
    Tag.DYNAMIC: "static.other", Tag.OTHER: "static.other", Tag.SNOW: "noise",
}  # fmt: skip
ATTRIBUTES = (
    "vehicle.moving", "vehicle.stopped", "vehicle.parked", "cycle.with_rider", "cycle.without_rider",
    "pedestrian.moving", "pedestrian.standing", "pedestrian.sitting_lying_down",
)  # fmt: skip
"""Attributes of boxes."""
VISIBILITIES = ("v0-40", "v40-60", "v60-80", "v80-100")
"""Levels of visibility [%], with the tokens 1 to 4."""
MOVING_FROM_MPS = 0.5
"""Speed from which a road user counts as moving [m/s]."""
Row = dict[str, Any]


def token(*parts: object) -> str:
    """A token that belongs to a record for ever, 32 hexadecimal digits."""
    text = "/".join(str(part) for part in parts)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def lidarseg_table() -> NDArray[np.uint8]:
    """Index of a point's category by semantic tag, shape (256,)."""
    table = np.zeros(256, np.uint8)
    for tag, name in _POINT_CATEGORY.items():
        table[tag] = CATEGORIES.index(name)
    return table


def attribute_of(category: str, number: int, speed_mps: float) -> str:
    """Name of a box's attribute."""
    moves = speed_mps > MOVING_FROM_MPS
    if category.startswith("human"):
        return "pedestrian.moving" if moves else "pedestrian.standing"
    if category in ("vehicle.bicycle", "vehicle.motorcycle"):
        return "cycle.with_rider"
    if number >= PARKED_ID:
        return "vehicle.parked"
    return "vehicle.moving" if moves else "vehicle.stopped"


def place_of(T: Array) -> Row:
    """Translation [m] and rotation (w first) of a transform (4, 4)."""
    x, y, z, w = (float(value) for value in matrix_to_quat(T[:3, :3]))
    return {"translation": [float(value) for value in T[:3, 3]], "rotation": [w, x, y, z]}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Channel:
    """A sensor."""

    name: str
    """As nuScenes names it, e.g. ``CAM_FRONT``."""
    modality: str
    """``camera``, ``lidar`` or ``radar``."""
    T_ego_sensor: Array
    """Maps the sensor's frame to `base_link`, shape (4, 4)."""
    K: Array | None = None
    """Camera matrix, shape (3, 3)."""
    size_px: tuple[int, int] = (0, 0)
    """Height and width of images [px]."""

    @property
    def suffix(self) -> str:
        """Suffix of its files."""
        return {"camera": ".jpg", "lidar": ".pcd.bin", "radar": ".pcd"}[self.modality]


@dataclass(slots=True, kw_only=True, eq=False)
class SequenceTables:
    """Rows of the tables of a sequence, cut into scenes."""

    name: str
    """Town and name of the sequence, the stem of all tokens."""
    town: str
    """Name of the town, and of the location."""
    origin_m: Array
    """Where in the world the origin of nuScenes' global frame lies, shape (2,)."""
    about: str
    """Description of all scenes."""
    date: str
    """Day of the drive, e.g. ``2023-01-01``."""
    samples_us: list[int] = field(default_factory=list)
    """Times of samples [µs]."""
    scenes: list[int] = field(default_factory=list)
    """Number of each sample's scene."""
    data_us: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    """Times of all measurements of each channel [µs]."""
    poses: dict[int, Row] = field(default_factory=dict)
    """Pose of the car by time [µs]."""
    boxes: list[list[Row]] = field(default_factory=list)
    """Boxes of each sample."""

    def file_name(self, channel: Channel, stamp_us: int, is_key: bool) -> str:
        """Path of a measurement below the root."""
        stem = f"{self.name.replace('/', '-')}__{channel.name}__{stamp_us}{channel.suffix}"
        return f"{'samples' if is_key else 'sweeps'}/{channel.name}/{stem}"

    def key_rows(self, channel: str) -> dict[int, int]:
        """Sample of each measurement of a channel that belongs to one, by row: the nearest in time."""
        times = np.array(self.data_us[channel], np.int64)
        if not len(times):
            return {}
        samples = np.array(self.samples_us, np.int64)
        after = np.clip(np.searchsorted(times, samples), 1, max(len(times) - 1, 1))
        before = after - 1
        after = np.minimum(after, len(times) - 1)
        row = np.where(np.abs(times[after] - samples) < np.abs(times[before] - samples), after, before)
        near = np.abs(times[row] - samples) <= 250_000
        return {int(r): k for k, r in enumerate(row) if near[k]}

    def tables(self, channels: Sequence[Channel]) -> Iterator[tuple[str, Iterable[Row]]]:
        """All tables by name, rows as JSON takes them."""
        yield from _fixed_tables()
        logs = [token(self.name, "log")]
        yield (
            "sensor",
            [{"token": token("sensor", c.name), "channel": c.name, "modality": c.modality} for c in channels],
        )
        yield "calibrated_sensor", [self._calibrated(c) for c in channels]
        yield "log", [
            {
                "token": logs[0], "logfile": self.name, "vehicle": "carlaloc", "date_captured": self.date,
                "location": self.town, "origin_enu_m": self.origin_m.tolist(),
            }
        ]  # fmt: skip
        map_row = {"token": token(self.town, "map"), "log_tokens": logs, "category": "semantic_prior"}
        yield "map", [{**map_row, "filename": f"maps/{self.town}.png"}]
        yield "scene", self._scenes()
        yield "sample", self._samples()
        yield "ego_pose", ({"token": self._at("pose", us), "timestamp": us, **row}
                           for us, row in self.poses.items())  # fmt: skip
        keys = {channel.name: self.key_rows(channel.name) for channel in channels}
        yield "sample_data", (row for c in channels for row in self._sample_data(c, keys[c.name]))
        lidar = next(channel for channel in channels if channel.modality == "lidar")
        yield "lidarseg", [
            {"token": self._at(lidar.name, us), "sample_data_token": self._at(lidar.name, us),
             "filename": self.lidarseg_name(lidar, us)}
            for us in (self.data_us[lidar.name][row] for row in keys[lidar.name])
        ]  # fmt: skip
        instances, annotations = self._annotations()
        yield "instance", instances
        yield "sample_annotation", annotations

    def lidarseg_name(self, lidar: Channel, stamp_us: int) -> str:
        """Path of the labels of a sample's points below the root."""
        return f"lidarseg/{VERSION}/{self._at(lidar.name, stamp_us)}_lidarseg.bin"

    def _at(self, kind: str, stamp_us: int) -> str:
        return token(self.name, kind, stamp_us)

    def _calibrated(self, channel: Channel) -> Row:
        return {
            "token": token(self.name, "mount", channel.name),
            "sensor_token": token("sensor", channel.name),
            **place_of(channel.T_ego_sensor),
            "camera_intrinsic": [] if channel.K is None else channel.K.tolist(),
        }

    def _scenes(self) -> list[Row]:
        rows = []
        for scene in dict.fromkeys(self.scenes):
            own = [us for us, number in zip(self.samples_us, self.scenes, strict=True) if number == scene]
            rows.append(
                {
                    "token": token(self.name, "scene", scene), "log_token": token(self.name, "log"),
                    "nbr_samples": len(own), "first_sample_token": self._at("sample", own[0]),
                    "last_sample_token": self._at("sample", own[-1]), "name": f"scene-{scene + 1:04d}",
                    "description": self.about,
                }
            )  # fmt: skip
        return rows

    def _samples(self) -> list[Row]:
        rows = [
            {"token": self._at("sample", us), "timestamp": us, "prev": "", "next": "",
             "scene_token": token(self.name, "scene", scene)}
            for us, scene in zip(self.samples_us, self.scenes, strict=True)
        ]  # fmt: skip
        _chain(rows, "scene_token")
        return rows

    def _sample_data(self, channel: Channel, keys: Mapping[int, int]) -> list[Row]:
        """Measurements of a channel; between samples they belong to the sample that follows."""
        times = self.data_us[channel.name]
        following = np.minimum(np.searchsorted(self.samples_us, times), len(self.samples_us) - 1).tolist()
        height, width = channel.size_px
        rows = []
        for row, us in enumerate(times):
            sample = keys.get(row, following[row])
            rows.append(
                {
                    "token": self._at(channel.name, us),
                    "sample_token": self._at("sample", self.samples_us[sample]),
                    "ego_pose_token": self._at("pose", us),
                    "calibrated_sensor_token": token(self.name, "mount", channel.name), "timestamp": us,
                    "fileformat": channel.suffix.split(".")[1], "is_key_frame": row in keys,
                    "height": height, "width": width, "prev": "", "next": "",
                    "filename": self.file_name(channel, us, row in keys), "scene": self.scenes[sample],
                }
            )  # fmt: skip
        _chain(rows, "scene")
        for record in rows:
            del record["scene"]
        return rows

    def _annotations(self) -> tuple[list[Row], list[Row]]:
        """Instances, which are those of a scene, and boxes."""
        rows: list[Row] = []
        for us, scene, boxes in zip(self.samples_us, self.scenes, self.boxes, strict=True):
            for box in boxes:
                category, number, speed = box["category"], box["number"], box["speed_mps"]
                rows.append(
                    {
                        "token": token(self.name, "box", us, number),
                        "sample_token": self._at("sample", us),
                        "instance_token": token(self.name, "instance", scene, number),
                        "visibility_token": str(1 + int(np.searchsorted((0.4, 0.6, 0.8), box["visible"]))),
                        "attribute_tokens": [token("attribute", attribute_of(category, number, speed))],
                        **box["place"], "size": box["size"], "prev": "", "next": "",
                        "num_lidar_pts": box["points"], "num_radar_pts": box["detections"],
                        "category": category,
                    }
                )  # fmt: skip
        _chain(rows, "instance_token")
        instances: dict[str, Row] = {}
        for row in rows:
            own = instances.setdefault(
                row["instance_token"],
                {
                    "token": row["instance_token"], "category_token": token("category", row.pop("category")),
                    "nbr_annotations": 0, "first_annotation_token": row["token"],
                    "last_annotation_token": "",
                },
            )  # fmt: skip
            row.pop("category", None)
            own["nbr_annotations"] += 1
            own["last_annotation_token"] = row["token"]
        return list(instances.values()), rows


def _chain(rows: Sequence[Row], key: str) -> None:
    """Link rows of the same key, in their order, by ``prev`` and ``next``."""
    chains: dict[Any, list[Row]] = defaultdict(list)
    for row in rows:
        chains[row[key]].append(row)
    for chain in chains.values():
        for first, second in pairwise(chain):
            first["next"], second["prev"] = second["token"], first["token"]


def _fixed_tables() -> Iterator[tuple[str, list[Row]]]:
    yield (
        "category",
        [
            {"token": token("category", name), "name": name, "description": name, "index": index}
            for index, name in enumerate(CATEGORIES)
        ],
    )
    yield (
        "attribute",
        [{"token": token("attribute", name), "name": name, "description": name} for name in ATTRIBUTES],
    )
    yield (
        "visibility",
        [
            {"token": str(number), "level": level, "description": f"visible share [%]: {level[1:]}"}
            for number, level in enumerate(VISIBILITIES, start=1)
        ],
    )


def write_table(path: Path, rows: Iterable[Row]) -> None:
    """Write a table, a row a line."""
    with path.open("x", encoding="utf-8") as file:
        file.write("[")
        for number, row in enumerate(rows):
            file.write((",\n" if number else "\n") + json.dumps(row))
        file.write("\n]\n")
