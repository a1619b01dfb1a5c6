"""A drive in progress, read by a system: sweeps and inertial samples as they come, without a folder."""

from collections import deque
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import NoReturn

from carlaloc_env.rigs.rig import SensorRig
from recorder.dataset.feed_readings import NEXT, FeedReadings
from recorder.dataset.readings import ImuSample
from recorder.dataset.scans import Scan
from recorder.dataset.sequence import RAW, SlamSequence


class LiveReadings(FeedReadings):
    """Asks the driving process for each sweep, see `Readings`; inertial samples up to its end come with it.

    Args:
        connection: The system's connection.
    """

    def __init__(self, connection: Connection) -> None:
        super().__init__(connection)
        self.imu: deque[ImuSample] = deque()
        """Inertial samples that are not taken yet."""

    def scans(self) -> Iterator[Scan]:
        """Sweeps until the drive ends."""
        while (frame := self._ask(NEXT)) is not None:
            scan, samples = frame
            self.imu.extend(samples)
            yield scan

    def imu_samples(self) -> Iterator[ImuSample]:
        """Refuse: they are not all known."""
        self._refuse("inertial samples at once; take them by sequence.imu_until(stamp_ns)")


class LiveSequence(SlamSequence):
    """The rig of a drive in progress, and its readings.

    Args:
        rig: The sensors.
        connection: The system's connection to the driving process.
    """

    def __init__(self, rig: SensorRig, connection: Connection) -> None:
        readings = LiveReadings(connection)
        self.rig, self.cloud = rig, RAW
        self._readings, self._imu = readings, readings.imu

    def __getattr__(self, name: str) -> NoReturn:
        """Refuse attributes of a folder: description, calibration, truth."""
        raise AttributeError(f"a drive that goes on has no '{name}', which is that of a sequence's folder")
