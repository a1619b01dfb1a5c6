"""Masts: lamp posts, and poles with wires.

Wooden poles along country roads and quiet streets, with wires that hang between them.

Lamp posts of roads without sidewalks: masts on medians, beside fast roads and on parapets.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely

from carlaloc_env.assets import street_furniture
from carlaloc_env.assets.posts_and_fences import utility_pole, utility_wires_m
from carlaloc_env.assets.primitives import placed
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import right_of
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_graph import runs
from carlaloc_env.scenery.ground.grade_levels import WALL_M, RoadEdge, State, Waysides, rows_every
from carlaloc_env.scenery.ground.terrain import Terrain
from carlaloc_env.scenery.meshing.batches import InstanceIds, copies, poses
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.structures.bridges import RAIL_KERB_M
from carlaloc_env.scenery.structures.guard_rails import FAST_MPS

SPAN_M = 38.0
"""Usual distance of poles [m]."""
AWAY_M = {"rural": 3.2, "residential": 1.35, "small_town": 1.35, "industrial": 1.6}
"""Distance of poles from what is paved, in zones that have any [m]."""
FRACTIONS = {"rural": 0.8, "residential": 0.55, "small_town": 0.35, "industrial": 0.5}
"""Share of the roads of a zone along which a line runs."""
POLE_M = 10.5
"""Height of a pole [m]."""
PULL_M = 210.0
"""Parameter of the catenary, horizontal tension over weight per metre [m]: 0.9 m of sag on 38 m."""
WIRE_M = 0.016
"""Radius of a wire [m]."""
CLEAR_M = 0.9
"""Distance of poles from everything that stands or is paved [m]."""
_WIRE_POINTS = 9


def place_lines(ways: Waysides, blocked: Area, overhead: Area) -> list[tuple[Array, Array]]:
    """Rows of poles: feet (N, 3) [m] and the directions of their cross-arms [rad], (N,).

    Args:
        ways: The ground beside the roads.
        blocked: Where nothing may stand.
        overhead: Raised roads, which no wire crosses.
    """
    shapely.prepare(blocked)
    rows: list[tuple[Array, Array]] = []
    for edge in ways.edges:
        draw = clock.stream(ways.seed, f"poles/{edge.strip.road_id}")
        side = "left" if draw.random() < 0.5 else "right"
        kind = ways.zones.kind_at(edge.line_m[len(edge.line_m) // 2])
        if not edge.name.endswith(side) or kind not in AWAY_M or draw.random() > FRACTIONS[kind]:
            continue
        if len(edge.line_m) < 1.5 * SPAN_M or edge.road_type == "motorway":
            continue
        for feet, yaws in _rows(edge, AWAY_M[kind], blocked, ways.ground):
            spans = shapely.linestrings(np.stack([feet[:-1, :2], feet[1:, :2]], axis=1))
            free = ~shapely.dwithin(spans, overhead, 2.0)
            rows += [(feet[a : b + 1], yaws[a : b + 1]) for a, b in runs(free)]
    return rows


def corridor(rows: Sequence[tuple[Array, Array]]) -> Area:
    """Ground below the wires, on which no tree grows."""
    lines = [shapely.buffer(shapely.LineString(feet[:, :2]), 1.3) for feet, _ in rows]
    return shapely.union_all(lines) if lines else shapely.MultiPolygon()


def add_lines(
    out: MeshBuilder, rows: Sequence[tuple[Array, Array]], ids: InstanceIds
) -> tuple[list[Mesh], Array]:
    """Poles with an instance id each, and their feet [m], (K, 3). The wires go to `out`."""
    if not rows:
        return [], np.zeros((0, 3))
    feet = np.concatenate([row[0] for row in rows])
    yaw = np.concatenate([row[1] for row in rows])
    start = utility_wires_m(POLE_M)
    for foot, turn in rows:
        # Its terms are added in the order in which towns have always been built.
        R = poses(foot, turn)[:, :3, [0, 2, 1]]
        ends = np.swapaxes(elementary.matrix_product(R, start.T[[0, 2, 1]]), 1, 2) + foot[:, None]
        for a, b in pairwise(ends):
            _wires(out, a, b)
    return [copies(utility_pole(POLE_M), poses(feet, yaw), ids.take(len(feet)))], feet


def catenary_m(length_m: float, rise_m: float, pull_m: float, fraction: Array) -> Array:
    """Height of a hanging wire over its first end [m] at shares of the span, shape as `fraction`.

    z = c·cosh((x − x0)/c) + k through both ends, with c = tension over weight per metre; x0 from
    rise = 2c·sinh(L/2c)·sinh((L/2 − x0)/c).
    """
    half = 0.5 * length_m
    grown = elementary.exp(half / pull_m)
    slope = rise_m / (pull_m * (grown - 1.0 / grown))
    x0 = half - pull_m * float(elementary.log(slope + np.sqrt(slope * slope + 1.0)))
    x = fraction * length_m
    result: Array = pull_m * (_cosh((x - x0) / pull_m) - _cosh(np.asarray(x0 / pull_m)))
    return result


def _cosh(x: Array) -> Array:
    grown: Array = elementary.exp(x)
    return 0.5 * (grown + 1.0 / grown)


def _rows(edge: RoadEdge, away: float, blocked: Area, ground: Terrain) -> list[tuple[Array, Array]]:
    """Poles of one edge in runs without gaps of more than one pole."""
    count = max(2, round((len(edge.line_m) - 12) / SPAN_M) + 1)
    wanted = np.linspace(6, len(edge.line_m) - 7, count).round().astype(int)
    feet: list[list[float]] = []
    yaws: list[float] = []
    found, missed = [], 0
    for row in wanted:
        place = _free(edge, int(row), away, blocked)
        if place is None:
            missed += 1
        if missed > 1:
            found.append((feet, yaws))
            feet, yaws, missed = [], [], 0
        if place is not None:
            xy, yaw = place
            feet.append([*xy, float(ground.height(xy[None])[0]) - 0.1])
            yaws.append(yaw)
            missed = 0
    found.append((feet, yaws))
    return [(np.array(f), np.array(y)) for f, y in found if len(f) > 1]


def _free(edge: RoadEdge, row: int, away: float, blocked: Area) -> tuple[Array, float] | None:
    for shift in (0, 2, -2, 4, -4, 6, -6):
        at = min(max(row + shift, 0), len(edge.line_m) - 1)
        xy = edge.line_m[at, :2] + away * edge.right[at]
        if edge.state[at] == State.GROUND and shapely.distance(blocked, shapely.Point(*xy)) > CLEAR_M:
            # The cross-arm lies across the road.
            return xy, float(elementary.arctan2(edge.right[at, 0], -edge.right[at, 1]))
    return None


def _wires(out: MeshBuilder, a: Array, b: Array) -> None:
    """Wires between two poles, ends (K, 3) each, as three-sided tubes."""
    fraction = np.linspace(0.0, 1.0, _WIRE_POINTS)
    for start, end in zip(a, b, strict=True):
        span = end - start
        length = float(np.hypot(span[0], span[1]))
        line = start + fraction[:, None] * span
        line[:, 2] = start[2] + catenary_m(length, float(span[2]), PULL_M, fraction)
        side = np.array([-span[1], span[0], 0.0]) / length * WIRE_M
        ring = np.stack(
            [line + side, line - side, line + np.array([0.0, 0.0, 1.6 * WIRE_M]), line + side], axis=1
        )
        out.grid(ring, material=Material.RUBBER, tag=Tag.POLE, colour=(90, 90, 90))


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
    """Masts, their lights [m] (K, 3) and their feet [m] (N, 3).

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
    for mesh, feet, yaw, height, arms in kinds:
        if not len(feet):
            continue
        meshes.append(copies(mesh, poses(feet, yaw), ids.take(len(feet))))
        for arm in arms:
            lights.append(feet + lamp_reach(yaw, arm, height))
    return meshes, np.concatenate(lights), np.concatenate([double, single, deck])


def lamp_reach(yaw_rad: Array, arm_m: float, height_m: float) -> Array:
    """Light sources of lamps from their feet [m], (N, 3); their arms point along `yaw_rad` (N,)."""
    heights = np.full(len(yaw_rad), height_m)
    return np.stack([elementary.cos(yaw_rad) * arm_m, elementary.sin(yaw_rad) * arm_m, heights], axis=-1)


def _outside(spans: Area, feet: Array, yaws: Array) -> tuple[Array, Array]:
    if spans.is_empty or not len(feet):
        return feet, yaws
    free = shapely.distance(spans, shapely.points(feet[:, :2])) > SPAN_CLEAR_M
    return feet[free], yaws[free]


def _on_medians(medians: Sequence[Array]) -> tuple[Array, Array]:
    feet, yaws = [np.zeros((0, 3))], [np.zeros(0)]
    for line in medians:
        rows = rows_every(STEP_M, line, 4)
        right = right_of(line)[rows]
        feet.append(line[rows] + np.array([0.0, 0.0, -0.05]))
        yaws.append(elementary.arctan2(right[:, 1], right[:, 0]))
    return np.concatenate(feet), np.concatenate(yaws)


def _beside(ways: Waysides, others: Array, paved: Area) -> tuple[Array, Array]:
    """Beside fast roads that have no masts on a median."""
    dark = ways.zones.area(*_UNLIT)
    shapely.prepare(dark)
    lit = shapely.MultiPoint(others[:, :2]) if len(others) else shapely.Point()
    feet, yaws = [np.zeros((0, 3))], [np.zeros(0)]
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
            feet.append(np.column_stack([xy, ways.ground.height(xy) - 0.05]))
            yaws.append(elementary.arctan2(-edge.right[rows, 1], -edge.right[rows, 0]))
    return np.concatenate(feet), np.concatenate(yaws)


def _on_parapets(edges: Sequence[RoadEdge], overhead: Area) -> tuple[Array, Array]:
    rim = shapely.boundary(overhead)
    shapely.prepare(rim)
    feet, yaws = [np.zeros((0, 3))], [np.zeros(0)]
    for edge in edges:
        up = np.isin(edge.state, (State.OPEN, State.FILLED)) & (edge.lift_m > 1.0)
        rows = rows_every(DECK_STEP_M, edge.line_m, 3)
        rows = rows[up[rows] & up[rows - 2] & up[rows + 2]]
        foot = edge.line_m[rows].copy()
        foot[:, :2] += 0.5 * WALL_M * edge.right[rows]
        foot[:, 2] += RAIL_KERB_M - 0.02
        # Where roads lie side by side, an edge of one is no rim of the deck.
        on_rim = shapely.dwithin(rim, shapely.points(foot[:, :2]), RIM_M)
        rows, foot = rows[on_rim], foot[on_rim]
        feet.append(foot)
        yaws.append(elementary.arctan2(-edge.right[rows, 1], -edge.right[rows, 0]))
    return np.concatenate(feet), np.concatenate(yaws)
