"""Numbers as YAML text that both PyYAML and OpenCV's FileStorage read as what they are."""

from __future__ import annotations

from typing import Any

import numpy as np


def real(value: float) -> str:
    """A real number, always with a point: OpenCV takes 640 for an integer and PyYAML 2e-05 for a text."""
    text = repr(round(float(value), 15) + 0.0)
    if "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text


def rows(matrix: Any, *, indent: int = 0) -> str:
    """All numbers of a matrix in one bracket, a line per row."""
    lines = [", ".join(real(v) for v in row) for row in np.asarray(matrix, dtype=np.float64)]
    return "[" + (",\n" + " " * indent).join(lines) + "]"


def nested(matrix: Any, *, indent: int = 0) -> str:
    """A matrix as a list of rows, one item per line."""
    pad = " " * indent
    return "\n".join(f"{pad}- [{', '.join(real(v) for v in row)}]" for row in np.asarray(matrix))


def opencv_matrix(name: str, matrix: Any, *, dt: str = "d") -> str:
    """A matrix as OpenCV's FileStorage writes it; `dt` is ``f`` for float32 and ``d`` for float64."""
    m = np.asarray(matrix, dtype=np.float64)
    return (
        f"{name}: !!opencv-matrix\n"
        f"   rows: {m.shape[0]}\n   cols: {m.shape[1]}\n   dt: {dt}\n   data: {rows(m, indent=10)}\n"
    )
