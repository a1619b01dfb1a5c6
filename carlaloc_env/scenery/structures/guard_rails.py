"""Steel rails beside fast roads and embankments, and concrete barriers on medians."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import distance_along, interpolated, right_of
from carlaloc_env.map.lanes.speed_limits import road_limit_mps
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_graph import runs
from carlaloc_env.scenery.ground.grade_levels import State
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.road_edges import Waysides
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads

FAST_MPS = 75.0 / 3.6
"""Roads with at least this limit have rails [m/s]."""
HIGH_M = 1.2
"""Roads at least this high on an embankment have rails whatever their limit [m]."""
RAIL_AWAY_M = 0.55
"""Distance of the rail's face from what is paved [m]."""
MEDIAN_RAIL_AWAY_M = 1.3
"""The same on wide medians [m]: lanes that begin at a median's edge keep clear of the rail."""
SHORTEST_M = 10.0
"""Shorter rails are left out [m]."""
STEP_M = 4.0
"""Length of a beam, and distance of the posts of a simple rail (ESP 4.0) [m]."""
FAST_POST_M, SPACER_M = 2.0, 0.16
"""Distance of the posts of rails beside fast roads (EDSP 2.0), and how far a spacer holds the beam off
them [m]; the German rules RPS ask for such rails on motorways."""
BEAM = ((0.0, 0.44), (-0.08, 0.50), (0.0, 0.595), (-0.08, 0.69), (0.0, 0.75))
"""Cross-section of a W-beam: distance from its plane away from the road, and height [m]."""
BARRIER = (
    (-0.30, -0.1), (-0.30, 0.08), (-0.17, 0.33), (-0.08, 0.81),
    (0.08, 0.81), (0.17, 0.33), (0.30, 0.08), (0.30, -0.1),
)  # fmt: skip
"""Cross-section of a concrete barrier (New Jersey profile): distance from its middle, and height [m]."""
NARROWEST_MEDIAN_M, WIDEST_BARRIER_M = 0.7, 7.0
"""Medians of fast roads that carry a concrete barrier [m]; wider ones have two rails."""
_STEEL = (178, 182, 186)


def add_guard_rails(out: MeshBuilder, solid: MeshBuilder, ways: Waysides, paved: Area) -> Area:
    """Rails along the outer edges of fast and raised roads; returns the ground that they take.

    Args:
        out: What is seen.
        solid: What is hit.
        ways: The ground beside the roads.
        paved: Everything paved, on which no rail stands.
    """
    lines = []
    shapely.prepare(paved)
    for edge in ways.edges:
        wanted = (edge.state == State.BANK) & (edge.lift_m > HIGH_M)
        fast = edge.limit_mps >= FAST_MPS or edge.road_type == "motorway"
        if fast:
            wanted |= np.isin(edge.state, (State.GROUND, State.BANK))
        if edge.sidewalk or not wanted.any():
            continue
        foot = edge.line_m[:, :2] + RAIL_AWAY_M * edge.right
        clear = shapely.distance(paved, shapely.points(foot)) > 0.6 * RAIL_AWAY_M
        for a, b in runs(wanted & clear):
            if b - a >= SHORTEST_M:
                xy = foot[a:b]
                z = np.maximum(ways.ground.height(xy), edge.line_m[a:b, 2] - 0.1)
                lines.append(xy)
                _rail(out, solid, np.column_stack([xy, z]), edge.right[a:b], fast=fast)
    parts = [shapely.buffer(shapely.LineString(line), 0.5) for line in lines]
    return shapely.union_all(parts) if parts else shapely.MultiPolygon()


def add_medians(
    out: MeshBuilder, solid: MeshBuilder, strips: Sequence[Strip], roads: Sequence[Road]
) -> list[Array]:
    """Barriers or rails on the medians of fast roads; gives lines (N, 3) [m] on which masts can stand."""
    middles = []
    for strip in strips:
        fast = road_limit_mps(roads[strip.road]) >= FAST_MPS or roads[strip.road].type == "motorway"
        if strip.junction_id is not None or not fast:
            continue
        for left, right in median_edges(strip):
            width = np.hypot(*(left - right)[:, :2].T)
            middle = 0.5 * (left + right)
            for a, b in runs(width >= NARROWEST_MEDIAN_M):
                if b - a < SHORTEST_M:
                    continue
                if np.median(width[a:b]) <= WIDEST_BARRIER_M:
                    _barrier(out, solid, middle[a:b])
                    middles.append(middle[a:b] + np.array([0.0, 0.0, BARRIER[3][1]]))
                    continue
                middles.append(middle[a:b])
                away = right_of(middle[a:b])
                for line, side in ((left[a:b], away), (right[a:b], -away)):
                    foot = line.copy()
                    foot[:, :2] += MEDIAN_RAIL_AWAY_M * side
                    _rail(out, solid, foot, side, fast=True)
    return middles


def median_edges(strip: Strip) -> list[tuple[Array, Array]]:
    """Left and right edge (N, 3) of every run of median lanes, a point per metre."""
    edges = []
    kinds = np.array([strip.kind(lane) == "median" for lane in range(len(strip.lanes))])
    s = np.linspace(strip.s_m[0], strip.s_m[-1], max(2, int(np.ptp(strip.s_m)) + 1))
    for first, last in runs(kinds):
        ends = strip.lane_edges(first)[0], strip.lane_edges(last - 1)[1]
        edges.append((interpolated(s, strip.s_m, ends[0]), interpolated(s, strip.s_m, ends[1])))
    return edges


def _rail(out: MeshBuilder, solid: MeshBuilder, foot: Array, away: Array, *, fast: bool) -> None:
    """A W-beam on posts; its face looks against `away` (N, 2)."""
    rows = _even(len(foot), STEP_M)
    p, n = foot[rows], np.column_stack([away[rows], np.zeros(len(rows))])
    profile = np.array(BEAM)
    grid = np.repeat(p[:, None], len(profile), axis=1)
    grid += profile[None, :, :1] * n[:, None] + profile[None, :, 1:] * np.array([0.0, 0.0, 1.0])
    u = distance_along(p)
    uv = np.stack(np.broadcast_arrays(u[:, None], profile[None, :, 1]), axis=-1)
    back = np.stack([p + 0.02 * n + np.array([0.0, 0.0, z]) for z in (0.44, 0.75)], axis=1)
    side = -1 if _road_on_left(p, n) else 1
    look: dict[str, Any] = {"material": Material.METAL_GALVANISED, "tag": Tag.GUARD_RAIL, "colour": _STEEL}
    out.grid(grid[:, ::side], uv_m=uv[:, ::side], **look)
    out.grid(back[:, ::-side], uv_m=uv[:, [0, -1]], **look)
    _posts(out, foot, away, fast, look)
    up = np.array([0.0, 0.0, 0.8])
    wall = np.stack([p[:-1], p[1:], p[1:] + up, p[:-1] + up], axis=1)
    solid.quads(np.concatenate([wall, wall[:, ::-1]]), material=Material.PLAIN, tag=Tag.GUARD_RAIL)


def _posts(out: MeshBuilder, foot: Array, away: Array, fast: bool, look: dict[str, Any]) -> None:
    """Posts behind the beam; of fast roads, twice as many with spacers before them."""
    rows = _even(len(foot), FAST_POST_M if fast else STEP_M)
    behind = SPACER_M if fast else 0.03
    boxes = [box_quads([behind, -0.06, -0.4], [behind + 0.1, 0.06, 0.72])]
    if fast:
        # Sides and top; its ends lie on the beam and on the post.
        boxes.append(box_quads([0.02, -0.04, 0.5], [behind, 0.04, 0.69])[[0, 2, 4]])
    box, n = np.concatenate(boxes), away[rows]
    along = np.stack([-n[:, 1], n[:, 0]], axis=-1)
    posts = np.zeros((len(rows), *box.shape))
    posts[..., :2] = (
        foot[rows, None, None, :2]
        + box[None, ..., :1] * n[:, None, None]
        + box[None, ..., 1:2] * along[:, None, None]
    )
    posts[..., 2] = foot[rows, None, None, 2] + box[None, ..., 2]
    out.quads(posts.reshape(-1, 4, 3), **look)


def _road_on_left(p: Array, n: Array) -> bool:
    """Whether the side that `n` leads away from lies on the left of the line."""
    step = p[1] - p[0]
    return bool(step[0] * n[0, 1] - step[1] * n[0, 0] < 0.0)


def _barrier(out: MeshBuilder, solid: MeshBuilder, line: Array) -> None:
    rows = _even(len(line), STEP_M)
    p, right = line[rows], right_of(line)[rows]
    profile = np.array(BARRIER)
    grid = np.repeat(p[:, None], len(profile), axis=1)
    grid[..., :2] += profile[None, :, :1] * right[:, None]
    grid[..., 2] += profile[None, :, 1]
    u = distance_along(p)
    v = distance_along(profile)
    uv = np.stack(np.broadcast_arrays(u[:, None], v[None]), axis=-1)
    for k in range(len(profile) - 1):
        # One grid per face keeps the barrier's edges sharp.
        out.grid(
            grid[:, [k + 1, k]], material=Material.CONCRETE, tag=Tag.WALL, uv_m=uv[:, [k + 1, k]],
            colour=(222, 220, 214),
        )  # fmt: skip
    for end in (0, -1):
        ring = grid[end][:: 1 if end else -1]
        fan = np.array([[0, k, k + 1] for k in range(1, len(ring) - 1)])
        out.triangles(ring, fan, material=Material.CONCRETE, tag=Tag.WALL, colour=(215, 213, 207))
    for a, b in ((0, 3), (4, 7)):
        faces = np.stack([grid[:-1, b], grid[:-1, a], grid[1:, a], grid[1:, b]], axis=1)
        solid.quads(faces, material=Material.PLAIN, tag=Tag.WALL)


def _even(count: int, step: float) -> NDArray[np.int64]:
    """First, last and about every `step`-th row."""
    number = max(2, int(np.ceil((count - 1) / step)) + 1)
    return np.unique(np.rint(np.linspace(0, count - 1, number)).astype(np.int64))
