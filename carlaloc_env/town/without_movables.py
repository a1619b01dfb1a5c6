"""Towns without what is parked in them: the traffic level `empty`."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.town import Town

MOVABLE = (Tag.PEDESTRIAN, Tag.RIDER, Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.MOTORCYCLE, Tag.BICYCLE)
"""Tags of what can move, even where it is parked."""


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
    """What of a mesh cannot move."""
    goes = np.isin(chunk.tag, MOVABLE)
    if not goes.any():
        return chunk
    number = np.cumsum(~goes) - 1
    triangles = chunk.triangles[~goes[chunk.triangles[:, 0]]]
    return chunk.taking(np.flatnonzero(~goes), number[triangles].astype(np.uint32))
