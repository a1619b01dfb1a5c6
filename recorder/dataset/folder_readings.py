"""Reads the sensor data of a sequence from the files of its folder."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2 as untyped_cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Imu, PointCloud, Sample, SemanticImage
from recorder.dataset.bag_messages import imu_sample, messages, topic_of, topics_in
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.mover_masks import mover_masks, pairs_without_movers
from recorder.dataset.point_times import TimeRule
from recorder.dataset.readings import ImuSample, StereoPair
from recorder.dataset.rig_sensors import imu_of, lidar_of, stereo_of
from recorder.dataset.scans import Scan, read_scans
from recorder.writers.topics import TopicProfile

cv2: Any = untyped_cv2
"""OpenCV; its stubs know arrays of a single type."""
_OUR_TIMES = TimeRule(field="time")
"""Times of points as our bags write them: seconds after the header's stamp, the sweep's beginning."""
_READ_HERE: dict[type[Sample], tuple[str, ...]] = {
    PointCloud: ("points", "points_labelled", "points_of_the_town", "cloud_draco"),
    Imu: ("imu",),
    SemanticImage: ("image_tags",),
}
"""Encoders of `messages.ENCODERS` whose messages are read here, by kind of sample."""


class FolderReadings:
    """Reads what lies in a sequence's folder, see `Readings`.

    Args:
        files: The folder.
        rig: Sensors of the drive.
        profile: Topics of its bags.
        streams: Streams of the sequence, with numbers of samples.
    """

    def __init__(
        self, files: SequenceFolder, *, rig: SensorRig, profile: TopicProfile, streams: Mapping[str, int]
    ) -> None:
        self._files, self._rig, self._profile, self._streams = files, rig, profile, streams

    @property
    def bag(self) -> Path:
        """The bag, of any format."""
        bags = self._files.bags
        if not bags:
            raise EvaluationError(f"{self._files.path} has no bag; replay with --format rosbag1,euroc")
        return bags[0]

    @property
    def euroc(self) -> Path:
        """The folder ``mav0``."""
        path = self._files.place("euroc")
        if not path.is_dir():
            raise EvaluationError(
                f"{self._files.path} has no {path.name}; replay with --format rosbag1,euroc"
            )
        return path

    def scan_count(self) -> int:
        """Number of sweeps."""
        return topics_in(self.bag)[self.cloud_topic]

    def scans(self) -> Iterator[Scan]:
        """All sweeps of the bag."""
        return (scan for _, scan in read_scans(self.bag, self.cloud_topic, _OUR_TIMES))

    def imu_samples(self) -> Iterator[ImuSample]:
        """All inertial samples of the bag."""
        return map(imu_sample, messages(self.bag, self._topic(Imu, imu_of(self._rig).name)))

    def image_stamps(self) -> NDArray[np.int64]:
        """Times of the images of the left camera that have a partner, if there are two [ns], shape (N,)."""
        lists = [self.euroc / name / "data.csv" for name in ("cam0", "cam1")]
        stamps_ns = []
        for file in [lists[0], *(file for file in lists[1:] if file.is_file())]:
            text = read_text(file, "list of images", EvaluationError)
            stamps_ns.append(
                [int(line.split(",")[0]) for line in text.splitlines() if line and line[0] != "#"]
            )
        # A fault of one camera may have lost an image, or given it another stamp.
        partners = set(stamps_ns[-1])
        return np.array([stamp for stamp in stamps_ns[0] if stamp in partners], np.int64)

    def stereo_pairs(self, *, without_movers: bool) -> Iterator[StereoPair]:
        """All pairs of grey images of ``mav0``; movers are painted over by the bag's labelled images."""
        if not (self.euroc / "cam1").is_dir():
            raise EvaluationError(f"{self.euroc} has one camera; stereo needs two")
        if not without_movers:
            return self._grey_pairs()
        names = [camera.name for camera in stereo_of(self._rig)]
        left, right = (self._topic(SemanticImage, f"semantic_{name}") for name in names)
        return pairs_without_movers(
            self._grey_pairs(), mover_masks(self.bag, left), mover_masks(self.bag, right)
        )

    def _grey_pairs(self) -> Iterator[StereoPair]:
        for stamp in self.image_stamps().tolist():
            left, right = (
                cv2.imread(str(self.euroc / camera / "data" / f"{stamp}.png"), cv2.IMREAD_GRAYSCALE)
                for camera in ("cam0", "cam1")
            )
            if left is None or right is None:
                raise EvaluationError(f"{self.euroc} lacks an image of {stamp}; replay it again")
            yield StereoPair(stamp_ns=stamp, left=np.asarray(left), right=np.asarray(right))

    @cached_property
    def cloud_topic(self) -> str:
        """Topic of the LiDAR's clouds, those with labels where there are some."""
        name = lidar_of(self._rig).name
        return self._topic(PointCloud, f"{name}_semantic", name)

    def _topic(self, kind: type[Sample], *wanted: str) -> str:
        """Topic of the first of some streams that the bag holds and that is read here."""
        topic = topic_of(self._profile, kind, wanted, streams=self._streams, encoders=_READ_HERE[kind])
        if topic is None:
            raise EvaluationError(
                f"topics '{self._profile.name}' hold no {wanted[-1]} that is read here; "
                "replay with --topics standard"
            )
        if topic not in topics_in(self.bag):
            raise EvaluationError(f"{self.bag} has no messages on {topic}; replay a stretch that holds some")
        return topic
