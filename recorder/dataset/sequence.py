"""A sequence of a dataset as SLAM systems read it: sweeps, inertial samples, stereo images, calibration."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.samples import Imu, PointCloud, Sample, SemanticImage
from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS
from carlaloc_env.sensors.camera.config import CameraConfig
from carlaloc_env.sensors.inertial.imu import ImuConfig
from carlaloc_env.sensors.lidar.config import LidarConfig
from recorder.dataset.bags import messages, stamp_ns, topic_of, topics_in
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.manifest import DatasetManifest, SequenceDescription
from recorder.dataset.mover_masks import Mask, mover_masks, without_movers
from recorder.dataset.point_times import TimeRule
from recorder.dataset.readings import ImuSample, StereoPair
from recorder.dataset.scans import Scan, read_scans

RAW, SEGMENTED = "raw", "seg"
"""Clouds as measured, and without the points on classes that move (the paper's seg(d))."""
_OUR_TIMES = TimeRule(field="time")
"""Times of points as our bags write them: seconds after the header's stamp, the sweep's beginning."""
_READ_HERE: dict[type[Sample], tuple[str, ...]] = {
    PointCloud: ("points", "points_labelled", "points_of_the_town"),
    Imu: ("imu",),
    SemanticImage: ("image_tags",),
}
"""Encoders of `messages.ENCODERS` whose messages are read here, by kind of sample."""


class SlamSequence:
    """What lies in a sequence's folder, read piece by piece.

    Args:
        folder: Folder with a ``sequence.yaml``, as ``carlaloc replay`` writes it.
        cloud: Which points the sweeps hold, `RAW` or `SEGMENTED`.

    Raises:
        EvaluationError: there is no such folder, or it was taken out of its dataset.
    """

    def __init__(self, folder: Path, *, cloud: str = RAW) -> None:
        # A relative path of one or two parts does not name the dataset's folder.
        self.files, self.cloud = SequenceFolder(folder if len(folder.parts) > 2 else folder.resolve()), cloud
        dataset = self.files.drive.dataset
        if self.files.description.is_file() and not dataset.description.is_file():
            raise EvaluationError(
                f"{folder} lies in no dataset: {dataset.description} is missing; move the whole dataset, "
                "not one sequence"
            )
        self.description = SequenceDescription.read(self.files, EvaluationError)
        manifest = DatasetManifest.read(dataset.path, EvaluationError)
        town = folder.resolve().parent.name
        self.rig, self.profile = manifest.rig(town), manifest.profile(town)

    @property
    def folder(self) -> Path:
        """Its folder."""
        return self.files.path

    @property
    def name(self) -> str:
        """Name of the folder: weather and traffic level."""
        return self.files.name

    @property
    def bag(self) -> Path:
        """The bag, of any format.

        Raises:
            EvaluationError: there is none.
        """
        bags = self.files.bags
        if not bags:
            raise EvaluationError(f"{self.folder} has no bag; replay with --format rosbag1,euroc")
        return bags[0]

    @property
    def euroc(self) -> Path:
        """The folder ``mav0``.

        Raises:
            EvaluationError: there is none.
        """
        path = self.files.place("euroc")
        if not path.is_dir():
            raise EvaluationError(f"{self.folder} has no {path.name}; replay with --format rosbag1,euroc")
        return path

    @property
    def calibration(self) -> Path:
        """Folder of the calibration files."""
        return self.files.drive.calibration

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
        return self.files.drive.truth(name)

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
        return topics_in(self.bag)[self._cloud_topic]

    @property
    def has_labelled_scans(self) -> bool:
        """Whether its sweeps can be had without movers: the bag has clouds, and the first one has labels."""
        try:
            return any(scan.tag is not None for scan in islice(self._raw_scans(), 1))
        except EvaluationError:
            return False

    def _raw_scans(self) -> Iterator[Scan]:
        return (scan for _, scan in read_scans(self.bag, self._cloud_topic, _OUR_TIMES))

    @cached_property
    def _cloud_topic(self) -> str:
        name = self.lidar.name
        return self._topic(PointCloud, f"{name}_semantic", name)

    def scans(self) -> Iterator[Scan]:
        """All sweeps, without what moves by itself if the cloud is `SEGMENTED`.

        Raises:
            EvaluationError: the bag has no clouds, or none with labels where they are needed.
        """
        moving = np.array(sorted(DYNAMIC_TAGS), np.uint8)
        for scan in self._raw_scans():
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
        for message in messages(self.bag, self._topic(Imu, self.imu.name)):
            a, w = message.linear_acceleration, message.angular_velocity
            yield ImuSample(
                stamp_ns=stamp_ns(message),
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
        left, right = (self._topic(SemanticImage, f"semantic_{name}") for name in names)
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

    def _topic(self, kind: type[Sample], *wanted: str) -> str:
        """Topic of the first of some streams that the bag holds and that is read here."""
        topic = topic_of(
            self.profile, kind, wanted, streams=self.description.samples, encoders=_READ_HERE[kind]
        )
        if topic is None:
            raise EvaluationError(
                f"topics '{self.profile.name}' hold no {wanted[-1]} that is read here; "
                "replay with --topics standard"
            )
        if topic not in topics_in(self.bag):
            raise EvaluationError(f"{self.bag} has no messages on {topic}; replay a stretch that holds some")
        return topic
