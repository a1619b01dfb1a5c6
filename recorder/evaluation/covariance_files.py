"""Reads and writes covariances of poses as text beside a trajectory, in the form that smfeval reads as well.

A row has the stamp [s] and the lower triangle of a 6×6 matrix: the covariance of ξ = (x, y, z [m], rotation
[rad]) in T_estimate = T_true · exp(ξ), in the axes of the frame whose pose it is.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.core.files.text_files import read_text
from recorder.evaluation.trajectory import Trajectory

SUFFIX = ".cov"
"""Suffix of the file, in place of the trajectory's own."""
_HEADER = {"#%TANGENT_CONVENTION": "right_perturbation", "#%TANGENT_ORDER": "translation_rotation"}
_ROWS, _COLUMNS = np.tril_indices(6)
_STAMP_NS = 1_000
"""Stamps of a pose and its covariance may differ so much, by rounding [ns]."""


def write_covariances(path: Path, trajectory: Trajectory, covariance: Array) -> Path:
    """Write the covariances of a trajectory's poses; an older file is replaced.

    Args:
        path: The trajectory's file, or the file itself.
        trajectory: The poses.
        covariance: Their covariances, shape (N, 6, 6).

    Raises:
        EvaluationError: the file cannot be written.
    """
    lines = stamped_lines(trajectory.stamp_ns, covariance[:, _ROWS, _COLUMNS])
    head = [f"{key} {word}" for key, word in _HEADER.items()]
    text = "\n".join([*head, "# timestamp c11 c21 c22 c31 … c66", *lines]) + "\n"
    return write_whole(path.with_suffix(SUFFIX), text, EvaluationError)


def stamped_lines(stamp_ns: NDArray[np.int64], values: Array) -> list[str]:
    """Lines of stamps [ns], shape (N,), in seconds, and numbers, shape (N, M); all are read back exactly."""
    return [
        f"{stamp // 10**9}.{stamp % 10**9:09d} " + " ".join(map(repr, row))
        for stamp, row in zip(stamp_ns.tolist(), values.tolist(), strict=True)
    ]


def read_covariances(path: Path, trajectory: Trajectory) -> Array | None:
    """Covariances of a trajectory's poses, shape (N, 6, 6); None: there is no such file.

    Args:
        path: The trajectory's file, or the file itself.
        trajectory: The poses.

    Raises:
        EvaluationError: the file is damaged, has another convention, or its rows are not those of the poses.
    """
    path = path.with_suffix(SUFFIX)
    if not path.exists():
        return None
    rows = []
    lines = read_text(path, "covariances", EvaluationError).splitlines()
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and words[0] in _HEADER and words[1:] != [_HEADER[words[0]]]:
            raise EvaluationError(f"{path}: '{line}' is not read; write {_HEADER[words[0]]}")
        if words and not line.startswith("#"):
            rows.append(_row(path, number, words))
    stamp_ns = np.array([stamp for stamp, _ in rows], np.int64)
    same = len(rows) == len(trajectory) and not np.any(np.abs(stamp_ns - trajectory.stamp_ns) > _STAMP_NS)
    if not same:
        raise EvaluationError(f"{path} needs a row for each of {len(trajectory)} poses, with their stamps")
    covariance = np.zeros((len(rows), 6, 6))
    covariance[:, _ROWS, _COLUMNS] = covariance[:, _COLUMNS, _ROWS] = [values for _, values in rows]
    return covariance


def _row(path: Path, number: int, words: list[str]) -> tuple[int, list[float]]:
    try:
        whole, _, part = words[0].partition(".")
        stamp_ns = int(whole) * 10**9 + int(part[:9].ljust(9, "0"))
        values = [float(word) for word in words[1:]]
    except ValueError:
        values = []
    if len(values) != len(_ROWS) or not np.isfinite(values).all():
        raise EvaluationError(f"{path} line {number} is no stamp [s] with 21 numbers of a 6×6 lower triangle")
    return stamp_ns, values
