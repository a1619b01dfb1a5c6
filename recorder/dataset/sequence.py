"""A sequence for SLAM systems: sweeps, inertial samples, stereo images, calibration, truth."""

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS
from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.dataset.bag_messages import stamps_in
from recorder.dataset.folder_readings import FolderReadings
from recorder.dataset.layout import SequenceFolder, whole_path
from recorder.dataset.manifest import DatasetManifest, SequenceDescription
from recorder.dataset.reading_checks import check_gaps, imu_faults
from recorder.dataset.readings import ImuSample, Readings, StereoPair
from recorder.dataset.rig_sensors import imu_of, lidar_of, stereo_of, with_lidar_first
from recorder.dataset.scans import Scan
from recorder.evaluation.trajectory_files import read_tum

_SENSORS = ("lidar", "imu", "camera")
"""Frames that are a sensor's."""
RAW, SEGMENTED = "raw", "seg"
"""Clouds as measured, and without the points on classes that move (the paper's seg(d))."""


class SlamSequence:
    """Description, calibration and truth of a sequence's folder, and its readings, piece by piece.

    Args:
        folder: Folder with a ``sequence.yaml``, as ``carlaloc replay`` writes it.
        cloud: Which points the sweeps hold, `RAW` or `SEGMENTED`.
        readings: Where sweeps, images and inertial samples come from; None: the folder's files.
        lidar: Name of the LiDAR; None: the rig's first.

    Raises:
        EvaluationError: there is no such folder or LiDAR, or it was taken out of its dataset.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        cloud: str = RAW,
        readings: Readings | None = None,
        lidar: str | None = None,
    ) -> None:
        # A relative path of two parts or fewer does not name the dataset's folder.
        folder = Path(folder)
        self.files, self.cloud = (
            SequenceFolder(folder if len(folder.parts) > 2 else whole_path(folder)),
            cloud,
        )
        dataset = self.files.drive.dataset
        if self.files.description.is_file() and not dataset.description.is_file():
            raise EvaluationError(
                f"{folder} lies in no dataset: {dataset.description} is missing; move the whole dataset, "
                "not one sequence"
            )
        self.description = SequenceDescription.read(self.files, EvaluationError)
        manifest = DatasetManifest.read(dataset.path, EvaluationError)
        town = whole_path(folder).parent.name
        profile, rig = manifest.profile(town), manifest.rig(town)
        self.rig = with_lidar_first(rig, lidar)
        self._is_calibrated = self.rig.of_kind("lidar")[:1] == rig.of_kind("lidar")[:1]
        self._imu: deque[ImuSample] | None = None
        self._readings: Readings = readings or FolderReadings(
            self.files, rig=self.rig, profile=profile, streams=self.description.samples
        )

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
        return self._readings.bag

    @property
    def euroc(self) -> Path:
        """The folder ``mav0``.

        Raises:
            EvaluationError: there is none.
        """
        return self._readings.euroc

    @property
    def calibration(self) -> Path:
        """Folder of the calibration files.

        Raises:
            EvaluationError: another LiDAR is read than the rig's first, which they are made for.
        """
        if not self._is_calibrated:
            raise EvaluationError(
                f"files of calibration are for the rig's first LiDAR, not '{self.lidar.name}'; run the "
                "system over the drive (.mcap) with --lidar"
            )
        return self.files.drive.calibration

    @cached_property
    def lidar(self) -> LidarConfig:
        """The LiDAR.

        Raises:
            EvaluationError: the rig has none.
        """
        return lidar_of(self.rig)

    @cached_property
    def imu(self) -> ImuConfig:
        """The IMU.

        Raises:
            EvaluationError: the rig has none.
        """
        return imu_of(self.rig)

    @cached_property
    def stereo(self) -> tuple[CameraConfig, CameraConfig]:
        """The first two cameras, the left one first.

        Raises:
            EvaluationError: the rig has fewer.
        """
        return stereo_of(self.rig)

    def truth_file(self, frame: str) -> Path:
        """TUM file of a frame: ``lidar``, ``imu``, ``camera`` (the left one) or ``base_link``."""
        return self.files.drive.truth(self._sensor(frame).frame_id if frame in _SENSORS else frame)

    def T_base(self, frame: str) -> Array:
        """Maps coordinates of a frame of `truth_file` to `base_link`, shape (4, 4)."""
        return self._sensor(frame).mount.T_base_sensor if frame in _SENSORS else np.eye(4)

    def T(self, to: str, of: str) -> Array:
        """Maps coordinates of sensor `of` to sensor `to` (``lidar``, ``imu``), shape (4, 4)."""
        T: Array = np.linalg.inv(self.T_base(to)) @ self.T_base(of)
        return T

    def _sensor(self, frame: str) -> SensorConfig:
        return self.stereo[0] if frame == "camera" else self.lidar if frame == "lidar" else self.imu

    def frames(self, sensor: str) -> int:
        """Number of sweeps (``lidar``) or of pairs of images (``stereo``).

        Raises:
            EvaluationError: there are none.
        """
        return len(self.image_stamps()) if sensor == "stereo" else self._readings.scan_count()

    @property
    def has_labelled_scans(self) -> bool:
        """Whether its first sweep has labels, by which movers can be removed."""
        try:
            first = next(self._readings.scans(), None)
        except EvaluationError:
            return False
        return first is not None and first.tag is not None

    @property
    def cloud_topic(self) -> str:
        """Topic of the LiDAR's clouds in the folder's bag.

        Raises:
            EvaluationError: there is none.
        """
        return self._readings.cloud_topic

    def scans(self) -> Iterator[Scan]:
        """All sweeps, without movers if the cloud is `SEGMENTED`.

        Raises:
            EvaluationError: there are no clouds, or none with labels where they are needed.
        """
        moving = np.array(sorted(DYNAMIC_TAGS), np.uint8)
        for scan in self._readings.scans():
            if self.cloud == RAW:
                yield scan
                continue
            if scan.tag is None:
                raise EvaluationError(
                    f"{self.folder} has clouds without labels; replay with --topics standard for seg clouds"
                )
            yield scan.take(~np.isin(scan.tag, moving))

    def imu_samples(self) -> Iterator[ImuSample]:
        """All inertial samples.

        Raises:
            EvaluationError: there are none.
        """
        return self._readings.imu_samples()

    def imu_until(self, stamp_ns: int) -> list[ImuSample]:
        """Inertial samples up to a time [ns], each given once; of a live drive, those known by now.

        Raises:
            EvaluationError: there are none.
        """
        if self._imu is None:
            self._imu = deque(self.imu_samples())
        samples = []
        while self._imu and self._imu[0].stamp_ns <= stamp_ns:
            samples.append(self._imu.popleft())
        return samples

    def image_stamps(self) -> NDArray[np.int64]:
        """Times of the images of the left camera [ns], shape (N,)."""
        return self._readings.image_stamps()

    def stereo_pairs(self) -> Iterator[StereoPair]:
        """All pairs of grey images, movers painted over if the cloud is `SEGMENTED`.

        Raises:
            EvaluationError: there are no images of two cameras, or none with labels where they are needed.
        """
        return self._readings.stereo_pairs(without_movers=self.cloud == SEGMENTED)


def faults_of(sequence: SlamSequence, *, with_imu: bool = True) -> Iterator[str]:
    """Faults of the data of a folder that a system would meet: gaps in a bag's stamps, a wrong IMU.

    Args:
        sequence: The folder; what it lacks has no fault.
        with_imu: Whether the IMU is compared with the truth.
    """
    with suppress(EvaluationError):
        for (topic, _), stamps in sorted(stamps_in(sequence.bag).items()):
            yield from check_gaps(topic, np.unique(stamps))
        if with_imu:
            T, truth = sequence.imu.mount.T_base_sensor, read_tum(sequence.truth_file("base_link"))
            yield from imu_faults(sequence.imu_samples(), T, truth)
