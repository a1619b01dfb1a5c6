"""Encoders, which make pieces of samples, and writers, which put pieces into a file that is whole or absent.

An encoder remembers nothing, so that stretches of a drive can be encoded on any machine and in any order.
A writer takes the pieces of its encoder in the order of their stamps.
"""

from __future__ import annotations

import sqlite3
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.files.atomic_files import (
    check_room,
    part_path,
    remove,
    write_whole,
)
from carlaloc_env.samples import Image, Sample

DEFAULT_EPOCH_NS = 1_672_531_200_000_000_000
"""Unix time given to the beginning of a drive [ns]: 2023-01-01T00:00:00Z.

It is fixed so that the same drive always gives the same bytes, and far from 0, which ROS reads as
"no time".
"""


PNG_RUN_LENGTHS = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
"""Run lengths only: a noisy 1280×720 image takes 13 ms and 507 kB, by default 17 ms and 569 kB."""
_FAILURES = (OSError, sqlite3.Error)
"""Exceptions that libraries raise when a disk is full."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A sample, or a part of it, as a format stores it."""

    stamp_ns: int
    """Stamp of the sample [ns]."""
    place: str
    """Destination in the output: a topic, a table or a file, named by the format."""
    kind: str
    """Type of the content where the place does not imply it, e.g. a type of message."""
    data: bytes
    """Content, encoded for the file."""


class Encoder(ABC):
    """Makes pieces of samples for one format; it touches no file."""

    epoch_ns = DEFAULT_EPOCH_NS
    """Unix time of the drive's beginning [ns]."""

    @abstractmethod
    def encode(self, sample: Sample) -> list[Piece]:
        """Pieces of a sample; none of a kind that the format does not hold.

        They depend on the sample alone, never on earlier samples.

        Raises:
            WriterError: the sample does not fit the calibration.
        """

    def unix_ns(self, stamp_ns: int) -> int:
        """Time of a stamp in the written files [ns since 1970]."""
        return self.epoch_ns + stamp_ns


class Writer(ABC):
    """Puts pieces into a file or folder under a temporary name, which takes the final one when closed.

    As a context manager it closes at the end of the block; an exception inside removes the unfinished
    output.

    Args:
        target: The file or folder.
        encoder: Makes the pieces.
    """

    def __init__(self, target: str | Path, encoder: Encoder) -> None:
        self.target = Path(target)
        self.encoder = encoder
        self._part = part_path(self.target)
        self._is_open = False
        self._last_ns: int | None = None
        self._files: dict[str, IO[Any]] = {}

    def __enter__(self) -> Writer:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abort()

    def open(self) -> None:
        """Start writing.

        Raises:
            WriterError: the target exists or cannot be created.
        """
        if self.target.exists():
            raise WriterError(f"{self.target} exists; choose another folder or delete it first")
        try:
            self.target.parent.mkdir(parents=True, exist_ok=True)
            remove(self._part)
            self._begin(self._part)
        except _FAILURES as error:
            remove(self._part)
            raise WriterError(f"cannot write {self.target}: {_reason(error)}") from error
        self._is_open = True

    def write(self, sample: Sample) -> None:
        """Add a sample; stamps never go back.

        Raises:
            WriterError: the writer is closed, the stamp is older than the previous one, or the disk is full.
        """
        self._check(sample.stamp_ns, sample.sensor)
        for piece in self.encoder.encode(sample):
            self.place(piece)

    def place(self, piece: Piece) -> None:
        """Add a piece of an encoder with the same settings; stamps never go back.

        Raises:
            WriterError: the writer is closed, the stamp is older than the previous one, or the disk is full.
        """
        self._check(piece.stamp_ns, piece.place)
        self._last_ns = piece.stamp_ns
        try:
            self._place(piece)
        except _FAILURES as error:
            raise WriterError(f"cannot write {self.target}: {_reason(error)}") from error

    def _check(self, stamp_ns: int, name: str) -> None:
        if not self._is_open:
            raise WriterError(f"{self.target} is not open; call open() before write()")
        if self._last_ns is not None and stamp_ns < self._last_ns:
            raise WriterError(
                f"{self.target}: {name} at {stamp_ns} ns comes after {self._last_ns} ns; "
                "write samples in the order of their stamps"
            )

    def close(self) -> None:
        """Complete the target and give it its final name; a second call does nothing.

        Raises:
            WriterError: the disk is full.
        """
        if not self._is_open:
            return
        try:
            self._finish()
            check_room(self.target)
            self._part.rename(self.target)
        except _FAILURES as error:
            self.abort()
            raise WriterError(f"cannot complete {self.target}: {_reason(error)}") from error
        self._is_open = False

    def abort(self) -> None:
        """Stop and remove the unfinished output."""
        if self._is_open:
            self._is_open = False
            self._drop()
            remove(self._part)

    @abstractmethod
    def _begin(self, part: Path) -> None:
        """Create the file or folder `part`."""

    @abstractmethod
    def _place(self, piece: Piece) -> None:
        """Put one piece into the file."""

    def _finish(self) -> None:
        """Write the end of the file and close all files: here those of `_files`."""
        for file in self._files.values():
            file.close()

    def _drop(self) -> None:
        """Close all files without completing them, even on a full disk: here those of `_files`."""
        close_unfinished(self._files.values())


def close_unfinished(files: Iterable[IO[Any]]) -> None:
    """Close files that are discarded; errors of a full disk are ignored."""
    for file in files:
        with suppress(OSError):
            file.close()


def _reason(error: Exception) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)


def write_text(path: str | Path, text: str) -> Path:
    """Write a small new file, whole or not at all.

    Raises:
        WriterError: the file exists or cannot be written.
    """
    path = Path(path)
    if path.exists():
        raise WriterError(f"{path} exists; choose another folder or delete it first")
    return write_whole(path, text, WriterError)


def png_of(pixels: NDArray[Any], name: str, options: Sequence[int] = PNG_RUN_LENGTHS) -> bytes:
    """An image as PNG.

    Args:
        pixels: Grey or BGR, 8 or 16 bits.
        name: Name of the image in errors.
        options: Pairs of OpenCV's settings and their values.

    Raises:
        WriterError: OpenCV cannot encode it.
    """
    return _encoded(".png", pixels, name, options)


def jpeg_of(rgb: NDArray[np.uint8], name: str, quality: int) -> bytes:
    """A colour image as JPEG.

    Args:
        rgb: Red, green, blue, shape (H, W, 3).
        name: Name of the image in errors.
        quality: 0–100.

    Raises:
        WriterError: OpenCV cannot encode it.
    """
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    return _encoded(".jpg", bgr, name, (cv2.IMWRITE_JPEG_QUALITY, quality))


def _encoded(suffix: str, pixels: NDArray[Any], name: str, options: Sequence[int]) -> bytes:
    done, data = cv2.imencode(suffix, pixels, options)
    if not done:
        raise WriterError(f"OpenCV cannot write {name}; install opencv-python-headless again")
    return data.tobytes()


def grey(sample: Image) -> NDArray[np.uint8]:
    """Brightness 0–255 of an image (ITU-R BT.601), shape (H, W)."""
    return cast(NDArray[np.uint8], cv2.cvtColor(sample.rgb, cv2.COLOR_RGB2GRAY))
