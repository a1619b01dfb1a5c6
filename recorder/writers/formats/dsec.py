"""Events in the layout of the DSEC data set (dsec.ifi.uzh.ch/data-format): one HDF5 file per camera.

Times are µs after ``t_offset``; ``ms_to_idx[m]`` is the first event that is not earlier than m milliseconds.
"""

import io
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import EVENT, Events, Sample
from recorder.writers.base import Encoder, Piece, Writer

RECTIFY_MAP = "rectify_map.h5"
"""Name of the file with the map."""
_CHUNK = 1 << 18
"""Events in each compressed chunk of the file."""
_COLUMNS = {"t": "<u4", "x": "<u2", "y": "<u2", "p": "|u1"}


class DsecEncoder(Encoder):
    """Events of one stream.

    Args:
        stream: Name of the event stream; other samples are passed over.
    """

    def __init__(self, stream: str) -> None:
        self._stream = stream

    def encode(self, sample: Sample) -> list[Piece]:
        """Events of a sample of this stream, after three numbers: width, height, period."""
        if not isinstance(sample, Events) or sample.sensor != self._stream:
            return []
        about = np.array([sample.width_px, sample.height_px, sample.period_ns], "<i8")
        return [Piece(sample.stamp_ns, "events", "", about.tobytes() + sample.events.tobytes())]


class DsecWriter(Writer):
    """One event stream in one ``.h5`` file, with ``rectify_map.h5`` beside it, which DSEC's loader opens.

    That map gives the place of each raw pixel in the rectified picture. Ours are rectified as they come, so
    that it is the identity; a lens stands in the calibration files.

    Args:
        target: File name, ending in ``.h5``.
        encoder: Of the event stream.
        compression: ``gzip``, which every HDF5 program reads, or ``lzf``, five times as fast.
    """

    def __init__(self, target: str | Path, encoder: DsecEncoder, *, compression: str = "gzip") -> None:
        super().__init__(target, encoder)
        self._filter: dict[str, Any] = {"compression": compression, "shuffle": True}
        if compression == "gzip":
            self._filter["compression_opts"] = 1
        self._begin_ns: int | None = None
        self._count = 0
        self._ms_to_idx: list[np.ndarray[Any, np.dtype[np.uint64]]] = []
        self._next_ms = 0

    def _begin(self, part: Path) -> None:
        self._disk = _DiskFile(part)
        self._file = h5py.File(self._disk, "w")
        for name, kind in _COLUMNS.items():
            self._file.create_dataset(
                f"events/{name}", (0,), kind, maxshape=(None,), chunks=(_CHUNK,), **self._filter
            )

    def _place(self, piece: Piece) -> None:
        width_px, height_px, period_ns = np.frombuffer(piece.data, "<i8", 3).tolist()
        events = np.frombuffer(piece.data, EVENT, offset=24)
        if self._begin_ns is None:
            self._begin_ns = piece.stamp_ns - (period_ns if len(events) else 0)
            self._file.attrs["width"], self._file.attrs["height"] = width_px, height_px
        t_us = (events["t"] - self._begin_ns) // 1000
        rows = {"t": t_us, **{name: events[name] for name in "xyp"}}
        end = self._count + len(t_us)
        for name, values in rows.items():
            column = self._file[f"events/{name}"]
            column.resize((end,))
            column[self._count :] = values.astype(_COLUMNS[name])
        # Milliseconds that end with this period; later events cannot be earlier.
        end_ms = (piece.stamp_ns - self._begin_ns) // 1_000_000
        edges_us = 1000 * np.arange(self._next_ms, end_ms + 1)
        self._ms_to_idx.append((self._count + np.searchsorted(t_us, edges_us)).astype("<u8"))
        self._next_ms, self._count = max(end_ms + 1, self._next_ms), end
        self._disk.raise_failure()

    def _finish(self) -> None:
        begin_ns = self.encoder.unix_ns(self._begin_ns or 0)
        self._file["t_offset"] = np.int64(begin_ns // 1000)
        self._file["ms_to_idx"] = np.concatenate([np.zeros(0, "<u8"), *self._ms_to_idx])
        self._close()
        self._disk.raise_failure()

    def close(self) -> None:
        """Complete the file, and write the map beside it."""
        shape = (
            tuple(int(self._file.attrs.get(side, 0)) for side in ("height", "width")) if self._is_open else ()
        )
        super().close()
        path = self.target.with_name(RECTIFY_MAP)
        if not shape or path.exists():
            return
        v, u = np.indices(shape, dtype="<f4")
        try:
            disk = _DiskFile(path)
            with h5py.File(disk, "w") as file:
                file.create_dataset("rectify_map", data=np.stack([u, v], axis=-1), compression="gzip")
            disk.close()
            disk.raise_failure()
        except OSError as error:
            path.unlink(missing_ok=True)
            self.target.unlink(missing_ok=True)
            raise WriterError(f"cannot write {path}: {error.strerror}") from error

    def _drop(self) -> None:
        self._close()

    def _close(self) -> None:
        self._file.close()
        self._disk.close()


class _DiskFile(io.FileIO):
    """A file that keeps the failure of a write for later.

    HDF5 crashes the process when a write fails while it closes a file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all bytes, or none after a failure."""
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while len(rest) and self._failure is None:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self._failure = error
        return size

    def raise_failure(self) -> None:
        """Raise the error of a failed write.

        Raises:
            OSError: the disk is full, or worse.
        """
        if self._failure is not None:
            raise self._failure
