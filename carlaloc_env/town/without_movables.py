"""Towns without the vehicles parked in them: the traffic level `empty`."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from carlaloc_env.scene.materials import Tag
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.town.town import Town

MOVABLE = (Tag.PEDESTRIAN, Tag.RIDER, Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.MOTORCYCLE, Tag.BICYCLE)
"""Tags of things that can move, even where they are parked."""


def without_movables(town: Town) -> Town:
    """The same town without anything movable: neither to be seen nor to be hit."""
    outline = town.outline
    stays = ~np.isin(outline.collision_tags, MOVABLE)
    return replace(
        town,
        scenery=cache(lambda: tuple(_standing(chunk) for chunk in town.chunks)),
        outline=replace(
            outline,
            collision_triangles=outline.collision_triangles[stays],
            collision_tags=outline.collision_tags[stays],
        ),
    )


def _standing(chunk: Mesh) -> Mesh:
    """The part of a mesh that cannot move."""
    stays = ~np.isin(chunk.tag, MOVABLE)
    if stays.all():
        return chunk
    number = np.cumsum(stays) - 1
    triangles = chunk.triangles[stays[chunk.triangles[:, 0]]]
    return chunk.taking(np.flatnonzero(stays), number[triangles].astype(np.uint32))
