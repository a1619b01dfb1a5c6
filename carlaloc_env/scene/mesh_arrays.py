"""Meshes laid end to end in a few arrays, as files hold them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.scene.mesh import VERTEX_FIELDS, Mesh

_FIELDS = ("triangles", *VERTEX_FIELDS)


def meshes_to_arrays(meshes: Sequence[Mesh]) -> dict[str, NDArray[Any]]:
    """Arrays of meshes, one for each of their attributes, and the numbers of their vertices and triangles."""
    arrays: dict[str, NDArray[Any]] = {
        "vertex_counts": np.array([len(mesh.vertices_m) for mesh in meshes], dtype=np.int64),
        "triangle_counts": np.array([len(mesh.triangles) for mesh in meshes], dtype=np.int64),
    }
    for name in _FIELDS:
        arrays[f"mesh_{name}"] = np.concatenate([getattr(mesh, name) for mesh in meshes])
    return arrays


def meshes_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> tuple[Mesh, ...]:
    """The meshes again, as views of the arrays.

    Raises:
        KeyError: an array is missing.
        ValueError: their lengths do not fit each other.
    """
    vertex = np.concatenate([[0], np.cumsum(arrays["vertex_counts"])])
    triangle = np.concatenate([[0], np.cumsum(arrays["triangle_counts"])])
    meshes = []
    for index in range(len(vertex) - 1):
        rows = dict.fromkeys(_FIELDS, slice(vertex[index], vertex[index + 1]))
        rows["triangles"] = slice(triangle[index], triangle[index + 1])
        meshes.append(Mesh(**{name: arrays[f"mesh_{name}"][part] for name, part in rows.items()}))
    return tuple(meshes)
