"""Events that wheels feel on a road: covers, patches, seams, and joints of bridges, with their heights."""

from collections.abc import Sequence

import numpy as np

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.road.road_events import no_events
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import Levels, State
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.road_markings import beside

HEIGHT_M: dict[str, tuple[float, float]] = {
    "cover": (-0.012, 0.004),
    "patch": (-0.004, 0.006),
    "seam": (-0.004, 0.003),
    "bridge joint": (-0.012, -0.004),
}
"""How much lower or higher than the road each kind lies, from and to [m]: covers settle, repairs stand
proud until traffic has rolled them down, joints of bridges leave a gap."""
JOINT_M, JOINT_LIFT_M = 0.24, 0.0024
"""Width of a bridge's joint as it is seen, and its height in the picture [m]."""
_GAP_M = 0.1
"""Width of the gap that wheels feel [m]."""


def felt(kind: str, corners_m: Array, draw: np.random.Generator) -> Array:
    """One event as a row (1, 7) of `road_events.EVENT_COLUMNS`.

    Args:
        kind: One of `HEIGHT_M`.
        corners_m: Three corners in world x and y [m], two along and two across, shape (3, 2).
        draw: Draws its height.
    """
    a, b, c = corners_m
    along, across = b - a, c - b
    length, width = float(np.hypot(*along)), float(np.hypot(*across))
    cos, sin = along / max(length, 1e-6)
    x, y = 0.5 * (a + c)
    return np.array([[x, y, cos, sin, 0.5 * length, 0.5 * width, draw.uniform(*HEIGHT_M[kind])]])


def felt_on(
    strip: Strip,
    edge: int,
    kind: str,
    span_m: tuple[float, float],
    across_m: tuple[float, float],
    draw: np.random.Generator,
) -> Array:
    """One event on a strip: stations and distances to the left of an edge, from and to [m]."""
    (s0, s1), (o0, o1) = span_m, across_m
    corners = beside(strip, edge, np.array([s0, s1, s1]), np.array([o0, o0, o1]))
    return felt(kind, corners[:, :2], draw)


def add_bridge_joints(out: MeshBuilder, strips: Sequence[Strip], levels: Levels, seed: int) -> Array:
    """Joints across the roadway where decks begin and end; their events, shape (N, 7)."""
    events = [no_events()]
    for number, strip in enumerate(strips):
        rows = levels.graph.rows(number)
        span = strip.span(("roadway",))
        if strip.junction_id is not None or span is None or rows.stop - rows.start < 2:
            continue
        on_piers = levels.state[rows] == State.OPEN
        s = levels.graph.s_m[rows]
        draw = clock.stream(seed, f"bridge joints/{strip.road_id}/{strip.section}")
        for k in np.flatnonzero(on_piers[1:] != on_piers[:-1]):
            at = float(np.clip(0.5 * (s[k] + s[k + 1]), s[0] + JOINT_M, s[-1] - JOINT_M))
            _lay_joint(out, strip, span, at)
            width = float(np.interp(at, strip.s_m, strip.t_m[span[0]] - strip.t_m[span[1]]))
            gap = (at - 0.5 * _GAP_M, at + 0.5 * _GAP_M)
            events.append(felt_on(strip, span[1], "bridge joint", gap, (0.0, width), draw))
    return np.concatenate(events)


def _lay_joint(out: MeshBuilder, strip: Strip, span: tuple[int, int], at_m: float) -> None:
    """A dark band across all lanes of a carriageway."""
    s = np.array([at_m - 0.5 * JOINT_M, at_m + 0.5 * JOINT_M])
    lines = [beside(strip, edge, s, 0.0) for edge in range(span[1], span[0] - 1, -1)]
    points = np.stack(lines, axis=1) + np.array([0.0, 0.0, JOINT_LIFT_M])
    out.grid(points, material=Material.PLAIN, tag=Tag.ROAD, colour=(38.0, 38.0, 40.0))
