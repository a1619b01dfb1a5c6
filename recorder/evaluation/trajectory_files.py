"""Files of trajectories: TUM, KITTI, EuRoC's table and bags, told apart by what they hold."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from itertools import takewhile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_write import atomic_write
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.core.geometry.transforms import matrix_to_quat
from recorder.evaluation.trajectory import Trajectory, in_order

_NANOSECONDS_FROM = 10**14
"""Larger stamps are nanoseconds: as seconds they would lie three million years ahead."""
_LONG_BYTES = 500_000
"""Shorter files are not worth the loading of Arrow."""
_POSE = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


def read_trajectory(path: str | Path, *, times: Path | None = None, topic: str | None = None) -> Trajectory:
    """Read a trajectory of any known kind.

    Args:
        path: TUM ("time tx ty tz qx qy qz qw"), KITTI (twelve numbers a line), EuRoC
            ("ns, px, py, pz, qw, qx, qy, qz, …"), or a ROS 1 or ROS 2 bag.
        times: Times [s] of KITTI's poses, one a line; None: ``times.txt`` beside the file.
        topic: Topic of a bag; None: its only one with poses.

    Raises:
        EvaluationError: the file is missing, damaged or of no such kind.
    """
    path = Path(path)
    if path.is_dir() or path.suffix in (".bag", ".mcap", ".db3"):
        from recorder.evaluation.trajectory_bags import read_bag

        return read_bag(path, topic)
    if path.suffix != ".csv" and (regular := _long_tum(path)) is not None:
        return regular
    rows = _rows(path)
    count = len(rows[0][1])
    if count == 12:
        return _kitti(path, rows, times)
    return _poses(path, rows, w_first=count != 8 or path.suffix == ".csv")


def read_tum(path: str | Path) -> Trajectory:
    """Read "time tx ty tz qx qy qz qw" lines; lines that begin with # are comments.

    Stamps are read exactly; seconds, and the nanoseconds that ORB-SLAM3 writes, are told apart by size.
    Lines out of order are sorted, with a warning.

    Raises:
        EvaluationError: the file is missing or a line is not such a line.
    """
    path = Path(path)
    regular = _long_tum(path)
    return regular if regular is not None else _poses(path, _rows(path), w_first=False)


def _long_tum(path: Path) -> Trajectory | None:
    """A long TUM file, by Arrow's reader, twenty times as fast as ours and as exact.

    Returns:
        None: the file is short, Arrow is not installed, or not every line is eight numbers with one blank
        between them and a time in seconds with at most nine decimals.
    """
    try:
        if path.stat().st_size < _LONG_BYTES:
            return None
        from pyarrow import csv, decimal128, float64

        with path.open("rb") as file:
            comments = sum(1 for _ in takewhile(lambda line: line.startswith(b"#"), file))
        types = {"time": decimal128(28, 9), **dict.fromkeys(_POSE, float64())}
        table = csv.read_csv(
            path,
            read_options=csv.ReadOptions(column_names=list(types), skip_rows=comments),
            parse_options=csv.ParseOptions(delimiter=" "),
            convert_options=csv.ConvertOptions(column_types=types, null_values=[]),
        )
    except (ImportError, OSError, ValueError):
        return None
    # A decimal is an integer of 128 bits: low half, high half.
    low, high = np.frombuffer(table["time"].combine_chunks().buffers()[1], dtype=np.int64).reshape(-1, 2).T
    if high.any() or (low < 0).any():
        return None
    pose = np.stack([table[name].to_numpy() for name in _POSE], axis=1)
    return in_order(path, low.copy(), pose[:, :3], pose[:, 3:])


Row = tuple[int, list[str]]
"""Number of a line, and its words."""


def _rows(path: Path) -> list[Row]:
    text = read_text(path, "trajectory", EvaluationError)
    split = [
        (number, line.replace(",", " ").split()) for number, line in enumerate(text.splitlines(), start=1)
    ]
    rows = [(number, words) for number, words in split if words and not words[0].startswith("#")]
    if not rows:
        raise EvaluationError(f"{path} holds no pose")
    return rows


def _poses(path: Path, rows: Sequence[Row], *, w_first: bool) -> Trajectory:
    form = "time tx ty tz " + ("qw qx qy qz" if w_first else "qx qy qz qw")
    stamps: list[int] = []
    values: list[list[float]] = []
    for number, words in rows:
        try:
            stamps.append(_nanoseconds(words[0]))
            values.append([float(word) for word in words[1:8]])
        except (ValueError, InvalidOperation, OverflowError):
            values.append([])
        if len(values[-1]) != 7 or (not w_first and len(words) != 8):
            raise EvaluationError(f"{path} line {number} is not '{form}'; give a TUM, KITTI or EuRoC file")
    table = np.array(values)
    quat = table[:, [4, 5, 6, 3]] if w_first else table[:, 3:]
    return in_order(path, np.array(stamps, dtype=np.int64), table[:, :3], quat)


def _kitti(path: Path, rows: Sequence[Row], times: Path | None) -> Trajectory:
    times = times or path.with_name("times.txt")
    if not times.exists():
        raise EvaluationError(f"{path} has KITTI's poses, which have no times; give --times times.txt")
    try:
        stamps = [_nanoseconds(words[0]) for _, words in _rows(times)]
        matrices = np.array([[float(word) for word in words] for _, words in rows])
    except (ValueError, InvalidOperation, OverflowError) as error:
        raise EvaluationError(f"{path}: {error}; give twelve numbers a line") from error
    if len(stamps) != len(rows) or matrices.shape != (len(rows), 12):
        raise EvaluationError(f"{path} has {len(rows)} poses, {times} {len(stamps)} times; give equally many")
    matrices = matrices.reshape(-1, 3, 4)
    R = matrices[:, :, :3]
    if not np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=0.01):
        raise EvaluationError(f"{path} holds a matrix that is no rotation; give KITTI's poses")
    return in_order(path, np.array(stamps, dtype=np.int64), matrices[:, :, 3], matrix_to_quat(R))


def tum_text(unix_ns: NDArray[np.int64], position_m: Array, quat_xyzw: Array) -> str:
    """A TUM file: stamps [ns] (N,), positions [m] (N, 3), quaternions (N, 4); all read back exactly."""
    rows = zip(unix_ns.tolist(), position_m.tolist(), quat_xyzw.tolist(), strict=True)
    lines = [
        f"{stamp // 10**9}.{stamp % 10**9:09d} " + " ".join(repr(value) for value in (*position, *quat))
        for stamp, position, quat in rows
    ]
    return "\n".join(["# timestamp tx ty tz qx qy qz qw", *lines]) + "\n"


def write_tum(path: str | Path, trajectory: Trajectory) -> Path:
    """Write a trajectory as "time tx ty tz qx qy qz qw" lines; an older file is replaced.

    Raises:
        EvaluationError: the file cannot be written.
    """
    path = Path(path)
    text = tum_text(trajectory.stamp_ns, trajectory.position_m, trajectory.quat_xyzw)
    with atomic_write(path, EvaluationError) as part:
        part.write_text(text, encoding="utf-8")
    return path


def _nanoseconds(text: str) -> int:
    value = Decimal(text)
    stamp_ns = round(value if abs(value) >= _NANOSECONDS_FROM else value * 1_000_000_000)
    if not -(2**63) <= stamp_ns < 2**63:
        raise OverflowError(f"{text} is no time")
    return stamp_ns
