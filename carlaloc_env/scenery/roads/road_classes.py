"""How roads are felt: classes of roughness, covers, repairs and seams.

How rough a town's roads are: their classes of ISO 8608 by type, limit and zone, as levels on a grid.

Fast roads: they are laid and kept better than streets.

Where roads are felt as well as seen: covers, repairs, seams and joints of bridges, with their heights.
"""

from collections.abc import Sequence

import numpy as np

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.lanes import road_limit_mps
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.road.road_events import no_events
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import Levels, State
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.paved_areas import JunctionArea
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.road_markings import beside

MOTORWAY_MPS = 70.0 / 3.6 - 0.1
"""Limit from which a road is fast [m/s]."""
SURFACE = Material.ASPHALT_MOTORWAY
"""Material of their driving lanes."""
DETAILS = 0.3
"""Repairs and cracks on them, as a share of those on streets; covers lie beside them."""


def is_fast(road: Road) -> bool:
    """Whether a road is laid and kept as fast roads are."""
    return road.type == "motorway" or road_limit_mps(road) >= MOTORWAY_MPS


def is_fast_junction(junction: JunctionArea, roads: Sequence[Road]) -> bool:
    """Whether all roads through a junction are fast: where carriageways part and merge."""
    return all(is_fast(roads[strip.road]) for strip in junction.strips)


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
    """One event (1, 7) of `road_events.EVENT_COLUMNS`.

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


PATCH_M = 0.002
"""Height of repairs above the road [m]; paint lies higher."""
SEAL_M, SEAL_WIDTH_M = 0.0016, 0.055
"""Height and width of the bitumen that seals the edges of a repair [m]."""
COVER_M = 0.0025
"""Height of covers and drains above the road [m]."""
COVER_RADIUS_M, COLLAR_M = 0.33, 1.1
"""Radius of a cover, and edge of the square that some are set in [m]."""
COLLARS, COLLAR_GREY = 0.3, (150.0, 190.0)
"""Share of covers that are set in a square of younger asphalt, and its brightness."""
SQUARE = 0.886
"""Half the side of a square over the radius of a disc of the same area."""
REPAIRS: tuple[tuple[Material, tuple[float, float], float, float], ...] = (
    (Material.ASPHALT, (150.0, 205.0), 0.65, 0.3),
    (Material.ASPHALT_OLD, (200.0, 235.0), 0.35, 0.6),
)
"""Materials of repairs: brightness, share of all repairs, share of these with sealed edges."""


def repair_surface(draw: np.random.Generator, only: Material | None = None) -> tuple[Material, float, bool]:
    """Material of a repair (`only` where given), its brightness 0–255, and whether its edges are sealed."""
    kind = int(draw.choice(len(REPAIRS), p=[share for _, _, share, _ in REPAIRS]))
    material, (low, high), _, sealed = REPAIRS[kind]
    return only or material, float(draw.uniform(low, high)), bool(draw.random() < sealed)


def cover_rings() -> Array:
    """Twelve points each of a cover's frame, lid and boss, forward and left of its middle [m], (36, 2)."""
    angle = np.tile(np.arange(12) * (np.pi / 6), 3)
    radius = np.repeat([COVER_RADIUS_M, COVER_RADIUS_M - 0.06, 0.12], 12)
    # Angles run from left to forward: clockwise seen from above.
    return np.stack([radius * elementary.sin(angle), radius * elementary.cos(angle)], axis=-1)


def lay_cover(out: MeshBuilder, rings: Array) -> None:
    """A cover: its frame and the boss in its middle are worn blank; points (36, 3) of `cover_rings`."""
    fan = np.stack([np.zeros(10, int), np.arange(1, 11), np.arange(2, 12)], axis=-1)
    for k, grey in enumerate((40.0, 20.0, 28.0)):
        ring = rings[12 * k : 12 * k + 12] + np.array([0.0, 0.0, COVER_M + 0.0004 * k])
        out.triangles(
            ring, fan[:, ::-1], material=Material.PLAIN, tag=Tag.ROAD, colour=(grey, 0.97 * grey, 0.93 * grey)
        )
