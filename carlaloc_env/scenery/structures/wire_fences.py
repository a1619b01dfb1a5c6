"""Wire fences along motorways and fast country roads, which keep animals off them."""

import numpy as np
import shapely

from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_graph import runs
from carlaloc_env.scenery.ground.grade_levels import State
from carlaloc_env.scenery.ground.road_edges import RoadEdge, Waysides
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads

FENCED_MPS = 69.0 / 3.6
"""Roads with this limit or a higher one are fenced [m/s]."""
FENCE_AWAY_M, CLEAR_M = 9.0, 6.0
"""Distance of a fence from its road's edge, and the least from anything else that is paved [m]."""
POST_STEP_M = 4
"""Distance of its posts [m]."""
LEAST_M = 16
"""Shorter pieces are left out [m]."""
POST_M, POST_HALF_M = 1.45, 0.05
"""Height of a post, and half its side [m]."""
WIRES_M = (0.30, 0.65, 1.00, 1.35)
"""Heights of the wires [m]."""
WIRE_HALF_M = 0.014
"""Half the height of a wire, a woven band as pastures have them [m]."""
FENCED_ZONES = ("highway", "rural")
"""Zones whose fast roads are fenced."""


def add_wire_fences(out: MeshBuilder, solid: MeshBuilder, ways: Waysides, blocked: Area) -> Area:
    """Fences along all fast roads in open country; gives the ground that they take.

    Args:
        out: What is seen.
        solid: What is hit.
        ways: The ground beside the roads.
        blocked: Everything paved, built or reserved.
    """
    country = ways.zones.area(*FENCED_ZONES)
    shapely.prepare(country)
    shapely.prepare(blocked)
    lines = [
        line
        for edge in ways.edges
        if edge.limit_mps >= FENCED_MPS and not edge.sidewalk
        for line in _free_lines(edge, country, blocked)
    ]
    for line in lines:
        foot = np.column_stack([line, ways.ground.height(line)])
        _fence_posts(out, foot)
        _wires(out, foot)
        top = foot + np.array([0.0, 0.0, POST_M])
        walls = np.stack([foot[:-1], foot[1:], top[1:], top[:-1]], axis=1)
        solid.quads(np.concatenate([walls, walls[:, ::-1]]), material=Material.PLAIN, tag=Tag.FENCE)
    return shapely.union_all([shapely.LineString(line).buffer(0.8) for line in lines])


def _free_lines(edge: RoadEdge, country: Area, blocked: Area) -> list[Array]:
    """Lines (N, 2) beside an edge, a point per post, where nothing is in the way."""
    # The last point is where the next section of the road begins.
    rows = np.unique(np.append(np.arange(0, len(edge.line_m), POST_STEP_M), len(edge.line_m) - 1))
    xy = edge.line_m[rows, :2] + FENCE_AWAY_M * edge.right[rows]
    free = shapely.contains_xy(country, xy[:, 0], xy[:, 1])
    free &= (edge.state[rows] == State.GROUND) | (edge.state[rows] == State.BANK)
    free &= ~shapely.dwithin(blocked, shapely.points(xy), CLEAR_M)
    return [xy[a:b] for a, b in runs(free) if (b - a - 1) * POST_STEP_M >= LEAST_M]


def _fence_posts(out: MeshBuilder, foot: Array) -> None:
    low = foot - np.array([POST_HALF_M, POST_HALF_M, 0.3])
    high = foot + np.array([POST_HALF_M, POST_HALF_M, POST_M])
    out.quads(box_quads(low, high), material=Material.WOOD, tag=Tag.FENCE, colour=(205, 198, 186))


def _wires(out: MeshBuilder, foot: Array) -> None:
    """Bands seen from both sides."""
    faces = []
    for height in WIRES_M:
        low = foot + np.array([0.0, 0.0, height - WIRE_HALF_M])
        high = foot + np.array([0.0, 0.0, height + WIRE_HALF_M])
        faces.append(np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1))
    front = np.concatenate(faces)
    both = np.concatenate([front, front[:, ::-1]])
    out.quads(both, material=Material.METAL_GALVANISED, tag=Tag.FENCE, colour=(150, 152, 154))
