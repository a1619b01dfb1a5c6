"""Waterfronts: a balustrade along the water's edge, palms and planters behind it."""

from functools import partial

import numpy as np
import shapely

from carlaloc_env.assets.plants import shrub
from carlaloc_env.assets.primitives import Look, box, lathe
from carlaloc_env.assets.street_furniture import bench, planter
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import areas_only, rings
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import densify
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.land import Land
from carlaloc_env.scenery.meshing.props import PropField
from carlaloc_env.scenery.vegetation.planting import put_trees, rights

BAY_M = 2.0
"""Length of one bay of the balustrade [m]."""
EDGE_M = 0.7
"""Distance of the balustrade from the water's edge [m]."""
KEPT_M = 3.0
"""Distance from roads that bridges need free [m]."""


def line_waterfront(props: PropField, land: Land) -> None:
    """Furnish the edges where waterfront zones meet water."""
    water, shore = land.zones.area("water"), land.zones.area("waterfront")
    if water.is_empty or shore.is_empty:
        return
    near = shapely.buffer(shore, 1.5)
    shapely.prepare(near)
    draw = clock.stream(land.seed, "promenade")
    # The water lies on each ring's left, the shore on its right.
    for ring in rings(areas_only(water), 400.0):
        line = densify(np.column_stack([ring, np.zeros(len(ring))]), 1.0)
        _edge(props, land, line, near, draw)


def _edge(
    props: PropField, land: Land, line: Array, near: shapely.Geometry, draw: np.random.Generator
) -> None:
    right = rights(line)
    rows = np.arange(0, len(line) - int(BAY_M), int(BAY_M))
    xy = line[rows, :2] + right[rows] * EDGE_M
    ends = line[rows + int(BAY_M), :2] + right[rows + int(BAY_M)] * EDGE_M
    ok = shapely.contains_xy(near, *xy.T) & shapely.contains_xy(near, *ends.T)
    ok &= (land.roads.distance_m(xy) > KEPT_M) & (land.roads.distance_m(ends) > KEPT_M)
    length = np.sqrt(np.sum((ends - xy) ** 2, axis=1))
    ok &= (length > 0.5 * BAY_M) & (length < 1.4 * BAY_M)
    yaw = elementary.arctan2(ends[:, 1] - xy[:, 1], ends[:, 0] - xy[:, 0])
    bases_m = land.on_ground((xy + ends) / 2, -0.02)
    props.put("balustrade", balustrade, bases_m[ok], yaw[ok])
    inland = elementary.arctan2(-right[:, 1], -right[:, 0])
    for step, first, distance, name in ((9, 3, 3.2, "palm"), (9, 7, 2.2, "planter"), (18, 1, 1.7, "bench")):
        at = np.arange(first, len(line), step)
        spots = line[at, :2] + right[at] * distance
        keep = shapely.contains_xy(near, *spots.T) & (land.taken.distance_m(spots) > 1.2)
        where = land.on_ground(spots[keep])
        if name == "palm":
            put_trees(land, props, ("palm",), where, draw)
        elif name == "planter":
            props.put("promenade planter", planter, where, inland[at][keep])
            make = partial(shrub, 1, "low", (235, 190, 170))
            props.put("planted shrub", make, where + np.array([0.0, 0.0, 0.35]), inland[at][keep])
        else:
            props.put("promenade bench", bench, where, inland[at][keep])


def balustrade() -> Mesh:
    """One bay along x, centred on the origin: a pedestal at its left end, seven balusters, a hand rail."""
    stone = Look(Material.CONCRETE, Tag.FENCE, (255, 248, 232))
    half = BAY_M / 2
    profile = [(0.09, 0.16), (0.05, 0.22), (0.105, 0.40), (0.05, 0.66), (0.09, 0.76)]
    parts = [
        lathe(stone, profile, 6, (float(x), 0.0, 0.0)) for x in np.linspace(-half + 0.42, half - 0.14, 6)
    ]
    parts += [
        box(stone, (BAY_M, 0.30, 0.36), (0.0, 0.0, -0.02)),
        box(stone, (BAY_M, 0.26, 0.16), (0.0, 0.0, 0.84)),
        box(stone, (0.36, 0.36, 1.4), (-half + 0.05, 0.0, 0.3)),
        box(stone, (0.44, 0.44, 0.08), (-half + 0.05, 0.0, 1.04)),
    ]
    return merge(parts)
