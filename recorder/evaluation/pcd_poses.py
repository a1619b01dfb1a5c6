"""Reads poses from point clouds of PCL, as LIO-SAM and its kin write them: `transformations.pcd`."""

from pathlib import Path

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.transforms import rpy_to_quat
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_checks import in_order

_BEGIN = b"# .PCD"
_POSITION, _TURNS, _QUAT = ("x", "y", "z"), ("roll", "pitch", "yaw"), ("qx", "qy", "qz", "qw")
_TIMES = ("time", "timestamp", "stamp", "t")
_KINDS = {"F": "f", "I": "i", "U": "u"}


def is_pcd(path: Path) -> bool:
    """Whether a file is a point cloud of PCL."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_BEGIN)) == _BEGIN


def read_pcd_poses(path: Path) -> Trajectory:
    """Poses of a cloud whose points have x, y, z [m], roll, pitch, yaw [rad] or a quaternion, and a time [s].

    Raises:
        EvaluationError: the file is damaged or compressed, or its points are no poses.
    """
    try:
        column = _columns(path)
    except (OSError, KeyError, ValueError) as error:
        cure = f"save it by pcl_convert_pcd_ascii_binary {path} poses.pcd 0"
        raise EvaluationError(f"cannot read {path}: {error}; {cure}") from error
    time = next((name for name in _TIMES if name in column), None)
    attitude = next((group for group in (_TURNS, _QUAT) if set(group) <= column.keys()), None)
    if time is None or attitude is None or not set(_POSITION) <= column.keys():
        named = ", ".join(column)
        raise EvaluationError(f"{path} is a cloud of points with {named}, not of poses; give a trajectory")
    turns = np.array([column[name] for name in attitude])
    quat = rpy_to_quat(*turns) if attitude == _TURNS else turns.T
    # In two parts, since a float cannot hold nanoseconds since 1970.
    seconds = np.floor(column[time])
    stamp_ns = seconds.astype(np.int64) * 10**9 + np.round((column[time] - seconds) * 1e9).astype(np.int64)
    return in_order(path, stamp_ns, np.column_stack([column[name] for name in _POSITION]), quat)


def _columns(path: Path) -> dict[str, Array]:
    """Values of all points by the names of the fields."""
    with path.open("rb") as file:
        head: dict[str, list[str]] = {}
        while "DATA" not in head and (line := file.readline().decode("ascii")):
            word, *words = line.split() or ["#"]
            head[word] = words
        raw = file.read()
    names, count = head["FIELDS"], int(head["POINTS"][0])
    if head["DATA"] == ["ascii"]:
        table = np.array(raw.split(), dtype=np.float64).reshape(count, len(names))
        return dict(zip(names, table.T, strict=True))
    if head["DATA"] != ["binary"]:
        raise ValueError("its points are compressed")
    kinds = zip(names, head["TYPE"], head["SIZE"], head["COUNT"], strict=True)
    row = np.dtype([(name, f"<{_KINDS[kind]}{size}", (int(many),)) for name, kind, size, many in kinds])
    rows = np.frombuffer(raw, row, count)
    return {name: rows[name][:, 0].astype(np.float64) for name in names}
