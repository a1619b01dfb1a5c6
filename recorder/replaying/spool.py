"""Spools: files that hold the pieces of units until a sequence is assembled from them.

A record is a line of numbers and the piece's bytes; records lie in the order in which they are assembled.
"""

from __future__ import annotations

import hashlib
import heapq
import os
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from carlaloc_env.core.errors import WriterError
from recorder.dataset.checksums import file_sha256
from recorder.writers.base import Piece

_HEAD = struct.Struct("<qihHHHQ")
"""Stamp, place of the sensor in the rig, place of the sample among those of the sensor, number of the
writer, lengths of place, kind and data."""

Order = tuple[int, int, int]
"""Order of the records of a stretch: stamp [ns], place of the sensor in the rig, place of the
sample among those that the sensor gives at once."""
Record = tuple[Order, int, Piece]
"""Order of a piece, number of its writer, and the piece."""


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
