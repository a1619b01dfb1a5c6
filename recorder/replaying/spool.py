"""Spools: files that hold the pieces of units until a sequence is assembled from them.

A record is a line of numbers and the piece's bytes; records lie in the order in which they are assembled.

Samples of a sequence by stream, and the share of points and pixels on traffic.

The images that cameras must see before a stretch, for the state of event pixels and exposure control.
"""

from __future__ import annotations

import hashlib
import heapq
import os
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from carlaloc_env.core.clock import STEP_NS, TICK_NS, Schedule, stamp_ns
from carlaloc_env.core.errors import WriterError
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import PointCloud, Sample, SemanticImage
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.dataset.checksums import file_sha256
from recorder.writers.base import Piece

_HEAD = struct.Struct("<qihHHHQ")
"""Stamp, place of the sensor in the rig, place of the sample among those of the sensor, number of the
writer, lengths of place, kind and data."""

Order = tuple[int, int, int]
"""Order of the records of a stretch: stamp [ns], place of the sensor in the rig, place of the
sample among those that the sensor gives at once."""


@dataclass(frozen=True, slots=True)
class SpoolFile:
    """A finished spool."""

    size: int
    """Length [bytes]."""
    sha256: str
    """Checksum of its content, in hexadecimal digits."""

    @classmethod
    def of(cls, path: Path) -> SpoolFile:
        """Length and checksum of a file.

        Raises:
            OSError: it cannot be read.
        """
        return cls(path.stat().st_size, file_sha256(path))


class SpoolWriter:
    """Writes a spool."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb")
        self._digest = hashlib.sha256()

    def put(self, order: Order, writer: int, piece: Piece) -> None:
        """Append a piece for the writer of a number."""
        place, kind = piece.place.encode(), piece.kind.encode()
        head = _HEAD.pack(*order, writer, len(place), len(kind), len(piece.data)) + place + kind
        for data in (head, piece.data):
            self._file.write(data)
            self._digest.update(data)

    def complete(self) -> SpoolFile:
        """Bring everything to the disk and close the file."""
        self._file.flush()
        os.fsync(self._file.fileno())
        size = self._file.tell()
        self._file.close()
        return SpoolFile(size, self._digest.hexdigest())

    def drop(self) -> None:
        """Close the file without completing it."""
        self._file.close()


Record = tuple[Order, int, Piece]
"""Order of a piece, number of its writer, and the piece."""


def read_spool(path: Path) -> Iterator[Record]:
    """Records of a spool.

    Raises:
        WriterError: it ends within a record.
    """
    with path.open("rb") as file:
        while head := file.read(_HEAD.size):
            try:
                stamp_ns, sensor, sample, writer, *sizes = _HEAD.unpack(head)
            except struct.error:
                raise _cut(path) from None
            place, kind, data = (file.read(size) for size in sizes)
            if len(data) != sizes[2]:
                raise _cut(path)
            yield (stamp_ns, sensor, sample), writer, Piece(stamp_ns, place.decode(), kind.decode(), data)


def merged(spools: Iterable[Path]) -> Iterator[Record]:
    """Records of several spools of a stretch, in their order."""
    return heapq.merge(*(read_spool(path) for path in spools), key=lambda record: record[0])


def _cut(path: Path) -> WriterError:
    return WriterError(f"{path} ends too early; delete {path.parent} and run the same command again")


class SampleCounts:
    """Counts samples by stream and, of labelled ones, points and pixels that lie on traffic.

    Parked cars belong to the town and do not count; vehicles that wait in traffic do.
    """

    def __init__(self) -> None:
        self._samples: Counter[str] = Counter()
        self._all: Counter[str] = Counter()
        self._movers: Counter[str] = Counter()

    def count(self, sample: Sample) -> None:
        """Count a sample."""
        self._samples[sample.sensor] += 1
        if isinstance(sample, (PointCloud, SemanticImage)) and sample.instance is not None:
            self._all[sample.sensor] += sample.instance.size
            self._movers[sample.sensor] += int(np.count_nonzero(sample.instance > EGO_INSTANCE))

    def add(self, counts: Mapping[str, Mapping[str, int]]) -> None:
        """Add the `numbers` of another instance."""
        for mine, name in ((self._samples, "samples"), (self._all, "labelled"), (self._movers, "movers")):
            mine.update(counts[name])

    def numbers(self) -> dict[str, dict[str, int]]:
        """Samples, labelled points or pixels, and those on movers, each by stream."""
        return {"samples": dict(self._samples), "labelled": dict(self._all), "movers": dict(self._movers)}

    def samples(self) -> dict[str, int]:
        """Number of samples by stream."""
        return dict(sorted(self._samples.items()))

    def shares(self) -> dict[str, float]:
        """Fraction of points or pixels on movers, 0–1, by stream."""
        return {name: round(self._movers[name] / max(self._all[name], 1), 5) for name in sorted(self._all)}


def first_pictures_ns(
    rig: SensorRig, camera_ns: tuple[int, int], span_ns: tuple[int, int]
) -> dict[CameraConfig, int]:
    """Stamp of each camera's first picture in a stretch [ns], of those with a picture there.

    Args:
        rig: The sensors.
        camera_ns: When cameras take pictures, end not included [ns].
        span_ns: The stretch, end not included [ns].
    """
    found = {}
    begin_ns, end_ns = max(camera_ns[0], span_ns[0]), min(camera_ns[1], span_ns[1])
    for config in rig.sensors:
        if isinstance(config, CameraConfig):
            ticks = Schedule.from_hz(config.rate_hz).ticks_in(-(-begin_ns // TICK_NS), -(-end_ns // TICK_NS))
            if ticks:
                found[config] = stamp_ns(ticks[0])
    return found


def past_ns(rig: SensorRig, camera_ns: tuple[int, int], span_ns: tuple[int, int]) -> tuple[int, int]:
    """Begin and end of the images that cameras must see before a stretch [ns]; equal if there are none.

    Takes the arguments of `first_pictures_ns`.
    """
    firsts = first_pictures_ns(rig, camera_ns, span_ns)
    begin_ns = min((config.remembers_from_ns(ns) for config, ns in firsts.items()), default=span_ns[0])
    return begin_ns, max(firsts.values(), default=span_ns[0])


def past_s(rig: SensorRig, camera_ns: tuple[int, int], span_ns: tuple[int, int]) -> float:
    """Length of `past_ns` [s]. Takes the arguments of `first_pictures_ns`."""
    begin_ns, end_ns = past_ns(rig, camera_ns, span_ns)
    return (end_ns - begin_ns) / 1e9


def nearest_begin_ns(rig: SensorRig, camera_ns: tuple[int, int]) -> int | None:
    """The nearest begin of pictures that needs at most a step of earlier images [ns], or None.

    Args:
        rig: The sensors.
        camera_ns: When cameras shall take pictures, end not included [ns].
    """
    begin_ns, end_ns = camera_ns
    reach_ns = round(1e9 * past_s(rig, camera_ns, camera_ns))
    others = range(max(begin_ns - reach_ns, 0), min(begin_ns + reach_ns, end_ns), STEP_NS)
    short = [ns for ns in others if past_s(rig, (ns, end_ns), (ns, end_ns)) <= STEP_NS / 1e9]
    return min(short, key=lambda ns: abs(ns - begin_ns), default=None)
