"""A building over a street: wings on both sides, storeys above, and a lit passage between them."""

from dataclasses import dataclass, replace

import numpy as np
import shapely

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import Feature
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.buildings import FOUNDATION_M, draw_appearance
from carlaloc_env.scenery.buildings.facades import facade
from carlaloc_env.scenery.buildings.roofs import add_roof
from carlaloc_env.scenery.buildings.shell import Shell
from carlaloc_env.scenery.buildings.styles import STYLES
from carlaloc_env.scenery.buildings.walls import around
from carlaloc_env.scenery.ground.height_fields import HeightOf
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads
from carlaloc_env.scenery.meshing.props import copies, poses

WIDTH_M, DEPTH_M, STOREYS = 52.0, 24.0, 6
"""Usual measures across the street and along it [m], and storeys."""
PASSAGE_M = 6.2
"""From the street to the floor above it [m]."""
SLAB_M, BEAM_M = 0.35, 0.4
"""Thickness of that floor, and height of the beams below it [m]."""
BEAM_STEP_M, BEAM_WIDTH_M = 4.0, 0.5
"""Distance of the beams and their width [m]."""
WING_CLEARANCE_M = 0.25
"""Distance of the wings from everything paved [m]."""
LEAST_WING_M = 6.0
"""Narrowest wing [m]."""
TUBE_M = 1.4
"""Length of the tubes that light the passage [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Measures:
    """Measures of a gatehouse in its own frame: x across the street, y along it, the front on y = 0."""

    width_m: float
    depth_m: float
    storeys: int
    open_m: tuple[float, float]
    """Where the passage begins and ends along x [m]."""
    base_m: float
    """Height of the street [m]."""


def gatehouse(feature: Feature, paved: Area, floor: HeightOf) -> Mesh:
    """The building in the world; the street runs along its heading."""
    draw = clock.stream(0, f"gatehouse/{feature.position}")
    style = replace(STYLES["civic"], ground_m=PASSAGE_M, ground="shop", storey_m=3.6, ornaments=("quoins",))
    shell = Shell(out=MeshBuilder(), look=draw_appearance(style, draw))
    m = _measures(feature, paved, floor)
    levels = np.concatenate([[0.0], PASSAGE_M + style.storey_m * np.arange(m.storeys)])
    for first, last, inner in ((0.0, m.open_m[0], 1), (m.open_m[1], m.width_m, 3)):
        _wing(shell, (first, last, m.depth_m), levels[:2], inner, draw)
    upstairs = replace(shell, look=replace(shell.look, style=replace(style, ground="hall")))
    for side, wall in enumerate(around(m.width_m, m.depth_m, float(levels[1]))):
        facade(upstairs, wall, levels[1:] - levels[1], draw, front=side in (0, 2))
    add_roof(shell, (0.0, 0.0, m.width_m, m.depth_m), float(levels[-1]), draw, top=True)
    _ceiling(shell, m)
    return copies(shell.out.build(), _pose(feature, m), 0)


def gatehouse_lamps(feature: Feature, paved: Area, floor: HeightOf) -> Array:
    """Light sources below the ceiling of its passage [m], shape (K, 3)."""
    m = _measures(feature, paved, floor)
    tubes = _tubes(m)
    points = np.column_stack([tubes, np.full(len(tubes), PASSAGE_M - SLAB_M - 0.3), np.ones(len(tubes))])
    placed: Array = elementary.matrix_product(points, _pose(feature, m)[0].T)[:, :3]
    return placed


def _measures(feature: Feature, paved: Area, floor: HeightOf) -> _Measures:
    size = feature.size
    width, depth = (size[0], size[1]) if len(size) > 1 else (WIDTH_M, DEPTH_M)
    heading = np.radians(feature.heading_deg)
    ahead = np.array([elementary.cos(heading), elementary.sin(heading)])
    # The building's x axis, seen from before its front: to the right.
    across = np.array([-ahead[1], ahead[0]])
    along = np.linspace(-0.5 * depth, 0.5 * depth, 13)[:, None] * ahead + feature.position
    reach = []
    shapely.prepare(paved)
    for sign in (-1.0, 1.0):
        away_m = np.arange(2.0, 0.5 * width - LEAST_WING_M, 0.25)
        points = along[:, None] + sign * away_m[:, None] * across
        taken = shapely.dwithin(paved, shapely.points(points), WING_CLEARANCE_M).any(axis=0)
        reach.append(float(away_m[np.flatnonzero(taken)[-1]]) + 0.25 if taken.any() else 2.0)
    return _Measures(
        width_m=width,
        depth_m=depth,
        storeys=int(size[2]) if len(size) > 2 else STOREYS,
        open_m=(0.5 * width - reach[0], 0.5 * width + reach[1]),
        base_m=float(floor(along).max()),
    )


def _pose(feature: Feature, m: _Measures) -> Array:
    """Transform (1, 4, 4) of the building's frame to the world."""
    heading = np.radians(feature.heading_deg)
    c, s = elementary.cos(heading), elementary.sin(heading)
    x, y = 0.5 * m.depth_m, -0.5 * m.width_m
    corner = (feature.position[0] + c * x - s * y, feature.position[1] + s * x + c * y, m.base_m)
    result: Array = poses([corner], heading + np.pi / 2)
    return result


def _wing(
    shell: Shell,
    place: tuple[float, float, float],
    levels: Array,
    inner: int,
    draw: np.random.Generator,
) -> None:
    """Ground floor of one wing, with shops towards the street's ends and in the passage."""
    first, last, depth = place
    for side, wall in enumerate(around(last - first, depth)):
        shifted = wall.moved((first, 0.0, 0.0))
        facade(shell, shifted, levels, draw, front=side in (0, 2, inner))
        shell.trim(shifted.front(0.0, wall.width_m, -FOUNDATION_M, 0.0, 0.02))


def _ceiling(shell: Shell, m: _Measures) -> None:
    """Underside of the storeys above the street, its beams and lamps."""
    x0, x1 = m.open_m
    z = PASSAGE_M - SLAB_M
    slab = box_quads([x0, 0.02, z], [x1, m.depth_m - 0.02, PASSAGE_M + 0.05], bottom=True)
    shell.faces(slab, Material.CONCRETE_PANEL, (214, 212, 206))
    rows = np.arange(0.5 * BEAM_STEP_M, m.depth_m - 1.0, BEAM_STEP_M)
    low = np.column_stack([np.full(len(rows), x0), rows - 0.5 * BEAM_WIDTH_M, np.full(len(rows), z - BEAM_M)])
    high = np.column_stack([np.full(len(rows), x1), rows + 0.5 * BEAM_WIDTH_M, np.full(len(rows), z + 0.02)])
    beams = box_quads(low, high, bottom=True)
    shell.faces(beams, Material.CONCRETE, (198, 196, 190))
    half = np.array([0.5 * TUBE_M, 0.1])
    tubes = _tubes(m)
    low = np.column_stack([tubes - half, np.full(len(tubes), z - 0.08)])
    high = np.column_stack([tubes + half, np.full(len(tubes), z)])
    shell.out.quads(box_quads(low, high, bottom=True), material=Material.LAMP_WHITE, tag=Tag.STATIC)


def _tubes(m: _Measures) -> Array:
    """Middles of the tubes between the beams, in the building's frame [m], shape (K, 2)."""
    x0, x1 = m.open_m
    rows = np.arange(BEAM_STEP_M, m.depth_m - 1.0, BEAM_STEP_M)
    return np.array([(x0 + share * (x1 - x0), y) for y in rows for share in (0.2, 0.5, 0.8)])
