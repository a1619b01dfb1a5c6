"""Writes points as binary PCD."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def pcd_bytes(rows: NDArray[np.void]) -> bytes:
    """Binary PCD of points, a field for each column of the rows."""
    names = rows.dtype.names or ()
    kinds: list[np.dtype[Any]] = [rows.dtype[name] for name in names]
    header = (
        "# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS " + " ".join(names),
        "SIZE " + " ".join(str(kind.itemsize) for kind in kinds),
        "TYPE " + " ".join(kind.kind.upper() for kind in kinds),
        "COUNT " + " ".join("1" for _ in kinds), f"WIDTH {len(rows)}", "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {len(rows)}", "DATA binary",
    )  # fmt: skip
    return "\n".join([*header, ""]).encode() + rows.tobytes()
