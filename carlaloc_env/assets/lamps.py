"""Lit brake lamps and indicators, cut out of the vehicles that carry them unlit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.cars import AMBER_TINT, STOP_TINT
from carlaloc_env.assets.shapes import Look
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, make_mesh
from carlaloc_env.semantics import Tag

_LIFT_M = 0.006
"""How far a lit lamp stands before the unlit one [m]."""


def lit_lamps(vehicles: Mapping[str, Mesh]) -> dict[str, Mesh]:
    """Meshes named ``vehicle/brake``, ``vehicle/left`` and ``vehicle/right``; empty without a lamp."""
    models: dict[str, Mesh] = {}
    for name, mesh in vehicles.items():
        corner = mesh.triangles[:, 0]
        plastic = mesh.material[corner] == Material.PLASTIC
        stop = plastic & np.all(mesh.colour[corner] == STOP_TINT, axis=-1)
        red = (mesh.material[corner] == Material.LAMP_RED) | stop
        amber = plastic & np.all(mesh.colour[corner] == AMBER_TINT, axis=-1)
        y = mesh.vertices_m[mesh.triangles, 1].mean(axis=1)
        tag = Tag(int(mesh.tag[0]))
        models[f"{name}/brake"] = _cut(mesh, red, Look(Material.LAMP_RED, tag))
        models[f"{name}/left"] = _cut(mesh, amber & (y > 0), Look(Material.LAMP_AMBER, tag))
        models[f"{name}/right"] = _cut(mesh, amber & (y < 0), Look(Material.LAMP_AMBER, tag))
    return models


def _cut(mesh: Mesh, chosen: NDArray[np.bool_], look: Look) -> Mesh:
    """Some of the triangles, lifted along their normals, of another look."""
    used, index = np.unique(mesh.triangles[chosen], return_inverse=True)
    return make_mesh(
        mesh.vertices_m[used] + _LIFT_M * mesh.normals[used],
        index.reshape(-1, 3),
        material=look.material,
        tag=look.tag,
        uv_m=mesh.uv_m[used],
        normals=mesh.normals[used],
        colour=look.colour,
    )
