"""Trees, hedges, fences, rails, squares and car parks where a town's map has them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import shapely

from carlaloc_env.assets.plants import hedge
from carlaloc_env.assets.posts_and_fences import fence
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area, areas_only, without
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import right_of
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.land import Land
from carlaloc_env.scenery.ground.terrain import Terrain
from carlaloc_env.scenery.mapped import MappedFeature, of_kind
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import PropField
from carlaloc_env.scenery.vegetation.gardens import wall_panel
from carlaloc_env.scenery.vegetation.planting import put_trees

ROW_M = 9.0
"""Distance of the trees of a row [m]."""
PANEL_M = 2.0
"""Length of a piece of fence, wall or hedge [m]."""
GAUGE_M, SLEEPER_M = 1.5, 0.65
"""Distance of the rails, and of the sleepers below them [m]."""
BED_M = 3.4
"""Width of the bed of a track [m]."""
PAVED: dict[str, tuple[Material, tuple[int, int, int]]] = {
    "square": (Material.PAVEMENT, (214, 208, 198)),
    "car_park": (Material.ASPHALT_OLD, (228, 226, 222)),
}
"""Surfaces of areas."""
LIFT_M = 0.03
"""How far such surfaces lie above the ground [m]."""
TRUNK_CLEAR_M = 0.7
"""Distance of trees from houses and carriageways [m]."""


def paved_grounds(features: Sequence[MappedFeature]) -> Area:
    """Ground of squares, car parks and tracks, where nothing grows."""
    areas = [feature.shape for feature in of_kind(features, *PAVED)]
    areas += [shapely.buffer(f.shape, BED_M / 2, cap_style="flat") for f in of_kind(features, "rail")]
    return shapely.union_all(areas)


def add_grounds(out: MeshBuilder, features: Sequence[MappedFeature], taken: Area, ground: Terrain) -> None:
    """Surfaces of squares and car parks, and tracks, off what is `taken`."""
    shapely.prepare(taken)
    for kind, (material, tint) in PAVED.items():
        area = shapely.union_all([feature.shape for feature in of_kind(features, kind)])
        free = areas_only(without(area, taken), 2.0)
        out.sheet(free, 6.0, ground.height, lift_m=LIFT_M, material=material, tag=Tag.GROUND, colour=tint)
    for rail in of_kind(features, "rail"):
        if rail.number("layer", 0.0) == 0.0:
            for line in shapely.get_parts(without(rail.shape, taken)):
                if line.geom_type == "LineString" and line.length > 3.0:
                    _track(out, line, ground)


def _track(out: MeshBuilder, line: shapely.LineString, ground: Terrain) -> None:
    """A bed of gravel, sleepers and two rails."""
    xy = shapely.get_coordinates(shapely.segmentize(line, 4.0))
    left = -right_of(xy)
    z = ground.height(xy)[:, None]

    def strip(a: float, b: float, up: float, material: Material, tag: Tag, grey: int) -> None:
        sides = [np.hstack([xy + left * t, z + up]) for t in (b, a)]
        out.grid(np.stack(sides, axis=1), material=material, tag=tag, colour=(grey, grey, grey - 4))

    strip(-BED_M / 2, BED_M / 2, 0.06, Material.GRAVEL, Tag.GROUND, 190)
    for t in (-GAUGE_M / 2, GAUGE_M / 2):
        strip(t - 0.035, t + 0.035, 0.3, Material.METAL_GALVANISED, Tag.RAIL_TRACK, 170)
        for side in (-0.035, 0.035):
            low, high = (np.hstack([xy + left * (t + side), z + up]) for up in (0.06, 0.3))
            rows = np.stack([low, high] if side < 0 else [high, low], axis=1)
            out.grid(rows, material=Material.METAL_GALVANISED, tag=Tag.RAIL_TRACK, colour=(120, 116, 112))
    at = np.arange(0.3, line.length, SLEEPER_M)
    middle = shapely.get_coordinates(shapely.line_interpolate_point(line, at))
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(line, np.minimum(at + 0.2, line.length)))
    along = ahead - middle
    along = along / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-6)[:, None]
    aside = np.column_stack([-along[:, 1], along[:, 0]])
    up = np.column_stack([middle, ground.height(middle) + 0.12])
    corners = [(-0.12, -1.25), (0.12, -1.25), (0.12, 1.25), (-0.12, 1.25)]
    flat = [np.column_stack([up[:, :2] + along * u + aside * v, up[:, 2]]) for u, v in corners]
    out.quads(np.stack(flat, axis=1), material=Material.CONCRETE, tag=Tag.RAIL_TRACK, colour=(150, 146, 140))


def put_plants(props: PropField, features: Sequence[MappedFeature], land: Land, solid: Area) -> None:
    """Trees, rows of trees, hedges, fences and walls, off houses and carriageways."""
    draw = clock.stream(land.seed, "mapped plants")
    spots: dict[str, list[Array]] = {"broad": [], "needles": []}
    for tree in of_kind(features, "tree"):
        leaves = str(tree.properties.get("leaves", "broad"))
        spots[leaves if leaves in spots else "broad"].append(shapely.get_coordinates(tree.shape))
    for row in of_kind(features, "tree_row"):
        at = np.arange(0.0, row.shape.length, ROW_M)
        spots["broad"].append(shapely.get_coordinates(shapely.line_interpolate_point(row.shape, at)))
    near = shapely.buffer(solid, TRUNK_CLEAR_M)
    shapely.prepare(near)
    for leaves, kinds in (("broad", ("plane", "lime", "park")), ("needles", ("conifer",))):
        xy = np.concatenate([np.zeros((0, 2)), *spots[leaves]])
        xy = xy[~shapely.intersects_xy(near, xy[:, 0], xy[:, 1])]
        put_trees(land, props, kinds, land.on_ground(xy), draw)
    for kind in ("hedge", "fence", "wall"):
        for feature in of_kind(features, kind):
            _line(props, feature, land, solid)


def _line(props: PropField, feature: MappedFeature, land: Land, solid: Area) -> None:
    """Pieces along a line, each turned as the line runs."""
    for line in shapely.get_parts(without(feature.shape, solid)):
        if line.geom_type != "LineString" or line.length < PANEL_M:
            continue
        count = int(line.length / PANEL_M)
        at = np.linspace(0.0, line.length, count + 1)
        points = shapely.get_coordinates(shapely.line_interpolate_point(line, at))
        step = np.diff(points, axis=0)
        size = np.hypot(step[:, 0], step[:, 1]) / PANEL_M
        yaw = elementary.arctan2(step[:, 1], step[:, 0])
        ok = size > 0.5
        bases_m = land.on_ground(points[:-1])[ok]
        if feature.kind == "hedge":
            make = partial(hedge, PANEL_M, detail="low")
        elif feature.kind == "wall":
            make = partial(wall_panel, Material.RUBBLE, (250, 244, 232))
        else:
            make = partial(fence, PANEL_M, 1.2, kind="rails")
        props.put(f"mapped {feature.kind}", make, bases_m, yaw[ok], 1.0)
