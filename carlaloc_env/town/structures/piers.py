"""Piers below decks, on columns that keep clear of what passes under them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.ground.grade_levels import Levels, State
from carlaloc_env.town.ground.raised_parts import DECK_M, DIM, FOOTING_M, Floor, RaisedParts, runs_in_strips
from carlaloc_env.town.meshing.mesh_builder import MeshBuilder, box_quads
from carlaloc_env.town.meshing.polygons import Area

PIER_STEP_M = 22.0
"""Distance of piers along a road [m]."""
COLUMN_M = 0.55
"""Half the side of a column [m]."""
COLUMN_STEP_M = 9.0
"""Largest distance of the columns of one pier across the road [m]."""
PIER_CLEAR_M = 0.9
"""Distance of columns from lanes and sidewalks below [m]."""
CROSSHEAD_M = 0.7
"""Height of the beam on the columns of a pier [m]."""


def add_piers(out: MeshBuilder, levels: Levels, parts: RaisedParts, floor: Floor) -> None:
    """Piers of all open stretches, as evenly spaced as what lies below lets them be."""
    graph = levels.graph
    keep_off = shapely.buffer(parts.below, PIER_CLEAR_M)
    inside = shapely.buffer(parts.open, -0.3)
    for area in (keep_off, inside):
        shapely.prepare(area)
    placed: list[Array] = []
    for a, b in runs_in_strips(graph.strip, levels.state == State.OPEN):
        if graph.junction[a] and b - a < PIER_STEP_M:
            continue
        count = int((b - a) / PIER_STEP_M)
        for k in range(count):
            wanted = a + int((k + 0.5) * (b - a) / count)
            for shift in (0, 2, -2, 4, -4, 6, -6, 8, -8):
                row = wanted + shift
                if not a + 2 <= row < b - 2:
                    continue
                feet = _columns(graph.left_m[row], graph.right_m[row])
                if _stands(feet, keep_off, inside, placed):
                    placed.append(feet[:, :2])
                    _pier(out, feet, graph.left_m[row], graph.right_m[row], parts, floor)
                    break


def _columns(left: Array, right: Array) -> Array:
    """Middles of the columns of one pier (K, 3)."""
    width = float(np.hypot(*(left - right)[:2]))
    count = max(1, int(np.ceil((width - 3.0) / COLUMN_STEP_M)))
    share = (np.arange(count) + 0.5) / count
    result: Array = left + share[:, None] * (right - left)
    return result


def _stands(feet: Array, keep_off: Area, inside: Area, placed: Sequence[Array]) -> bool:
    if shapely.contains_xy(keep_off, feet[:, 0], feet[:, 1]).any():
        return False
    if not shapely.contains_xy(inside, feet[:, 0], feet[:, 1]).all():
        return False
    return not any(np.hypot(*(feet[:, None, :2] - other[None]).T).min() < 6.0 for other in placed)


def _pier(out: MeshBuilder, feet: Array, left: Array, right: Array, parts: RaisedParts, floor: Floor) -> None:
    across = (right - left) / np.hypot(*(right - left)[:2])
    across[2] = 0.0
    turn = np.array([[across[0], across[1]], [-across[1], across[0]]])
    under = parts.road.nearest(feet[:, :2])[0] - DECK_M
    ground = floor.height(feet[:, :2]) - FOOTING_M
    head = CROSSHEAD_M if len(feet) > 1 else 0.0
    boxes = box_quads(
        np.column_stack([np.full((len(feet), 2), -COLUMN_M), ground]),
        np.column_stack([np.full((len(feet), 2), COLUMN_M), under - head + 0.02]),
    ).reshape(5, len(feet), 4, 3)
    boxes[..., :2] = elementary.matrix_product(boxes[..., :2], turn) + feet[None, :, None, :2]
    faces = [boxes.reshape(-1, 4, 3)]
    if head:
        half = 0.5 * float(np.hypot(*(feet[-1] - feet[0])[:2])) + 1.2
        middle = 0.5 * (feet[0] + feet[-1])
        slope = np.array([0.0, 0.0, float(under[-1] - under[0]) / max(2.0 * (half - 1.2), 1.0)])
        beam = box_quads([-half, -0.65, -head], [half, 0.65, 0.05], bottom=True)
        beam[..., 2] += slope[2] * beam[..., 0] + float(under.mean())
        beam[..., :2] = elementary.matrix_product(beam[..., :2], turn) + middle[:2]
        faces.append(beam)
    out.quads(np.concatenate(faces), material=Material.CONCRETE, tag=Tag.BRIDGE, colour=DIM)
