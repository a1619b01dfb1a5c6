"""Readings of a sequence from files and from a feed, and images without movers.

Readings of a sequence from a feed, which makes a drive's sensor data while a system reads them.

Images without movers: masks of labelled images, and painting over.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

import cv2 as untyped_cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Imu, PointCloud, Sample, SemanticImage
from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.readings import (
    ImuSample,
    StereoPair,
    imu_of,
    imu_sample,
    lidar_of,
    messages,
    stamp_ns,
    stereo_of,
    topic_of,
    topics_in,
)
from recorder.dataset.scans import Scan, TimeRule, read_scans
from recorder.writers.topics import TopicProfile

cv2: Any = untyped_cv2
"""OpenCV; its stubs know arrays of a single type."""

MARGIN_PX = 4
"""Width of the rim around a mover that is painted over, too: features look at their surroundings [px]."""
SHRINK = 4
"""Factor by which pictures are reduced for inpainting: it must be smooth, not sharp."""

Mask: TypeAlias = tuple[int, NDArray[np.bool_]]
"""Unix time of an image [ns], and where it shows movers, shape (H, W)."""


def mover_masks(bag: Path, topic: str) -> Iterator[Mask]:
    """Masks of the labelled images of a topic.

    Args:
        bag: ROS 1 or ROS 2 bag.
        topic: Topic of images whose values are semantic tags.
    """
    for message in messages(bag, topic):
        image = np.asarray(message.data).reshape(message.height, message.step)[:, : message.width]
        yield stamp_ns(message), mask_of(image)


def mask_of(tags: U8) -> NDArray[np.bool_]:
    """Where an image of semantic tags shows movers, with a rim of `MARGIN_PX`, shape (H, W)."""
    rim = np.ones((2 * MARGIN_PX + 1, 2 * MARGIN_PX + 1), np.uint8)
    movers = np.isin(tags, np.array(sorted(DYNAMIC_TAGS), np.uint8)).astype(np.uint8)
    return np.asarray(cv2.dilate(movers, rim) > 0)


def pairs_without_movers(
    pairs: Iterator[StereoPair], left: Iterator[Mask], right: Iterator[Mask]
) -> Iterator[StereoPair]:
    """Pairs of `without_movers`, by masks that come in the order of time.

    Args:
        pairs: Pairs of images.
        left: Masks of the left images; those of other times are passed over.
        right: Masks of the right images.
    """
    for pair in pairs:
        yield movers_painted_over(pair, *(_of_stamp(found, pair.stamp_ns) for found in (left, right)))


def movers_painted_over(pair: StereoPair, left: NDArray[np.bool_], right: NDArray[np.bool_]) -> StereoPair:
    """A pair in which movers are painted over in the tones around them, with the mask of the left image.

    Systems without masks find few features in smooth paint; systems with masks get them.
    """
    return replace(
        pair, left=painted_over(pair.left, left), right=painted_over(pair.right, right), left_mover=left
    )


def _of_stamp(masks: Iterator[Mask], stamp_ns: int) -> NDArray[np.bool_]:
    for found_ns, mask in masks:
        if found_ns == stamp_ns:
            return mask
    raise EvaluationError(f"no labelled image of {stamp_ns}; replay cameras with the output semantic")


def painted_over(image: U8, mask: NDArray[np.bool_]) -> U8:
    """An image whose masked part is filled smoothly from its rim (Telea 2004), shape (H, W)."""
    if not mask.any():
        return image
    height, width = image.shape
    small = (max(width // SHRINK, 1), max(height // SHRINK, 1))
    coarse = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
    hole = cv2.resize(mask.astype(np.uint8) * 255, small, interpolation=cv2.INTER_AREA) > 0
    paint = cv2.inpaint(coarse, hole.astype(np.uint8), 3, cv2.INPAINT_TELEA)
    smooth = cv2.resize(paint, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.where(mask, smooth, image), np.uint8)


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
        return topics_in(self.bag)[self._cloud_topic]

    def scans(self) -> Iterator[Scan]:
        """All sweeps of the bag."""
        return (scan for _, scan in read_scans(self.bag, self._cloud_topic, _OUR_TIMES))

    def imu_samples(self) -> Iterator[ImuSample]:
        """All inertial samples of the bag."""
        return map(imu_sample, messages(self.bag, self._topic(Imu, imu_of(self._rig).name)))

    def image_stamps(self) -> NDArray[np.int64]:
        """Times of the images of the left camera that have a partner, if there are two [ns], shape (N,)."""
        lists = [self.euroc / name / "data.csv" for name in ("cam0", "cam1")]
        found = []
        for file in [lists[0], *(file for file in lists[1:] if file.is_file())]:
            text = read_text(file, "list of images", EvaluationError)
            found.append([int(line.split(",")[0]) for line in text.splitlines() if line and line[0] != "#"])
        # A fault of one camera may have lost an image, or given it another stamp.
        partners = set(found[-1])
        return np.array([stamp for stamp in found[0] if stamp in partners], np.int64)

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
    def _cloud_topic(self) -> str:
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


NEXT, STAMPS, IMU = "next", "stamps", "imu"
"""Requests to a feed: the next frame (None: there is none), times of all frames, inertial samples."""


class FeedReadings:
    """Asks a feed, see `Readings`; frames come once, in the order of time.

    Args:
        connection: The system's connection to the feed.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    @property
    def bag(self) -> Path:
        """There is none."""
        self._refuse("bag")

    @property
    def euroc(self) -> Path:
        """There is none."""
        self._refuse("folder mav0")

    def scan_count(self) -> int:
        """Number of sweeps."""
        return len(self._ask(STAMPS))

    def scans(self) -> Iterator[Scan]:
        """All sweeps."""
        while (scan := self._ask(NEXT)) is not None:
            yield scan

    def imu_samples(self) -> Iterator[ImuSample]:
        """All inertial samples."""
        yield from self._ask(IMU)

    def image_stamps(self) -> NDArray[Any]:
        """Times of the images of the left camera [ns], shape (N,)."""
        stamps: NDArray[Any] = self._ask(STAMPS)
        return stamps

    def stereo_pairs(self, *, without_movers: bool) -> Iterator[StereoPair]:
        """All pairs of grey images."""
        while (found := self._ask(NEXT)) is not None:
            pair, masks = found
            if without_movers and masks is None:
                raise EvaluationError("no labelled images; take cameras with the output semantic")
            yield movers_painted_over(pair, *masks) if without_movers else pair

    def _ask(self, request: str) -> Any:
        try:
            self._connection.send(request)
            return self._connection.recv()
        except (EOFError, OSError) as error:
            raise EvaluationError("the sensor data ended early; see feed.log") from error

    @staticmethod
    def _refuse(what: str) -> NoReturn:
        raise EvaluationError(f"a drive that is read as it is made has no {what}; replay it into a dataset")
