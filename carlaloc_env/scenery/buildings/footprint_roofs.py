"""Roofs over outlines of any shape: flat with parapets, of one slope, or rising from every edge alike."""

from __future__ import annotations

import itertools

import numpy as np
import shapely

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area, polygons_of, rings
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.roofs import add_roof
from carlaloc_env.scenery.buildings.shell import Shell
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import poses
from carlaloc_env.scenery.meshing.triangulation import delaunay_triangles, twice_area

PARAPET_M, PARAPET_DEPTH_M = 0.6, 0.25
"""Height and depth of the wall round a flat roof [m]."""
EAVES_M = 0.35
"""How far other roofs reach over their walls [m]."""
SLOPE = 0.65
"""Rise of a pitched roof over its run where no tag says it."""
USUAL_PITCH_DEG = 12.0
"""Angle of roofs of one slope where no tag says it [deg]."""
BOARD_M = 0.1
"""Thickness of roofs at their eaves [m]."""
HIGHEST_M = 7.0
"""Highest of these [m]."""
STEPS = (0.0, 0.3, 0.6, 0.85, 1.0)
"""Insets at which such a roof is cut, in parts of the largest one: its faces are planes between them."""
RECTANGULAR = 0.94
"""Outlines that fill this share of the rectangle round them are rectangles."""
_ROUND = ("dome", "onion", "round")
"""Roofs that are steepest at their foot and level at their top."""


def roof_rise(outline: Area, shape: str, tagged_m: float) -> float:
    """Height of a roof above its walls [m]."""
    if shape == "flat":
        return 0.0
    if tagged_m > 0.0:
        return tagged_m
    reach = _reach(outline)
    if shape in (*_ROUND, "pyramidal", "cone"):
        return min(2.0 * reach * SLOPE, 2.0 * HIGHEST_M)
    return min(reach * SLOPE, HIGHEST_M)


def _reach(outline: Area) -> float:
    """Radius of the largest circle in an outline [m]."""
    return float(shapely.length(shapely.maximum_inscribed_circle(outline, tolerance=0.1)))


def add_footprint_roof(
    shell: Shell, outline: Area, z: float, shape: str, rise_m: float, rng: np.random.Generator, fall: Array
) -> None:
    """Roof an outline whose walls end at height z [m]; `fall` as `downhill` gives it."""
    box = _rectangle(outline)
    if shape == "flat" or rise_m < 0.3:
        _flat(shell, outline, z)
    elif shape == "skillion":
        _sloping(shell, outline, z, rise_m, fall)
    elif shape in ("gable", "front_gable") and box is not None:
        _over_rectangle(shell, box, z, shape, rng)
    else:
        _rising(shell, outline, z, rise_m, curved=shape in _ROUND)


def downhill(outline: Area, bearing_deg: float) -> Array:
    """Direction (2,) in which a roof of one slope falls: by its bearing, or off the longest wall for NaN."""
    if np.isfinite(bearing_deg):
        bearing = np.radians(bearing_deg)
        return np.array([float(elementary.sin(bearing)), float(elementary.cos(bearing))])
    corners = shapely.get_coordinates(shapely.orient_polygons(outline).exterior)
    walls = np.diff(corners, axis=0)
    length = np.hypot(*walls.T)
    x, y = walls[np.argmax(length)] / length.max()
    return np.array([y, -x])


def towards(points: Array, direction: Array) -> Array:
    """How far points (..., 2 or more) lie along a direction (2,) [m]."""
    result: Array = points[..., 0] * direction[0] + points[..., 1] * direction[1]
    return result


def _rectangle(outline: Area) -> Array | None:
    """Corners of a rectangle, its longer side first, anticlockwise; None for other outlines."""
    if outline.interiors:
        return None
    around = shapely.minimum_rotated_rectangle(outline)
    if around.geom_type != "Polygon" or outline.area < RECTANGULAR * around.area:
        return None
    corners = shapely.get_coordinates(shapely.orient_polygons(around).exterior)[:4]
    sides = np.hypot(*(corners[1] - corners[0])), np.hypot(*(corners[2] - corners[1]))
    return np.asarray(corners if sides[0] >= sides[1] else np.roll(corners, -1, axis=0))


def _over_rectangle(shell: Shell, box: Array, z: float, shape: str, rng: np.random.Generator) -> None:
    """One of our own roofs, laid along the longer side."""
    along = box[1] - box[0]
    width, depth = float(np.hypot(*along)), float(np.hypot(*(box[2] - box[1])))
    local = Shell(out=MeshBuilder(), look=shell.look)
    add_roof(local, (0.0, 0.0, width, depth), z, rng, top=True)
    turn = float(elementary.arctan2(along[1], along[0]))
    shell.out.add(local.out.build().transformed(poses([(*box[0], 0.0)], turn)[0]))


def _flat(shell: Shell, outline: Area, z: float) -> None:
    """A deck, and a parapet where it is wide enough for one."""
    inner = shapely.buffer(outline, -PARAPET_DEPTH_M, join_style="mitre", mitre_limit=3.0)
    if inner.area < 0.5 * outline.area:
        add_level(shell, outline, z, Material.ROOF_FLAT, (190, 188, 185))
        return
    top = z + PARAPET_M
    add_level(shell, inner, z, Material.ROOF_FLAT, (190, 188, 185))
    add_level(shell, shapely.difference(outline, inner), top, shell.look.material, shell.look.tint)
    for line in [*(ring[::-1] for ring in rings(inner)), *rings(outline)]:
        shell.wall(upright(line[:-1], line[1:], z, top))


def _sloping(shell: Shell, outline: Area, z: float, rise_m: float, fall: Array) -> None:
    """Boards on one plane, which falls to z at the walls of its foot; the other walls go up to it."""
    down = towards(shapely.get_coordinates(outline), fall)
    grade = rise_m / float(np.ptp(down))

    def at(points: Array, over_m: float = 0.0) -> Array:
        height = z + grade * (down.max() - towards(points, fall)) + over_m
        return np.concatenate([points[..., :2], height[..., None]], axis=-1)

    eaves = shapely.buffer(outline, EAVES_M, join_style="mitre", mitre_limit=2.0)
    _add(shell, at(_triangles(eaves).reshape(-1, 2), BOARD_M), *shell.look.roof)
    under = _triangles(shapely.difference(eaves, outline))[:, ::-1].reshape(-1, 2)
    _add(shell, at(under), Material.WOOD, shell.look.trim)
    for line in rings(eaves):
        board = upright(line[:-1], line[1:], 0.0, 0.0)
        shell.trim(np.concatenate([at(board[:, :2]), at(board[:, 2:], BOARD_M)], axis=1), Material.WOOD)
    for line in rings(outline):
        walls = upright(line[:-1], line[1:], z, z)
        shell.wall(np.concatenate([walls[:, :2], at(walls[:, 2:])], axis=1))


def _rising(shell: Shell, outline: Area, z: float, rise_m: float, *, curved: bool) -> None:
    """Faces that rise from all edges: rings between insets, each in its plane."""
    eaves = shapely.buffer(outline, EAVES_M, join_style="mitre", mitre_limit=2.0)
    eaves = max(polygons_of(eaves), key=lambda part: part.area)
    reach = _reach(eaves)
    drop = rise_m * EAVES_M / max(reach, EAVES_M + 0.1)
    insets = [shapely.buffer(eaves, -s * reach * 0.985, join_style="mitre", mitre_limit=4.0) for s in STEPS]
    rises = [z - drop + (rise_m + drop) * (s * (2.0 - s) if curved else s) for s in STEPS]
    for k, (low, high) in enumerate(itertools.pairwise(insets)):
        _ring(shell, low, high, rises[k], rises[k + 1])
    for part in polygons_of(insets[-1]):
        add_level(shell, part, rises[-1], *shell.look.roof)
    add_level(
        shell,
        shapely.difference(eaves, outline),
        rises[0] - BOARD_M,
        Material.WOOD,
        shell.look.trim,
        down=True,
    )
    line = shapely.get_coordinates(shapely.orient_polygons(eaves).exterior)
    shell.trim(upright(line[:-1], line[1:], rises[0] - BOARD_M, rises[0]), Material.WOOD)


def _ring(shell: Shell, low: Area, high: Area, z_low: float, z_high: float) -> None:
    ring = shapely.difference(low, high)
    corners = _triangles(ring)
    if not len(corners):
        return
    flat = corners.reshape(-1, 2)
    inner = np.zeros(len(flat), dtype=bool)
    if not high.is_empty:
        inner = shapely.distance(shapely.points(flat), high) < 1e-4
    points = np.column_stack([flat, np.where(inner, z_high, z_low)])
    material, tint = shell.look.roof
    _add(shell, points, material, tint)


def add_level(
    shell: Shell, area: Area, z: float, material: Material, tint: tuple[int, int, int], *, down: bool = False
) -> None:
    """A level face over an area, seen from above, or from below where it looks `down`."""
    corners = _triangles(area)
    if not len(corners):
        return
    if down:
        corners = corners[:, ::-1]
    flat = corners.reshape(-1, 2)
    _add(shell, np.column_stack([flat, np.full(len(flat), z)]), material, tint)


def _add(shell: Shell, points: Array, material: Material, tint: tuple[int, int, int]) -> None:
    # Degenerate quads keep every face flat.
    corners = points.reshape(-1, 3, 3)
    quads = np.concatenate([corners, corners[:, 2:]], axis=1)
    shell.out.quads(quads, material=material, tag=Tag.BUILDING, colour=tint)


def _triangles(area: Area) -> Array:
    """Anticlockwise triangles (T, 3, 2) of an area."""
    corners = delaunay_triangles(polygons_of(area))
    area2 = twice_area(corners)
    turned = np.where((area2 < 0)[:, None, None], corners[:, ::-1], corners)
    result: Array = turned[np.abs(area2) > 1e-6]
    return result


def upright(a: Array, b: Array, low: float, high: float) -> Array:
    """Upright faces (N, 4, 3) over edges from a to b (N, 2), seen from the right of their direction."""
    count = len(a)
    foot, head = np.full((count, 1), low), np.full((count, 1), high)
    corners = [np.hstack([a, foot]), np.hstack([b, foot]), np.hstack([b, head]), np.hstack([a, head])]
    return np.stack(corners, axis=1)
