"""Lit brake lamps, indicators and reversing lamps, cut out of the vehicles that carry them unlit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.primitives import Look
from carlaloc_env.assets.vehicles.car_ends import AMBER_TINT, REVERSE_TINT, STOP_TINT
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag

LAMPS = ("brake", "left", "right", "reverse")
"""Kinds of lamps that are lit and put out."""
_LIFT_M = 0.004
"""How far a lit lamp stands before the unlit one [m]."""
_FAR_LIFT_M = 0.05
"""The same for the coarser body of a vehicle far away, whose surface lies elsewhere by some centimetres."""


def lit_lamps(name: str, body: Mesh) -> dict[str, Mesh]:
    """Meshes ``name/brake``, ``name/left``, ``name/right``, ``name/reverse``, and under ``name/low/``.

    Empty where the vehicle has no such lamp.
    """
    corner = body.triangles[:, 0]
    plastic = body.material[corner] == Material.PLASTIC
    stop, amber, white = (
        plastic & np.all(body.colour[corner] == tint, axis=-1)
        for tint in (STOP_TINT, AMBER_TINT, REVERSE_TINT)
    )
    y = body.vertices_m[body.triangles, 1].mean(axis=1)
    chosen = {
        "brake": (stop | (body.material[corner] == Material.LAMP_TAIL), Material.LAMP_RED),
        "left": (amber & (y > 0), Material.LAMP_AMBER),
        "right": (amber & (y < 0), Material.LAMP_AMBER),
        "reverse": (white, Material.LAMP_WHITE),
    }
    tag, models = Tag(int(body.tag[0])), dict[str, Mesh]()
    for lamp in LAMPS:
        where, material = chosen[lamp]
        models[f"{name}/{lamp}"] = _cut(body, where, Look(material, tag), _LIFT_M)
        models[f"{name}/low/{lamp}"] = _cut(body, where, Look(material, tag), _FAR_LIFT_M)
    return models


def _cut(mesh: Mesh, chosen: NDArray[np.bool_], look: Look, lift_m: float) -> Mesh:
    """Some of the triangles, lifted along their normals, of another look."""
    used, index = np.unique(mesh.triangles[chosen], return_inverse=True)
    normals = mesh.normals[used]
    lifted = mesh.vertices_m[used] + lift_m * normals
    return look.mesh(lifted, index.reshape(-1, 3), mesh.uv_m[used], normals)
