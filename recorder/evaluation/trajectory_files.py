"""Files of trajectories as text: TUM, EuRoC's table, KITTI's matrices and tables with named columns."""

import logging
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError, unknown_name
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.core.transforms import rpy_to_quat
from recorder.evaluation.covariance_files import stamped_lines
from recorder.evaluation.pose_columns import PoseColumns, columns_by_name, columns_by_place, has_units
from recorder.evaluation.pose_matrices import matrix_place, poses_of
from recorder.evaluation.quaternion_order import WXYZ, XYZW, as_xyzw, order_by_motion
from recorder.evaluation.stamp_units import DECIMALS, FRAMES_MAX, has_frame_numbers, unit_of_stamps
from recorder.evaluation.text_tables import TextTable, read_table
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_checks import in_order

_TUM = PoseColumns(
    stamp=0, position=(1, 2, 3), attitude=(4, 5, 6, 7), form="time tx ty tz qx qy qz qw", order=XYZW
)
_EUROC_COLUMNS = 17
_UNIT_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_LOG = logging.getLogger(__name__)


def read_text_trajectory(
    path: str | Path,
    *,
    times: Path | None = None,
    quaternion: str | None = None,
    time_unit: str | None = None,
) -> Trajectory:
    """Read a trajectory from a text file, of whatever columns.

    A header's names decide which column is what. Without one, rows are a time, a position and a quaternion, a
    running number perhaps before them, or KITTI's matrices. What the file leaves open is taken as it is
    likeliest, with a warning.

    Args:
        path: The file.
        times: Times of frames, one a line, where a file has their numbers, or KITTI's poses; None: of these
            ``times.txt`` beside the file.
        quaternion: ``xyzw`` or ``wxyz``, where no header names them; None: by form and motion.
        time_unit: ``s``, ``ms``, ``us`` or ``ns``; None: by the header, else by size.

    Raises:
        EvaluationError: the file is missing, damaged or of no such kind.
    """
    for kind, given, words in (("quaternion", quaternion, (XYZW, WXYZ)), ("time unit", time_unit, DECIMALS)):
        if given is not None and given not in words:
            raise EvaluationError(unknown_name(kind, given, words))
    table = read_table(Path(path))
    columns = _named(table)
    if columns is None:
        begin = matrix_place(table.sample)
        named = _by_first_names(table)
        if begin is None and named is None and table.count == 12 and not has_units(table.sample[:, 4:8]):
            begin = 0
        if begin is not None:
            return _matrices(table, begin, times, time_unit)
        columns = columns_by_place(table.sample)
        if columns is None or not has_units(table.sample[:, columns.attitude]):
            columns = named or columns
    if columns is None:
        raise EvaluationError(
            f"{table.path} line {table.begin + 1} is not '{_TUM.form}'; give a TUM, KITTI or EuRoC file, or "
            "name the columns in a header"
        )
    if columns.note:
        _LOG.warning("%s: %s", table.path, columns.note)
    return _poses(table, columns, quaternion, time_unit, times)


def read_tum(path: str | Path) -> Trajectory:
    """Read "time tx ty tz qx qy qz qw" lines; lines that begin with # are comments.

    Stamps are read exactly; seconds, and the nanoseconds that ORB-SLAM3 writes, are distinguished by size.
    Lines out of order are sorted, with a warning.

    Raises:
        EvaluationError: the file is missing or a line is not such a line.
    """
    table = read_table(Path(path))
    if table.count != 8 or table.title is not None:
        raise EvaluationError(
            f"{path} line {table.begin + 1} is not '{_TUM.form}'; give a TUM, KITTI or EuRoC file"
        )
    return _poses(table, _TUM, None, None)


def _named(table: TextTable) -> PoseColumns | None:
    """Columns by the names of a header; None: there is none, or it is a comment of other things."""
    columns = None if table.names is None else columns_by_name(table.names, table.sample)
    # Of a comment, a name for each part is needed to believe that it is a header of many columns.
    if isinstance(columns, PoseColumns) and (columns.attitude or table.title or table.count < 8):
        return columns
    if table.title is None:
        return None
    lacking = f"names no {columns}" if columns else f"has not the {table.count} columns of its rows"
    raise EvaluationError(
        f"{table.path}: its header '{table.title}' {lacking}; name columns time, x, y, z, qx, qy, qz, qw"
    )


def _by_first_names(table: TextTable) -> PoseColumns | None:
    """Columns by a header of OpenVINS, or one that names the first columns alone; None: there is none."""
    columns = columns_by_name(
        (*table.first_names, *[""] * (table.count - len(table.first_names))), table.sample
    )
    if isinstance(columns, str) or not has_units(table.sample[:, columns.attitude]):
        return None
    count = len(table.first_names)
    is_short = "px" not in table.first_names
    return replace(columns, note=f"its header has {count} names, {table.count} columns" if is_short else None)


def _poses(
    table: TextTable,
    columns: PoseColumns,
    quaternion: str | None,
    time_unit: str | None,
    times: Path | None = None,
) -> Trajectory:
    unit = time_unit or _unit(table, columns.stamp, columns.time_unit)
    stamps, pose = table.read(
        (*columns.position, *columns.attitude),
        columns.form,
        stamp=columns.stamp,
        decimals=DECIMALS[unit],
        nanosecond=columns.nanosecond,
    )
    if times is not None and has_frame_numbers(stamps):
        stamps = _times(table.path, times, None, stamps // 10**9)
    position_m, attitude = pose[:, :3], pose[:, 3:]
    if not columns.attitude:
        return in_order(table.path, stamps, position_m, None, _line_of(table))
    if quaternion is not None and quaternion != (columns.order or quaternion):
        _LOG.warning("%s: its header names the order of quaternions; --quaternion is not applied", table.path)
    if columns.order == "rpy":
        quat = _from_turns(table.path, attitude, columns.angle_unit)
    else:
        order = columns.order or quaternion or _order(table, unit, position_m, attitude)
        quat = as_xyzw(attitude, order)
    return in_order(table.path, stamps, position_m, quat, _line_of(table))


def _line_of(table: TextTable) -> Callable[[int], str]:
    """Places of a table's rows in its file."""
    return lambda row: f"line {next(islice(table.rows(), row, None))[0]}"


def _unit(table: TextTable, stamp: int, named: str | None) -> str:
    unit = unit_of_stamps(table.sample[:, stamp], named)
    if unit != (named or "s"):
        _LOG.warning(
            "%s: stamps are read as %s, by their size; --time-unit sets it", table.path, _UNIT_NAMES[unit]
        )
    return unit


def _order(table: TextTable, unit: str, position_m: Array, quat: Array) -> str:
    """Order of quaternions that nothing names: that of the form, unless the motion shows the other one."""
    commas = table.separator in (",", ";", ", ")
    euroc = commas and (unit == "ns" or table.count == _EUROC_COLUMNS)
    tum = not commas
    by_form = WXYZ if euroc else XYZW
    by_motion = order_by_motion(position_m, quat)
    order = by_motion or by_form
    if not (tum or euroc) or order != by_form:
        why = "the body then moves in one direction of its own" if by_motion else "the motion shows no order"
        _LOG.warning(
            "%s: quaternions are read as %s, since %s; --quaternion sets it", table.path, " ".join(order), why
        )
    return order


def _from_turns(path: Path, turns: Array, unit: str | None) -> Array:
    if unit not in ("deg", "rad"):
        unit = "deg" if np.nanmax(np.abs(turns), initial=0.0) > 2.1 * np.pi else "rad"
        _LOG.warning(
            "%s: roll, pitch and yaw are read as %s, by their size, and as Rz(yaw) Ry(pitch) Rx(roll); name "
            "them yaw_deg or yaw_rad in the header", path, "degrees" if unit == "deg" else "radians",
        )  # fmt: skip
    return rpy_to_quat(*(np.radians(turns) if unit == "deg" else turns).T)


def _matrices(table: TextTable, begin: int, times: Path | None, time_unit: str | None) -> Trajectory:
    form = "r11 r12 r13 tx r21 … tz"
    lead = table.sample[:, 0]
    if begin and not (np.all(lead == np.round(lead)) and np.max(np.abs(lead)) < FRAMES_MAX):
        unit = time_unit or _unit(table, 0, None)
        stamps, rows = table.read(range(1, 13), f"time {form}", stamp=0, decimals=DECIMALS[unit])
    else:
        frames, rows = table.read(range(begin, begin + 12), form, stamp=0 if begin else None)
        stamps = _times(table.path, times, time_unit, frames if begin else np.arange(len(rows)))
    poses = poses_of(table.path, rows.reshape(-1, 3, 4))
    return in_order(table.path, stamps, *poses, _line_of(table))


def _times(
    path: Path, times: Path | None, time_unit: str | None, frames: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Times [ns] of frames, from a file that has one for each."""
    beside = times or path.with_name("times.txt")
    if not beside.exists():
        raise EvaluationError(f"{path} has KITTI's poses, which have no times; give --times times.txt")
    table = read_table(beside)
    unit = time_unit or _unit(table, 0, None)
    stamps, _ = table.read((), "a time", stamp=0, decimals=DECIMALS[unit])
    every = np.array_equal(frames, np.arange(len(frames)))
    if (every and len(stamps) != len(frames)) or frames.min() < 0 or frames.max() >= len(stamps):
        raise EvaluationError(
            f"{path} has {len(frames)} poses, {beside} {len(stamps)} times; give equally many"
        )
    return stamps[frames]


def tum_text(unix_ns: NDArray[np.int64], position_m: Array, quat_xyzw: Array) -> str:
    """A TUM file: stamps [ns] (N,), positions [m] (N, 3), quaternions (N, 4); all read back exactly."""
    lines = stamped_lines(unix_ns, np.hstack([position_m, quat_xyzw]))
    return "\n".join(["# timestamp tx ty tz qx qy qz qw", *lines]) + "\n"


def write_tum(path: str | Path, trajectory: Trajectory) -> Path:
    """Write a trajectory as "time tx ty tz qx qy qz qw" lines; an older file is replaced.

    Raises:
        EvaluationError: the file cannot be written.
    """
    path = Path(path)
    text = tum_text(trajectory.stamp_ns, trajectory.position_m, trajectory.quat_xyzw)
    return write_whole(path, text, EvaluationError)
