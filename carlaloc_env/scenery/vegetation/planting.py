"""Trees, shrubs and long grass away from sidewalks."""

from functools import partial

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.assets.plants import shrub, tufts
from carlaloc_env.assets.trees import DETAILS, tree
from carlaloc_env.core import clock
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.scenery.buildings.building_lots import frontages
from carlaloc_env.scenery.ground.land import Land
from carlaloc_env.scenery.ground.terrain import YARD_M
from carlaloc_env.scenery.meshing.props import PropField

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
    land: Land, props: PropField, kinds: tuple[str, ...], bases_m: Array, draw: np.random.Generator
) -> None:
    """Trees of mixed kinds, sizes and hues at base points (N, 3) [m]."""
    count = len(bases_m)
    if not count:
        return
    kind, variant = draw.integers(0, len(kinds), count), draw.integers(0, PROTOTYPES, count)
    yaw, scale = draw.uniform(0, 2 * np.pi, count), draw.uniform(0.85, 1.15, count)
    tint = draw.uniform(0.8, 1.1, (count, 1)) * draw.uniform(0.93, 1.07, (count, 3))
    detail = tree_detail(land, bases_m[:, :2])
    for k, name in enumerate(kinds):
        for v in range(PROTOTYPES):
            for level, word in enumerate(DETAILS):
                rows = (kind == k) & (variant == v) & (detail == level)
                make = partial(tree, name, v, word)
                props.put((f"tree {name}", v, word), make, bases_m[rows], yaw[rows], scale[rows], tint[rows])


def tree_detail(land: Land, xy_m: Array) -> NDArray[np.int64]:
    """Index into `DETAILS` for trees at points (N, 2) [m]."""
    near = land.near_route(xy_m, DETAIL_M) & (land.route is not None)
    return np.where(near, 0, np.where(land.roads.distance_m(xy_m) < FAR_M, 1, 2))


def put_bushes(props: PropField, bases_m: Array, draw: np.random.Generator) -> None:
    """Bushes of mixed sizes and hues at base points (N, 3) [m]."""
    count = len(bases_m)
    if not count:
        return
    sort = draw.integers(0, 2 * len(_BUSHES), count)
    yaw, scale = draw.uniform(0, 2 * np.pi, count), draw.uniform(0.7, 1.7, count)
    tint = draw.uniform(0.75, 1.1, (count, 1)) * draw.uniform(0.92, 1.08, (count, 3))
    for k in range(2 * len(_BUSHES)):
        rows = sort == k
        make = partial(shrub, k, "low", _BUSHES[k % len(_BUSHES)])
        props.put(("bush", k), make, bases_m[rows], yaw[rows], scale[rows], tint[rows])


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
