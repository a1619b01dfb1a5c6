"""A sequence of a dataset as SLAM systems read it: sweeps, inertial samples, stereo images, calibration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS
from carlaloc_env.sensors.camera.config import CameraConfig
from carlaloc_env.sensors.inertial.imu import ImuConfig
from carlaloc_env.sensors.lidar.config import LidarConfig
from recorder.dataset.mover_masks import Mask, mover_masks, without_movers
from recorder.dataset.scans import Scan, read_scans

RAW, SEGMENTED = "raw", "seg"
"""Clouds as measured, and without the points on classes that move (the paper's seg(d))."""
DATASET_FILE = "dataset.yaml"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSample:
    """One inertial sample."""

    stamp_ns: int
    """Unix time [ns]."""
    acceleration_mps2: Array
    """Specific force in the IMU's axes [m/s²], shape (3,)."""
    angular_velocity_radps: Array
    """Rate of turning in the IMU's axes [rad/s], shape (3,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoPair:
    """Two grey images of one instant."""

    stamp_ns: int
    """Unix time [ns]."""
    left: U8
    """Left image, shape (H, W)."""
    right: U8
    """Right image, shape (H, W)."""
    left_mover: NDArray[np.bool_] | None = None
    """Where the left image shows what moves by itself, painted over; None: nothing was. Shape (H, W)."""


class SlamSequence:
    """What lies in a sequence's folder, read piece by piece.

    Args:
        folder: Folder with a ``sequence.yaml``, as ``carlaloc replay`` writes it.
        cloud: Which points the sweeps hold, `RAW` or `SEGMENTED`.

    Raises:
        EvaluationError: there is no such folder, or it was taken out of its dataset.
    """

    def __init__(self, folder: Path, *, cloud: str = RAW) -> None:
        self.folder, self.cloud = folder, cloud
        if not (folder / "sequence.yaml").is_file():
            raise EvaluationError(f"{folder} holds no sequence.yaml; give a folder that replay wrote")
        dataset = folder.parent.parent / DATASET_FILE
        if not dataset.is_file():
            raise EvaluationError(
                f"{folder} lies in no dataset: {dataset} is missing; move the whole dataset, not one sequence"
            )
        self.rig = _rig_of(read_text(dataset, "dataset's description", EvaluationError), dataset)

    @property
    def name(self) -> str:
        """Name of the folder: weather and traffic level."""
        return self.folder.name

    @property
    def bag(self) -> Path:
        """The bag, of any format.

        Raises:
            EvaluationError: there is none.
        """
        for suffix in (".bag", "_ros2", "_sqlite3"):
            path = self.folder / f"{self.name}{suffix}"
            if path.exists():
                return path
        raise EvaluationError(f"{self.folder} has no bag; replay with --format rosbag1,euroc")

    @property
    def euroc(self) -> Path:
        """The folder ``mav0``.

        Raises:
            EvaluationError: there is none.
        """
        path = self.folder / "mav0"
        if not path.is_dir():
            raise EvaluationError(f"{self.folder} has no mav0; replay with --format rosbag1,euroc")
        return path

    @property
    def calibration(self) -> Path:
        """Folder of the calibration files."""
        return self.folder.parent / "calibration"

    @cached_property
    def lidar(self) -> LidarConfig:
        """The LiDAR.

        Raises:
            EvaluationError: the rig has none.
        """
        return cast(LidarConfig, self._first("lidar"))

    @cached_property
    def imu(self) -> ImuConfig:
        """The IMU.

        Raises:
            EvaluationError: the rig has none.
        """
        return cast(ImuConfig, self._first("imu"))

    @cached_property
    def stereo(self) -> tuple[CameraConfig, CameraConfig]:
        """The first two cameras, the left one first.

        Raises:
            EvaluationError: the rig has fewer.
        """
        cameras = cast(tuple[CameraConfig, ...], self.rig.of_kind("camera"))
        if len(cameras) < 2:
            raise EvaluationError(f"rig '{self.rig.name}' has {len(cameras)} cameras; stereo needs two")
        return cameras[0], cameras[1]

    def truth_file(self, frame: str) -> Path:
        """TUM file of a frame: ``lidar``, ``imu``, ``camera`` (the left one) or ``base_link``."""
        names = {"lidar": "lidar", "imu": "imu", "camera": "camera"}
        if frame == "camera":
            name = self.stereo[0].frame_id
        else:
            name = self._first(frame).frame_id if frame in names else frame
        return self.folder.parent / "ground_truth" / f"{name}.tum"

    def T(self, to: str, of: str) -> Array:
        """Maps coordinates of sensor `of` to sensor `to` (``lidar``, ``imu``), shape (4, 4)."""
        T_base_to, T_base_of = (self._first(kind).mount.T_base_sensor for kind in (to, of))
        T: Array = np.linalg.inv(T_base_to) @ T_base_of
        return T

    def frames(self, sensor: str) -> int:
        """Number of sweeps (``lidar``) or of pairs of images (``stereo``).

        Raises:
            EvaluationError: there are none.
        """
        if sensor == "stereo":
            return len(self.image_stamps())
        topic = self._topic(self._cloud_topics, "point clouds")
        with _reader(self.bag) as reader:
            return sum(c.msgcount for c in reader.connections if c.topic == topic)

    @property
    def has_labelled_scans(self) -> bool:
        """Whether its sweeps can be had without movers: the bag has clouds, and the first one has labels."""
        try:
            topic = self._topic(self._cloud_topics, "point clouds")
            return any(scan.tag is not None for _, scan in islice(read_scans(self.bag, topic), 1))
        except EvaluationError:
            return False

    @property
    def _cloud_topics(self) -> tuple[str, ...]:
        return (f"/{self.lidar.name}/points", "/velodyne")

    def scans(self) -> Iterator[Scan]:
        """All sweeps, without what moves by itself if the cloud is `SEGMENTED`.

        Raises:
            EvaluationError: the bag has no clouds, or none with labels where they are needed.
        """
        topic = self._topic(self._cloud_topics, "point clouds")
        moving = np.array(sorted(DYNAMIC_TAGS), np.uint8)
        for _, scan in read_scans(self.bag, topic):
            if self.cloud == RAW:
                yield scan
                continue
            if scan.tag is None:
                raise EvaluationError(
                    f"{self.bag} has clouds without labels; replay with --topics standard for seg clouds"
                )
            yield scan.take(~np.isin(scan.tag, moving))

    def imu_samples(self) -> Iterator[ImuSample]:
        """All inertial samples.

        Raises:
            EvaluationError: the bag has none.
        """
        topic = self._topic((f"/{self.imu.name}/data", "/imu"), "inertial samples")
        for message in _messages(self.bag, topic):
            a, w, stamp = message.linear_acceleration, message.angular_velocity, message.header.stamp
            yield ImuSample(
                stamp_ns=stamp.sec * 1_000_000_000 + stamp.nanosec,
                acceleration_mps2=np.array([a.x, a.y, a.z]),
                angular_velocity_radps=np.array([w.x, w.y, w.z]),
            )

    def image_stamps(self) -> NDArray[np.int64]:
        """Times of the images of the left camera [ns], shape (N,)."""
        text = read_text(self.euroc / "cam0" / "data.csv", "list of images", EvaluationError)
        rows = [line.split(",")[0] for line in text.splitlines() if line and line[0] != "#"]
        return np.array(rows, np.int64)

    def stereo_pairs(self) -> Iterator[StereoPair]:
        """All pairs of grey images of ``mav0``.

        Raises:
            EvaluationError: there are no images of two cameras.
        """
        if not (self.euroc / "cam1").is_dir():
            raise EvaluationError(f"{self.euroc} has one camera; stereo needs two")
        pairs = self._grey_pairs()
        return pairs if self.cloud == RAW else without_movers(pairs, *self._mover_masks())

    def _mover_masks(self) -> tuple[Iterator[Mask], Iterator[Mask]]:
        names = [camera.name for camera in self.stereo]
        left, right = (self._topic((f"/camera/{name}/semantic",), "labelled images") for name in names)
        return mover_masks(self.bag, left), mover_masks(self.bag, right)

    def _grey_pairs(self) -> Iterator[StereoPair]:
        for stamp in self.image_stamps().tolist():
            left, right = (
                cv2.imread(str(self.euroc / camera / "data" / f"{stamp}.png"), cv2.IMREAD_GRAYSCALE)
                for camera in ("cam0", "cam1")
            )
            if left is None or right is None:
                raise EvaluationError(f"{self.euroc} lacks an image of {stamp}; replay it anew")
            yield StereoPair(stamp_ns=stamp, left=np.asarray(left), right=np.asarray(right))

    def _first(self, kind: str) -> Any:
        found = self.rig.of_kind(kind)
        if not found:
            raise EvaluationError(f"rig '{self.rig.name}' has no {kind}; replay with a rig that has one")
        return found[0]

    def _topic(self, wanted: tuple[str, ...], what: str) -> str:
        with _reader(self.bag) as reader:
            topics = {connection.topic for connection in reader.connections}
        for topic in wanted:
            if topic in topics:
                return topic
        raise EvaluationError(f"{self.bag} has no {what} on {' or '.join(wanted)}")


def _reader(bag: Path) -> AnyReader:
    return AnyReader([bag], default_typestore=get_typestore(Stores.ROS1_NOETIC))


def _messages(bag: Path, topic: str) -> Iterator[Any]:
    try:
        with _reader(bag) as reader:
            wanted = [connection for connection in reader.connections if connection.topic == topic]
            for connection, _, raw in reader.messages(connections=wanted):
                yield reader.deserialize(raw, connection.msgtype)
    # A damaged bag makes the library raise whatever its parts do: struct, zlib, assertions, …
    except Exception as error:
        raise EvaluationError(f"cannot read {bag}: no ROS bag, or a damaged one; give another") from error


def _rig_of(text: str, path: Path) -> SensorRig:
    """The rig in a dataset's description, whose thousands of checksums are not parsed for it."""
    lines = text.splitlines()
    try:
        begin = lines.index("rig:")
    except ValueError:
        raise EvaluationError(f"{path} names no rig; give a dataset that replay wrote") from None
    end = next((k for k in range(begin + 1, len(lines)) if lines[k][:1] not in (" ", "")), len(lines))
    document = yaml.safe_load("\n".join(lines[begin:end]))["rig"]
    return SensorRig.from_yaml(yaml.safe_dump(document), where=str(path))
