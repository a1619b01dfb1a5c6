"""Writes points and triangles as binary PLY."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PLY = {"<f8": "double", "<f4": "float", "<i4": "int", "<u2": "uint16", "|u1": "uchar"}
"""Names of types, among those that Open3D reads."""


def ply_bytes(
    columns: Sequence[tuple[str, str, NDArray[Any]]], triangles: NDArray[Any] | None = None
) -> bytes:
    """Binary PLY of points.

    Args:
        columns: Name, data type and values of each of their properties.
        triangles: Rows of the corners of triangles over them, shape (T, 3).
    """
    rows = np.empty(len(columns[0][2]), [(name, kind) for name, kind, _ in columns])
    for name, _, values in columns:
        rows[name] = values
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property {_PLY[kind]} {name}" for name, kind, _ in columns]
    content = rows.tobytes()
    if triangles is not None:
        header += [f"element face {len(triangles)}", "property list uchar uint vertex_indices"]
        faces = np.empty(len(triangles), [("count", "|u1"), ("corners", "<u4", 3)])
        faces["count"], faces["corners"] = 3, triangles
        content += faces.tobytes()
    return "\n".join([*header, "end_header\n"]).encode() + content
