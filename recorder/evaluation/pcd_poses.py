"""Reads poses from point clouds of PCL, as LIO-SAM and its kin write them: `transformations.pcd`."""

import io
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
    try:
        with path.open("rb") as file:
            return file.read(len(_BEGIN)) == _BEGIN
    except OSError:
        return False


def read_pcd_poses(path: Path) -> Trajectory:
    """Poses of a cloud whose points have x, y, z [m], roll, pitch, yaw [rad] or a quaternion, and a time [s].

    Raises:
        EvaluationError: the file is damaged or compressed, or its points are no poses.
    """
    try:
        head, data = _content(path)
    except (OSError, KeyError, ValueError) as error:
        raise EvaluationError(f"cannot read {path}: a damaged PCD file; save it again") from error
    names = head["FIELDS"]
    time = next((name for name in _TIMES if name in names), None)
    attitude = next((group for group in (_TURNS, _QUAT) if set(group) <= set(names)), None)
    if time is None or attitude is None or not set(_POSITION) <= set(names):
        raise EvaluationError(
            f"{path} is a cloud of points with {', '.join(names)}, not of poses; give LIO-SAM's "
            "transformations.pcd, or a trajectory of times and poses"
        )
    if data is None:
        raise EvaluationError(
            f"{path} is compressed; run: pcl_convert_pcd_ascii_binary {path} poses.pcd 0, and give poses.pcd"
        )
    column = dict(zip(names, data, strict=True))
    turns = np.array([column[name] for name in attitude])
    quat = rpy_to_quat(*turns) if attitude == _TURNS else turns.T
    # In two parts, since a float cannot hold nanoseconds since 1970.
    seconds = np.floor(column[time])
    stamp_ns = seconds.astype(np.int64) * 10**9 + np.round((column[time] - seconds) * 1e9).astype(np.int64)
    return in_order(path, stamp_ns, np.column_stack([column[name] for name in _POSITION]), quat)


def _content(path: Path) -> tuple[dict[str, list[str]], list[Array] | None]:
    """Words of the header by line, and the columns; None: they are compressed."""
    with path.open("rb") as file:
        head: dict[str, list[str]] = {}
        while "DATA" not in head:
            line = file.readline()
            if not line:
                raise ValueError("no DATA")
            word, *words = line.decode("ascii").split() or ["#"]
            head[word] = words
        raw = file.read()
    kind, count = head["DATA"][0], int(head["POINTS"][0])
    if kind == "ascii":
        table = np.loadtxt(io.BytesIO(raw), ndmin=2, dtype=np.float64)
        if table.shape != (count, len(head["FIELDS"])):
            raise ValueError("other columns")
        return head, list(table.T)
    if kind != "binary":
        return head, None
    kinds = zip(head["TYPE"], head["SIZE"], head["COUNT"], strict=True)
    row = np.dtype([(f"f{k}", f"<{_KINDS[t]}{size}", (int(n),)) for k, (t, size, n) in enumerate(kinds)])
    rows = np.frombuffer(raw, row, count)
    return head, [rows[name][:, 0].astype(np.float64) for name in row.names or ()]
