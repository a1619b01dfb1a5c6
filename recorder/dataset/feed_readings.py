"""Reads the sensor data of a sequence from a feed, which makes them while a system reads."""

from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

from numpy.typing import NDArray

from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.mover_masks import movers_painted_over
from recorder.dataset.readings import ImuSample, StereoPair
from recorder.dataset.scans import Scan

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
        """Refuse: a feed has no bag."""
        self._refuse("bag")

    @property
    def euroc(self) -> Path:
        """Refuse: a feed has no folder."""
        self._refuse("folder mav0")

    @property
    def cloud_topic(self) -> str:
        """Refuse: a feed has no topics."""
        self._refuse("topic")

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
        while (frame := self._ask(NEXT)) is not None:
            pair, masks = frame
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
