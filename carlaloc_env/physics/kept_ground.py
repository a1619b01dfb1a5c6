"""Ground tables kept on disk: sorting a town's triangles takes a twentieth of making an environment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.files.array_cache import SHARED_FROM_BYTES, Arrays, arrays_hash, cached, read_only
from carlaloc_env.physics.ground_heights import GroundTable, Squares, ground_table

KEPT_FILES = 16
"""Tables kept of all meshes: a town has one with and one without parked cars."""


def kept_ground(vertices_m: NDArray[np.float64], triangles: NDArray[np.int64]) -> GroundTable:
    """The table of a mesh, from the cache when the same code sorted the same triangles before.

    Its arrays are read-only, and processes share those of a large mesh.

    Args:
        vertices_m: Corners [m], world, shape (V, 3).
        triangles: Corner indices, shape (T, 3).
    """

    def make() -> GroundTable:
        return ground_of_arrays(ground_arrays(ground_table(vertices_m, triangles)))

    if vertices_m.nbytes + triangles.nbytes < SHARED_FROM_BYTES:
        return make()
    return cached(
        "ground",
        "ground",
        module=ground_table.__module__,
        make=make,
        to_arrays=ground_arrays,
        from_arrays=ground_of_arrays,
        content=arrays_hash({"vertices_m": vertices_m, "triangles": triangles}),
        kept_files=KEPT_FILES,
    )


def ground_arrays(table: GroundTable) -> Arrays:
    """The table as named arrays."""
    arrays: Arrays = {"triangle": table.triangle, "normal": table.normal}
    for name, squares in (("small", table.small), ("large", table.large)):
        arrays |= {f"{name}/{field}": np.asarray(value) for field, value in squares._asdict().items()}
    return arrays


def ground_of_arrays(arrays: Arrays) -> GroundTable:
    """The table again, as read-only views."""
    views = read_only(arrays)
    return GroundTable(
        triangle=views["triangle"],
        normal=views["normal"],
        small=_squares_of(views, "small"),
        large=_squares_of(views, "large"),
    )


def _squares_of(views: Arrays, name: str) -> Squares:
    columns, rows = views[f"{name}/shape"].tolist()
    x_m, y_m = views[f"{name}/low_m"].tolist()
    return Squares(
        inside=views[f"{name}/inside"],
        first=views[f"{name}/first"],
        shape=(columns, rows),
        low_m=(x_m, y_m),
        cell_m=views[f"{name}/cell_m"].item(),
    )
