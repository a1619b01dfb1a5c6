"""Samples as they are: PNG, PLY and npz in a folder per stream, for programs that know no robotics.

Small and frequent samples are a table per stream, ``imu.npz``. File names are stamps; arrays have the names
and units of `carlaloc_env.samples`.
"""

import ast
import io
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples import (
    GnssFix,
    Image,
    Imu,
    Odometry,
    PointCloud,
    Sample,
    SemanticImage,
    Speed,
    WheelTicks,
)
from recorder.writers.base import Encoder, Piece, Writer, png_of
from recorder.writers.formats.ply import ply_bytes

TABLES = (Imu, GnssFix, Speed, WheelTicks, Odometry)
"""Samples that are rows of a table."""


class RawEncoder(Encoder):
    """Files and rows of tables of samples as they are."""

    def encode(self, sample: Sample) -> list[Piece]:
        """Files of a sample, or a row of its stream's table."""
        name, stamp_ns = sample.sensor, sample.stamp_ns
        if isinstance(sample, TABLES):
            row = _row(sample)
            return [Piece(stamp_ns, name, repr(row.dtype.descr), row.tobytes())]
        if isinstance(sample, Image):
            png = png_of(cv2.cvtColor(sample.rgb, cv2.COLOR_RGB2BGR), name)
            return [Piece(stamp_ns, name, ".png", png)]
        if isinstance(sample, SemanticImage):
            instances = _npz({"instance": sample.instance})
            return [
                Piece(stamp_ns, name, ".png", png_of(sample.tag, name)),
                Piece(stamp_ns, name, ".instance.npz", instances),
            ]
        if isinstance(sample, PointCloud):
            return [Piece(stamp_ns, name, ".ply", _ply(sample))]
        return [Piece(stamp_ns, name, ".npz", _npz(_arrays(sample)))]


class RawWriter(Writer):
    """All samples of a sequence in a folder.

    Files are ``rgb_left/%d.png``, ``semantic_left/%d.png`` (tags) and ``%d.instance.npz``,
    ``depth_left/%d.npz`` …, ``lidar/%d.ply``, ``events_left/%d.npz``, and a table per stream of
    small samples.
    """

    def _begin(self, part: Path) -> None:
        part.mkdir(parents=True)
        self._rows: dict[str, np.dtype[Any]] = {}

    def _place(self, piece: Piece) -> None:
        if piece.kind.startswith("."):
            folder = self._part / piece.place
            folder.mkdir(exist_ok=True)
            (folder / f"{self.encoder.unix_ns(piece.stamp_ns)}{piece.kind}").write_bytes(piece.data)
            return
        if piece.place not in self._files:
            self._files[piece.place] = (self._part / f".{piece.place}.rows").open("w+b")
            self._rows[piece.place] = np.dtype(ast.literal_eval(piece.kind))
        self._files[piece.place].write(piece.data)

    def _finish(self) -> None:
        for name, file in self._files.items():
            dtype = self._rows[name]
            file.flush()
            file.seek(0)
            rows = np.fromfile(file, dtype)
            stamps = self.encoder.epoch_ns + rows["stamp_ns"]
            columns = {column: rows[column] for column in dtype.names or () if column != "stamp_ns"}
            (self._part / f"{name}.npz").write_bytes(_npz({"stamp_ns": stamps, **columns}))
            file.close()
            (self._part / f".{name}.rows").unlink()


def _row(sample: Sample) -> NDArray[np.void]:
    """A structured row of the stamp and all numbers of a sample; texts have 16 letters."""
    values = {"stamp_ns": np.asarray(np.int64(sample.stamp_ns)), **_arrays(sample)}
    values = {
        name: value.astype("U16") if value.dtype.kind == "U" else value for name, value in values.items()
    }
    row = np.zeros((), [(name, value.dtype.str, value.shape) for name, value in values.items()])
    for name, value in values.items():
        row[name] = value
    return row


def _arrays(sample: Sample) -> dict[str, NDArray[Any]]:
    """All fields of a sample that have a value, but for its name and stamp, which the path has."""
    values = {field.name: getattr(sample, field.name) for field in fields(sample)}
    return {
        name: np.asarray(value)
        for name, value in values.items()
        if name not in ("sensor", "frame_id", "stamp_ns") and value is not None
    }


def _npz(arrays: dict[str, NDArray[Any]]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def _ply(sample: PointCloud) -> bytes:
    """Binary PLY: position [m], intensity, ring, time after the sweep's beginning [ns], Doppler, labels."""
    columns: list[tuple[str, str, NDArray[Any]]] = [
        *((axis, "<f4", sample.points_xyz_m[:, k]) for k, axis in enumerate("xyz")),
        ("intensity", "<f4", sample.intensity),
        ("ring", "<u2", sample.ring),
        ("offset_ns", "<i4", sample.offset_ns),
    ]
    if sample.doppler_mps is not None:
        columns.append(("doppler_mps", "<f4", sample.doppler_mps))
    if sample.tag is not None:
        columns.append(("tag", "|u1", sample.tag))
    if sample.instance is not None:
        columns.append(("instance", "<i4", sample.instance))
    return ply_bytes(columns)
