"""Lamp posts of roads without sidewalks: masts on medians, beside fast roads and on parapets."""

from collections.abc import Sequence

import numpy as np
import shapely

from carlaloc_env.assets import street_furniture
from carlaloc_env.assets.primitives import placed
from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import right_of
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scenery.ground.grade_levels import WALL_M, State
from carlaloc_env.scenery.ground.road_edges import RoadEdge, Waysides, rows_every
from carlaloc_env.scenery.meshing.props import InstanceIds, copies, poses
from carlaloc_env.scenery.structures.deck_edges import RAIL_KERB_M
from carlaloc_env.scenery.structures.guard_rails import FAST_MPS

STEP_M, DECK_STEP_M = 44.0, 32.0
"""Distance of masts along fast roads, and of lamps on parapets [m]."""
MAST_M, ARM_M = 11.0, 2.6
"""Height of a mast's light, and how far it reaches over the road [m]."""
DECK_LAMP_M, DECK_ARM_M = 7.0, 1.6
"""The same of lamps on parapets [m]."""
LAMP_AWAY_M = 1.6
"""Distance of masts from the road's edge, behind the rail [m]."""
SPAN_CLEAR_M = 2.0
"""Distance of masts from what spans a road [m]."""
RIM_M = 0.5
"""Lamps stand on parapets only this near to the deck's rim [m]."""
_UNLIT = ("rural", "park")


def mast_meshes(
    ways: Waysides, medians: Sequence[Array], paved: Area, spans: Area, overhead: Area, ids: InstanceIds
) -> tuple[list[Mesh], Array, Array]:
    """Masts, their lights [m] (K, 3) and their base points [m] (N, 3).

    Args:
        ways: The ground beside the roads.
        medians: Lines (N, 3) along the medians of fast roads on which masts stand.
        paved: Everything paved, on which no mast stands.
        spans: Ground below whatever spans roads, on which none stands.
        overhead: Raised roads, along whose rims the parapets stand.
        ids: Gives each mast an instance id.
    """
    shapely.prepare(paved)
    double, yaw_double = _outside(spans, *_on_medians(medians))
    single, yaw_single = _outside(spans, *_beside(ways, double, paved))
    deck, yaw_deck = _on_parapets(ways.edges, overhead)
    mast = street_furniture.lamp(MAST_M, ARM_M)
    kinds = (
        (merge([mast, placed(mast, (0.0, 0.0, 0.0), np.pi)]), double, yaw_double, MAST_M, (ARM_M, -ARM_M)),
        (mast, single, yaw_single, MAST_M, (ARM_M,)),
        (street_furniture.lamp(DECK_LAMP_M, DECK_ARM_M), deck, yaw_deck, DECK_LAMP_M, (DECK_ARM_M,)),
    )
    meshes, lights = [], [np.zeros((0, 3))]
    for mesh, bases_m, yaw, height, arms in kinds:
        if not len(bases_m):
            continue
        meshes.append(copies(mesh, poses(bases_m, yaw), ids.take(len(bases_m))))
        for arm in arms:
            lights.append(bases_m + lamp_reach(yaw, arm, height))
    return meshes, np.concatenate(lights), np.concatenate([double, single, deck])


def lamp_reach(yaw_rad: Array, arm_m: float, height_m: float) -> Array:
    """Light sources of lamps from their base points [m], (N, 3); their arms point along `yaw_rad` (N,)."""
    heights = np.full(len(yaw_rad), height_m)
    return np.stack([elementary.cos(yaw_rad) * arm_m, elementary.sin(yaw_rad) * arm_m, heights], axis=-1)


def _outside(spans: Area, bases_m: Array, yaws: Array) -> tuple[Array, Array]:
    if spans.is_empty or not len(bases_m):
        return bases_m, yaws
    free = shapely.distance(spans, shapely.points(bases_m[:, :2])) > SPAN_CLEAR_M
    return bases_m[free], yaws[free]


def _on_medians(medians: Sequence[Array]) -> tuple[Array, Array]:
    bases_m, yaws = [np.zeros((0, 3))], [np.zeros(0)]
    for line in medians:
        rows = rows_every(STEP_M, line, 4)
        right = right_of(line)[rows]
        bases_m.append(line[rows] + np.array([0.0, 0.0, -0.05]))
        yaws.append(elementary.arctan2(right[:, 1], right[:, 0]))
    return np.concatenate(bases_m), np.concatenate(yaws)


def _beside(ways: Waysides, others: Array, paved: Area) -> tuple[Array, Array]:
    """Beside fast roads that have no masts on a median."""
    dark = ways.zones.area(*_UNLIT)
    shapely.prepare(dark)
    lit = shapely.MultiPoint(others[:, :2]) if len(others) else shapely.Point()
    bases_m, yaws = [np.zeros((0, 3))], [np.zeros(0)]
    for edge in ways.edges:
        if edge.sidewalk or edge.limit_mps < 0.8 * FAST_MPS:
            continue
        rows = rows_every(STEP_M, edge.line_m, 4)
        xy = edge.line_m[rows, :2] + LAMP_AWAY_M * edge.right[rows]
        free = shapely.distance(paved, shapely.points(xy)) > 0.6 * LAMP_AWAY_M
        free &= ~shapely.contains_xy(dark, xy[:, 0], xy[:, 1]) & (edge.state[rows] == State.GROUND)
        if not lit.is_empty:
            free &= shapely.distance(lit, shapely.points(xy)) > 2.0 * STEP_M
        rows, xy = rows[free], xy[free]
        if len(rows):
            bases_m.append(np.column_stack([xy, ways.ground.height(xy) - 0.05]))
            yaws.append(elementary.arctan2(-edge.right[rows, 1], -edge.right[rows, 0]))
    return np.concatenate(bases_m), np.concatenate(yaws)


def _on_parapets(edges: Sequence[RoadEdge], overhead: Area) -> tuple[Array, Array]:
    rim = shapely.boundary(overhead)
    shapely.prepare(rim)
    bases_m, yaws = [np.zeros((0, 3))], [np.zeros(0)]
    for edge in edges:
        up = np.isin(edge.state, (State.OPEN, State.FILLED)) & (edge.lift_m > 1.0)
        rows = rows_every(DECK_STEP_M, edge.line_m, 3)
        rows = rows[up[rows] & up[rows - 2] & up[rows + 2]]
        base_m = edge.line_m[rows].copy()
        base_m[:, :2] += 0.5 * WALL_M * edge.right[rows]
        base_m[:, 2] += RAIL_KERB_M - 0.02
        # Where roads lie side by side, an edge of one is no rim of the deck.
        on_rim = shapely.dwithin(rim, shapely.points(base_m[:, :2]), RIM_M)
        rows, base_m = rows[on_rim], base_m[on_rim]
        bases_m.append(base_m)
        yaws.append(elementary.arctan2(-edge.right[rows, 1], -edge.right[rows, 0]))
    return np.concatenate(bases_m), np.concatenate(yaws)
