"""Trees, shrubs and long grass away from sidewalks.

Waterfronts: a balustrade along the water's edge, palms and planters behind it.
"""

from functools import partial

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.assets.plants import shrub, tufts
from carlaloc_env.assets.primitives import Look, box, lathe
from carlaloc_env.assets.street_furniture import bench, planter
from carlaloc_env.assets.trees import DETAILS, tree
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area, areas_only, rings
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import densify
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.building_lots import frontages
from carlaloc_env.scenery.ground.terrain import YARD_M, Land
from carlaloc_env.scenery.meshing.batches import PropField

STANDS: dict[str, tuple[float, tuple[str, ...]]] = {
    "park": (9.0, ("park", "conifer", "plane", "autumn", "birch", "lime")),
    "residential": (15.0, ("orchard", "birch", "autumn", "conifer", "young", "lime")),
    "small_town": (16.0, ("plane", "autumn", "birch", "orchard", "lime")),
    "rural": (46.0, ("park", "birch", "poplar", "conifer")),
    "highway": (17.0, ("birch", "conifer", "young", "poplar", "plane")),
    "industrial": (30.0, ("birch", "young", "poplar")),
    "downtown": (13.0, ("plane", "lime", "autumn", "birch")),
    "skyscraper": (15.0, ("plane", "lime", "young")),
    "waterfront": (14.0, ("plane", "lime", "conifer")),
}
"""Distance of trees [m] that stand freely in a zone, and their kinds."""
TRUNK_CLEAR_M = {"highway": 9.0, "rural": 5.0}
"""Least distance of trunks from anything paved or built in some zones [m]; 3 m elsewhere."""
DETAIL_M = 22.0
"""Trees this near to the ego's route are detailed [m]."""
FAR_M = 28.0
"""Trees farther than this from all roads are coarse [m]."""
LAWN_M = 1.5
"""Distance of plants from the edge of lawns within paved zones [m]."""
PROTOTYPES = 4
"""Different trees of each kind."""
_BUSHES = ((215, 225, 190), (170, 200, 150), (235, 225, 150), (200, 190, 130))
_BLADES = ((230, 225, 160), (340, 270, 180), (170, 200, 120))


def plant(land: Land, props: PropField, fields: Area) -> None:
    """Scatter trees and bushes over all zones, and long grass along roads without sidewalks.

    Args:
        land: The town's land.
        props: Where they go.
        fields: Sown ground, on which nothing else grows.
    """
    shapely.prepare(fields)
    for kind, area in land.zones:
        if kind in STANDS:
            _stand(land, props, fields, kind, area)
    long_grass(land, props)


def put_trees(
    land: Land, props: PropField, kinds: tuple[str, ...], feet_m: Array, draw: np.random.Generator
) -> None:
    """Trees of mixed kinds, sizes and hues at feet (N, 3) [m]."""
    count = len(feet_m)
    if not count:
        return
    kind, variant = draw.integers(0, len(kinds), count), draw.integers(0, PROTOTYPES, count)
    yaw, scale = draw.uniform(0, 2 * np.pi, count), draw.uniform(0.85, 1.15, count)
    tint = draw.uniform(0.8, 1.1, (count, 1)) * draw.uniform(0.93, 1.07, (count, 3))
    detail = tree_detail(land, feet_m[:, :2])
    for k, name in enumerate(kinds):
        for v in range(PROTOTYPES):
            for level, word in enumerate(DETAILS):
                rows = (kind == k) & (variant == v) & (detail == level)
                make = partial(tree, name, v, word)
                props.put((f"tree {name}", v, word), make, feet_m[rows], yaw[rows], scale[rows], tint[rows])


def tree_detail(land: Land, xy_m: Array) -> NDArray[np.int64]:
    """Index into `DETAILS` for trees at points (N, 2) [m]."""
    near = land.near_route(xy_m, DETAIL_M) & (land.route is not None)
    return np.where(near, 0, np.where(land.roads.distance_m(xy_m) < FAR_M, 1, 2))


def put_bushes(props: PropField, feet_m: Array, draw: np.random.Generator) -> None:
    """Bushes of mixed sizes and hues at feet (N, 3) [m]."""
    count = len(feet_m)
    if not count:
        return
    sort = draw.integers(0, 2 * len(_BUSHES), count)
    yaw, scale = draw.uniform(0, 2 * np.pi, count), draw.uniform(0.7, 1.7, count)
    tint = draw.uniform(0.75, 1.1, (count, 1)) * draw.uniform(0.92, 1.08, (count, 3))
    for k in range(2 * len(_BUSHES)):
        rows = sort == k
        make = partial(shrub, k, "low", _BUSHES[k % len(_BUSHES)])
        props.put(("bush", k), make, feet_m[rows], yaw[rows], scale[rows], tint[rows])


def long_grass(land: Land, props: PropField) -> None:
    """Tufts along the edges of roads without sidewalks."""
    draw = clock.stream(land.seed, "long grass")
    spots = []
    for _, line, extra in frontages([s for s in land.strips if s.junction_id is None]):
        if extra <= 0.0 or len(line) < 3:
            continue
        right = rights(line)
        for distance in (0.9, 1.5, 2.3, 3.4):
            keep = draw.random(len(line)) < 0.85 / (0.4 + distance)
            shift = distance + draw.uniform(-0.3, 0.5, len(line))
            spots.append((line[:, :2] + right * shift[:, None])[keep])
    if not spots:
        return
    xy = np.concatenate(spots)
    xy = xy[
        np.isin(land.zones.kinds_at(xy), ("rural", "highway", "park")) & (land.taken.distance_m(xy) > 0.1)
    ]
    sort, yaw = draw.integers(0, 6, len(xy)), draw.uniform(0, 2 * np.pi, len(xy))
    scale = draw.uniform(0.6, 1.3, len(xy))
    for k in range(6):
        rows = sort == k
        make = partial(tufts, k, 26, 0.55, 0.20 + 0.08 * (k % 3), _BLADES[k % 3])
        props.put(("tuft", k), make, land.on_ground(xy[rows], -0.03), yaw[rows], scale[rows])


def rights(line_m: Array) -> Array:
    """Unit vectors to the right of a polyline (N, 3), shape (N, 2)."""
    tangent = np.gradient(line_m[:, :2], axis=0)
    tangent /= np.maximum(np.sqrt(np.sum(tangent**2, axis=1, keepdims=True)), 1e-9)
    return np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)


def _stand(land: Land, props: PropField, fields: Area, kind: str, area: Area) -> None:
    step, kinds = STANDS[kind]
    draw = clock.stream(land.seed, f"stand/{kind}/{area.area:.0f}")
    x0, y0, x1, y1 = shapely.bounds(area)
    grid = np.meshgrid(np.arange(x0, x1, step), np.arange(y0, y1, step), indexing="ij")
    xy = np.stack([axis.ravel() for axis in grid], axis=-1)
    xy = xy + draw.uniform(0.05 * step, 0.95 * step, xy.shape)
    xy = xy[draw.random(len(xy)) < 0.85]
    shapely.prepare(area)
    inside = shapely.contains_xy(area, xy[:, 0], xy[:, 1]) & ~shapely.intersects_xy(
        fields, xy[:, 0], xy[:, 1]
    )
    xy = xy[inside]
    free = land.taken.distance_m(xy)
    # Nothing grows wild between paving and houses of paved zones.
    border = YARD_M.get(kind, -2.0) + LAWN_M
    on_lawn = land.roads.distance_m(xy) > border
    xy, free = xy[on_lawn], free[on_lawn]
    wood = xy[free > TRUNK_CLEAR_M.get(kind, 3.0)]
    put_trees(land, props, kinds, land.on_ground(wood, -0.05), draw)
    beside = xy + draw.uniform(-0.5 * step, 0.5 * step, xy.shape)
    ok = (land.taken.distance_m(beside) > 2.0) & shapely.contains_xy(area, beside[:, 0], beside[:, 1])
    ok &= ~shapely.intersects_xy(fields, beside[:, 0], beside[:, 1]) & (draw.random(len(xy)) < 0.5)
    ok &= land.roads.distance_m(beside) > border
    put_bushes(props, land.on_ground(beside[ok], -0.05), draw)


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
    feet = land.on_ground((xy + ends) / 2, -0.02)
    props.put("balustrade", balustrade, feet[ok], yaw[ok])
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
