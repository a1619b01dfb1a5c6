"""A drive that goes on while a system reads it: sweeps and inertial samples as they come, and no folder."""

from __future__ import annotations

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
    """Asks whoever drives for each sweep, see `Readings`; with it come the inertial samples up to its end.

    Args:
        connection: The system's own connection.
    """

    def __init__(self, connection: Connection) -> None:
        super().__init__(connection)
        self.imu: deque[ImuSample] = deque()
        """Inertial samples that nothing has taken yet."""

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
    """The rig of a drive that goes on, and its readings.

    Args:
        rig: The sensors.
        connection: The system's own connection to whoever drives.
    """

    def __init__(self, rig: SensorRig, connection: Connection) -> None:
        readings = LiveReadings(connection)
        self.rig, self.cloud = rig, RAW
        self._readings, self._imu = readings, readings.imu

    def __getattr__(self, name: str) -> NoReturn:
        """Refuse what a folder would have: description, calibration, truth."""
        raise AttributeError(f"a drive that goes on has no '{name}', which is that of a sequence's folder")
