"""Wooden poles along country roads and quiet streets, with wires that hang between them."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely

from carlaloc_env.assets.posts_and_fences import utility_pole, utility_wires_m
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_graph import runs
from carlaloc_env.scenery.ground.grade_levels import State
from carlaloc_env.scenery.ground.road_edges import RoadEdge, Waysides
from carlaloc_env.scenery.ground.terrain import Terrain
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import InstanceIds, copies, poses

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
    """Rows of poles: base points (N, 3) [m] and the directions of their cross-arms [rad], (N,).

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
        for bases_m, yaws in _rows(edge, AWAY_M[kind], blocked, ways.ground):
            spans = shapely.linestrings(np.stack([bases_m[:-1, :2], bases_m[1:, :2]], axis=1))
            free = ~shapely.dwithin(spans, overhead, 2.0)
            rows += [(bases_m[a : b + 1], yaws[a : b + 1]) for a, b in runs(free)]
    return rows


def corridor(rows: Sequence[tuple[Array, Array]]) -> Area:
    """Ground below the wires, on which no tree grows."""
    lines = [shapely.buffer(shapely.LineString(bases_m[:, :2]), 1.3) for bases_m, _ in rows]
    return shapely.union_all(lines) if lines else shapely.MultiPolygon()


def add_lines(
    out: MeshBuilder, rows: Sequence[tuple[Array, Array]], ids: InstanceIds
) -> tuple[list[Mesh], Array]:
    """Poles with an instance id each, and their base points [m], (K, 3). The wires go to `out`."""
    if not rows:
        return [], np.zeros((0, 3))
    bases_m = np.concatenate([row[0] for row in rows])
    yaw = np.concatenate([row[1] for row in rows])
    start = utility_wires_m(POLE_M)
    for base_m, turn in rows:
        # Its terms are added in the order in which towns have always been built.
        R = poses(base_m, turn)[:, :3, [0, 2, 1]]
        ends = np.swapaxes(elementary.matrix_product(R, start.T[[0, 2, 1]]), 1, 2) + base_m[:, None]
        for a, b in pairwise(ends):
            _wires(out, a, b)
    return [copies(utility_pole(POLE_M), poses(bases_m, yaw), ids.take(len(bases_m)))], bases_m


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
    bases_m: list[list[float]] = []
    yaws: list[float] = []
    poles, missed = [], 0
    for row in wanted:
        place = _free(edge, int(row), away, blocked)
        if place is None:
            missed += 1
        if missed > 1:
            poles.append((bases_m, yaws))
            bases_m, yaws, missed = [], [], 0
        if place is not None:
            xy, yaw = place
            bases_m.append([*xy, float(ground.height(xy[None])[0]) - 0.1])
            yaws.append(yaw)
            missed = 0
    poles.append((bases_m, yaws))
    return [(np.array(f), np.array(y)) for f, y in poles if len(f) > 1]


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
