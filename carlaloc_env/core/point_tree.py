"""Search among points: SciPy's k-d tree, imported when the first one is built."""

from __future__ import annotations

from typing import TYPE_CHECKING

from carlaloc_env.core.array_types import Array

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


def point_tree(points_m: Array) -> cKDTree:
    """A k-d tree over points [m], (M, 2|3)."""
    # Here, since scipy.spatial takes long to import, and a drive in a town from the cache needs no search.
    from scipy.spatial import cKDTree

    return cKDTree(points_m)
