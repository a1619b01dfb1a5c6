"""The mesh that wheels and bodies touch: the ground as it is, everything else as coarse boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.buildings.building_lots import Lot
from carlaloc_env.town.ground.lane_strips import Strip
from carlaloc_env.town.meshing.mesh_builder import MeshBuilder, box_quads
from carlaloc_env.town.meshing.polygons import unique_rows

Array = NDArray[np.float64]

POST_SIDES = 6
"""Sides of the prisms that stand for poles and trunks."""


def add_plain_lanes(out: MeshBuilder, strips: Sequence[Strip]) -> None:
    """Road lanes outside junctions, one quad per step: the same surface as the seen one."""
    for strip in strips:
        if strip.junction_id is not None:
            continue
        for lane in range(len(strip.lanes)):
            if strip.kind(lane) == "roadway":
                left, right = strip.lane_edges(lane)
                out.grid(np.stack([right, left], axis=1), material=Material.ASPHALT, tag=Tag.ROAD)


def lot_boxes(lots: Sequence[Lot], base_m: Sequence[float]) -> Array:
    """Walls and roofs of buildings, shape (N, 4, 3)."""
    faces = []
    for lot, base in zip(lots, base_m, strict=True):
        plan = lot.plan
        box = box_quads([0.0, 0.0, base - 1.0], [plan.width_m, plan.depth_m, base + plan.height_m])
        c, s = np.cos(lot.heading_rad), np.sin(lot.heading_rad)
        turned = box.copy()
        turned[..., 0] = lot.corner_m[0] + c * box[..., 0] - s * box[..., 1]
        turned[..., 1] = lot.corner_m[1] + s * box[..., 0] + c * box[..., 1]
        faces.append(turned)
    return np.concatenate(faces) if faces else np.zeros((0, 4, 3))


def posts(feet_m: Array, radius_m: Array, height_m: Array) -> Array:
    """Upright prisms of poles and trunks, feet (N, 3), shape (N·sides, 4, 3)."""
    angle = np.arange(POST_SIDES + 1) * (2 * np.pi / POST_SIDES)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    low = np.repeat(feet_m[:, None, :], POST_SIDES + 1, axis=1)
    low[..., :2] += ring * radius_m[:, None, None]
    high = low.copy()
    high[..., 2] += height_m[:, None]
    quads = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=2)
    return quads.reshape(-1, 4, 3)


def weld(meshes: Sequence[Mesh]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Corners and triangles of several meshes with equal corners made one (to 0.1 mm)."""
    corners = np.concatenate([mesh.vertices_m[mesh.triangles].reshape(-1, 3) for mesh in meshes])
    key = np.round(corners.astype(np.float64) * 1e4).astype(np.int64)
    _, first, inverse = unique_rows(key)
    triangles = inverse.reshape(-1, 3)
    real = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    return corners[first].astype(np.float64), triangles[real].astype(np.int32)
