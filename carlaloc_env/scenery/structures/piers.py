"""Piers below decks, on columns that keep clear of what passes under them."""

from collections.abc import Sequence

import numpy as np
import shapely

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import Levels, State
from carlaloc_env.scenery.ground.raised_parts import (
    DECK_M,
    DIM,
    FOOTING_M,
    Floor,
    RaisedParts,
    runs_in_strips,
)
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads

PIER_STEP_M = 22.0
"""Distance of piers along a road [m]."""
COLUMN_M = 0.55
"""Half the side of a column [m]."""
COLUMN_STEP_M = 5.0
"""Largest distance of the columns of one pier across the road [m]."""
PIER_CLEAR_M = 0.9
"""Distance of columns from lanes and sidewalks below [m]."""
ROW_STEP = 0.1
"""Distance of places that are tried, in rows of about a metre."""
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
            for row in _rows_about(a + 2, b - 3, (k + 0.5) / count, 1.0 / count):
                left, right = (_between(edge, row) for edge in (graph.left_m, graph.right_m))
                bases_m = _columns(left, right)
                if _stands(bases_m, keep_off, inside, placed):
                    placed.append(bases_m[:, :2])
                    _pier(out, bases_m, left, right, parts, floor)
                    break


def _rows_about(first: int, last: int, share: float, span: float) -> Array:
    """Fractional rows of a stretch, those nearest to a share of it first, within half a span of it.

    They are so close to each other that a pier finds the middle of a narrow median.
    """
    candidates = np.arange(first, last, ROW_STEP)
    away = np.abs(candidates - first - share * (last - first))
    near = away <= 0.5 * span * (last - first)
    rows: Array = candidates[near][np.argsort(away[near], kind="stable")]
    return rows


def _between(points: Array, row: float) -> Array:
    """Point at a fractional row, shape (3,)."""
    low = int(row)
    point: Array = points[low] + (row - low) * (points[low + 1] - points[low])
    return point


def _columns(left: Array, right: Array) -> Array:
    """Middles of the columns of one pier (K, 3)."""
    width = float(np.hypot(*(left - right)[:2]))
    count = max(1, int(np.ceil((width - 3.0) / COLUMN_STEP_M)))
    share = (np.arange(count) + 0.5) / count
    result: Array = left + share[:, None] * (right - left)
    return result


def _stands(bases_m: Array, keep_off: Area, inside: Area, placed: Sequence[Array]) -> bool:
    if shapely.contains_xy(keep_off, bases_m[:, 0], bases_m[:, 1]).any():
        return False
    if not shapely.contains_xy(inside, bases_m[:, 0], bases_m[:, 1]).all():
        return False
    return not any(np.hypot(*(bases_m[:, None, :2] - other[None]).T).min() < 6.0 for other in placed)


def _pier(
    out: MeshBuilder, bases_m: Array, left: Array, right: Array, parts: RaisedParts, floor: Floor
) -> None:
    across = (right - left) / np.hypot(*(right - left)[:2])
    across[2] = 0.0
    turn = np.array([[across[0], across[1]], [-across[1], across[0]]])
    under = parts.road.nearest(bases_m[:, :2])[0] - DECK_M
    ground = floor.height(bases_m[:, :2]) - FOOTING_M
    head = CROSSHEAD_M if len(bases_m) > 1 else 0.0
    boxes = box_quads(
        np.column_stack([np.full((len(bases_m), 2), -COLUMN_M), ground]),
        np.column_stack([np.full((len(bases_m), 2), COLUMN_M), under - head + 0.02]),
    ).reshape(5, len(bases_m), 4, 3)
    boxes[..., :2] = elementary.matrix_product(boxes[..., :2], turn) + bases_m[None, :, None, :2]
    faces = [boxes.reshape(-1, 4, 3)]
    if head:
        half = 0.5 * float(np.hypot(*(bases_m[-1] - bases_m[0])[:2])) + 1.2
        middle = 0.5 * (bases_m[0] + bases_m[-1])
        slope = np.array([0.0, 0.0, float(under[-1] - under[0]) / max(2.0 * (half - 1.2), 1.0)])
        beam = box_quads([-half, -0.65, -head], [half, 0.65, 0.05], bottom=True)
        beam[..., 2] += slope[2] * beam[..., 0] + float(under.mean())
        beam[..., :2] = elementary.matrix_product(beam[..., :2], turn) + middle[:2]
        faces.append(beam)
    out.quads(np.concatenate(faces), material=Material.CONCRETE, tag=Tag.BRIDGE, colour=DIM)
