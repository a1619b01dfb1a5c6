"""Fields: rural land cut into plots with standing crops, ploughed earth, meadows and orchards."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely

from carlaloc_env.assets.plants import bale, maize, stalks
from carlaloc_env.assets.posts_and_fences import fence_panel
from carlaloc_env.assets.trees import DETAILS, tree
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area, areas_only, polygons_of, rings
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.land import Land
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, extrude
from carlaloc_env.scenery.meshing.props import PropField
from carlaloc_env.scenery.meshing.triangulation import triangulate
from carlaloc_env.scenery.vegetation.planting import PROTOTYPES, put_bushes, tree_detail

VERGE_M = 5.5
"""Grass between a field and anything paved [m]."""
PLOT_M = (55.0, 120.0)
"""Sides between which plots lie [m]."""
TRACK_M = 3.0
"""Grass between two plots [m]."""
NEAR_M = 34.0
"""Fields show single plants as far as this from the roads [m]."""
CELL_M = 8.0
"""Side of a field's triangles [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crop:
    """The crop of a plot."""

    height_m: float
    """Height of the stand [m]; 0.1 for bare earth."""
    material: Material
    """Surface of the stand."""
    tint: Colour
    """Linear tint of the stand."""
    blades: Colour = (255, 255, 255)
    """Linear tint of single plants at its border."""


CROPS: dict[str, Crop] = {
    "wheat": Crop(height_m=0.8, material=Material.CROP, tint=(255, 212, 128), blades=(447, 330, 190)),
    "barley": Crop(height_m=0.7, material=Material.CROP, tint=(175, 190, 105), blades=(380, 320, 190)),
    "rape": Crop(height_m=1.2, material=Material.CROP, tint=(255, 228, 22), blades=(447, 330, 60)),
    "beet": Crop(height_m=0.35, material=Material.LEAF, tint=(128, 185, 144), blades=(190, 235, 160)),
    "maize": Crop(height_m=1.9, material=Material.LEAF, tint=(103, 152, 99), blades=(205, 235, 140)),
    "ploughed": Crop(height_m=0.12, material=Material.FURROWS, tint=(255, 250, 245)),
    "stubble": Crop(height_m=0.12, material=Material.CROP, tint=(205, 180, 120)),
}
"""Crops that cover their plots."""
KINDS = (*CROPS, *CROPS, "meadow", "pasture", "orchard", "wheat", "maize")
"""Kinds of plots, each as likely as it is often named."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plot:
    """A field."""

    kind: str
    """One of `KINDS`."""
    area: Area
    """Ground that it covers."""
    turn_rad: float
    """Direction of its rows [rad]."""


def lay_plots(land: Land) -> list[Plot]:
    """Cut the rural zones into plots; no two that touch hold the same."""
    plots: list[Plot] = []
    for kind, area in land.zones:
        if kind != "rural":
            continue
        draw = clock.stream(land.seed, f"plots/{area.area:.0f}")
        for part in polygons_of(area):
            if part.area > 400.0:
                plots += _cut(land, part, draw, plots)
    return plots


def add_plots(out: MeshBuilder, props: PropField, land: Land, plots: Sequence[Plot]) -> Area:
    """Build all fields; returns the ground on which nothing else may stand."""
    for number, plot in enumerate(plots):
        draw = clock.stream(land.seed, "plot", index=number)
        if plot.kind in CROPS:
            _stand(out, land, plot, draw)
            _border_plants(props, land, plot, draw)
        elif plot.kind == "orchard":
            _orchard(props, land, plot, draw)
        elif plot.kind == "meadow":
            _bales(props, land, plot, draw)
        if plot.kind == "pasture":
            _fence(props, land, plot)
        elif plot.kind in ("meadow", "orchard", "barley"):
            _hedgerow(props, land, plot, draw)
    return shapely.union_all([plot.area for plot in plots]) if plots else shapely.Polygon()


def _cut(land: Land, part: Area, draw: np.random.Generator, before: Sequence[Plot]) -> list[Plot]:
    """Plots of one polygon: its smallest rectangle split again and again, less verges and what is built."""
    box = np.asarray(shapely.get_coordinates(shapely.minimum_rotated_rectangle(part)))[:4]
    side = box[1] - box[0]
    turn = float(elementary.arctan2(side[1], side[0]))
    axes = np.array(
        [[elementary.cos(turn), elementary.sin(turn)], [-elementary.sin(turn), elementary.cos(turn)]]
    )
    local = elementary.matrix_product(box - box[0], axes.T)
    low, high = local.min(axis=0), local.max(axis=0)
    plots: list[Plot] = []
    for x0, y0, x1, y1 in _split(low, high, draw):
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        corners = corners + np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * TRACK_M / 2
        whole = shapely.intersection(shapely.Polygon(elementary.matrix_product(corners, axes) + box[0]), part)
        rows = turn if x1 - x0 > y1 - y0 else turn + np.pi / 2
        for area in _free_parts(land, whole):
            near = {p.kind for p in [*before, *plots] if shapely.dwithin(p.area, area, 2 * VERGE_M + 14.0)}
            choice = [k for k in KINDS if k not in near] or list(KINDS)
            kind = choice[int(draw.integers(len(choice)))]
            plots.append(Plot(kind=kind, area=area, turn_rad=rows))
    return plots


def _split(low: Array, high: Array, draw: np.random.Generator) -> list[tuple[float, float, float, float]]:
    size = high - low
    axis = int(size[1] > size[0])
    if size[axis] < PLOT_M[1] and size[1 - axis] < PLOT_M[1]:
        return [(float(low[0]), float(low[1]), float(high[0]), float(high[1]))]
    share = draw.uniform(0.38, 0.62)
    middle = low[axis] + share * size[axis]
    upper, lower = high.copy(), low.copy()
    upper[axis] = lower[axis] = middle
    return _split(low, upper, draw) + _split(lower, high, draw)


def _free_parts(land: Land, whole: Area) -> list[Area]:
    """Parts of a plot that keep a verge from everything, found on a grid of 3 m."""
    if whole.is_empty or whole.area < 300.0:
        return []
    x0, y0, x1, y1 = shapely.bounds(whole)
    step = 3.0
    x, y = np.arange(x0, x1, step) + step / 2, np.arange(y0, y1, step) + step / 2
    grid = np.stack([a.ravel() for a in np.meshgrid(x, y, indexing="ij")], axis=-1)
    if not len(grid):
        return []
    blocked = grid[land.taken.distance_m(grid) < VERGE_M + 0.75 * step]
    if len(blocked):
        half = step / 2 + 0.01
        cells = shapely.box(*(blocked - half).T, *(blocked + half).T)
        whole = shapely.difference(whole, shapely.union_all(cells))
    smooth = shapely.buffer(shapely.buffer(whole, -6.0), 5.0)
    return [part for part in polygons_of(areas_only(smooth)) if part.area > 350.0]


def _stand(out: MeshBuilder, land: Land, plot: Plot, draw: np.random.Generator) -> None:
    """Surface of the crop and the border of its stand."""
    crop = CROPS[plot.kind]
    xy, triangles = triangulate(plot.area, CELL_M)
    if not len(xy):
        return
    uneven = draw.normal(0.0, 0.06, len(xy)) if crop.height_m > 0.3 else np.zeros(len(xy))
    z = land.ground.height(xy) + crop.height_m * (1.0 + uneven)
    c, s = elementary.cos(plot.turn_rad), elementary.sin(plot.turn_rad)
    uv = np.stack([c * xy[:, 0] + s * xy[:, 1], c * xy[:, 1] - s * xy[:, 0]], axis=-1)
    light = draw.uniform(0.86, 1.0, len(xy)) * draw.uniform(0.85, 1.0)
    tint = np.array(crop.tint) * light[:, None]
    tall = crop.height_m > 0.3
    tag = Tag.VEGETATION if tall else Tag.TERRAIN
    out.triangles(np.column_stack([xy, z]), triangles, material=crop.material, tag=tag, uv_m=uv, colour=tint)
    for ring in rings(plot.area, 4.0):
        # The area lies on the ring's left; its outside on the right.
        foot, head = land.on_ground(ring, -0.4), land.on_ground(ring, crop.height_m)
        if not tall:
            grown = shapely.buffer(plot.area, 0.5)
            outer = shapely.get_coordinates(
                shapely.shortest_line(shapely.boundary(grown), shapely.points(ring))
            )
            foot[:, :2] = outer[::2]
        corners, along = extrude(foot, head)
        shade = tuple(int(0.8 * v) for v in crop.tint)
        out.quads(corners, material=crop.material, tag=tag, uv_m=along[..., ::-1], colour=shade)


def _border_plants(props: PropField, land: Land, plot: Plot, draw: np.random.Generator) -> None:
    """Single plants along the border and on top of the stand where roads are near."""
    crop = CROPS[plot.kind]
    if crop.height_m < 0.3:
        return
    shapely.prepare(plot.area)
    step = 0.9 if plot.kind != "maize" else 0.75
    xy = _grid_over(plot.area, plot.turn_rad, step, step)
    roads = land.roads.distance_m(xy)
    xy = xy[(roads > 0) & (roads < NEAR_M) & (draw.random(len(xy)) < np.clip(1.3 - roads / NEAR_M, 0.0, 1.0))]
    xy = xy[shapely.contains_xy(plot.area, xy[:, 0], xy[:, 1])]
    if not len(xy):
        return
    edge = shapely.distance(shapely.boundary(plot.area), shapely.points(xy))
    deep = 1.6 if plot.kind != "maize" else 2.4
    keep = (edge < deep) | (draw.random(len(xy)) < 0.16)
    xy = xy[keep] + draw.uniform(-0.15, 0.15, (int(keep.sum()), 2))
    sort = draw.integers(0, 4, len(xy))
    yaw, scale = draw.uniform(0, 2 * np.pi, len(xy)), draw.uniform(0.9, 1.15, len(xy))
    for k in range(4):
        rows = sort == k
        if plot.kind == "maize":
            make = partial(maize, k, crop.blades)
        else:
            make = partial(stalks, k, crop.height_m * 1.12, crop.blades)
        props.put((plot.kind, k), make, land.on_ground(xy[rows], -0.05), yaw[rows], scale[rows])


def _orchard(props: PropField, land: Land, plot: Plot, draw: np.random.Generator) -> None:
    """Fruit trees in rows of 6 m."""
    xy = _rows(plot, 6.0, 5.0)
    xy = xy + draw.normal(0.0, 0.15, xy.shape)
    xy = xy[land.taken.distance_m(xy) > 3.5]
    variant = draw.integers(0, PROTOTYPES, len(xy))
    detail = tree_detail(land, xy)
    yaw, tint = draw.uniform(0, 2 * np.pi, len(xy)), draw.uniform(0.8, 1.05, (len(xy), 1)) * np.ones(3)
    for v in range(PROTOTYPES):
        for level, word in enumerate(DETAILS):
            rows = (variant == v) & (detail == level)
            make = partial(tree, "orchard", v, word)
            bases_m = land.on_ground(xy[rows], -0.05)
            props.put(("tree orchard", v, word), make, bases_m, yaw[rows], 0.95, tint[rows])


def _rows(plot: Plot, across_m: float, along_m: float) -> Array:
    """Points of a grid along the plot's rows, 2 m inside its border."""
    inner = shapely.buffer(plot.area, -2.0)
    if inner.is_empty:
        return np.zeros((0, 2))
    shapely.prepare(inner)
    xy = _grid_over(inner, plot.turn_rad, along_m, across_m)
    return np.asarray(xy[shapely.contains_xy(inner, xy[:, 0], xy[:, 1])])


def _grid_over(area: Area, turn_rad: float, along_m: float, across_m: float) -> Array:
    """Points of a turned grid that covers an area, and more."""
    x0, y0, x1, y1 = shapely.bounds(area)
    reach = np.hypot(x1 - x0, y1 - y0) / 2
    u, v = np.arange(-reach, reach, along_m), np.arange(-reach, reach, across_m)
    grid = np.stack([a.ravel() for a in np.meshgrid(u, v, indexing="ij")], axis=-1)
    c, s = elementary.cos(turn_rad), elementary.sin(turn_rad)
    turned = np.stack([c * grid[:, 0] - s * grid[:, 1], s * grid[:, 0] + c * grid[:, 1]], axis=-1)
    return np.asarray(turned + np.array([(x0 + x1) / 2, (y0 + y1) / 2]))


def _bales(props: PropField, land: Land, plot: Plot, draw: np.random.Generator) -> None:
    """Round bales of hay."""
    xy = _rows(plot, 17.0, 13.0)
    xy = xy + draw.uniform(-3.0, 3.0, xy.shape)
    xy = xy[(land.taken.distance_m(xy) > 4.0) & (draw.random(len(xy)) < 0.8)]
    props.put("bale", bale, land.on_ground(xy), draw.uniform(0, 2 * np.pi, len(xy)))


def _fence(props: PropField, land: Land, plot: Plot) -> None:
    """Posts and rails along the parts of the border that face a road."""
    for ring in rings(plot.area, 3.0):
        a, b = ring[:-1], ring[1:]
        length = np.sqrt(np.sum((b - a) ** 2, axis=1))
        near = (land.roads.distance_m((a + b) / 2) < NEAR_M) & (length > 1.0)
        yaw = elementary.arctan2(b[:, 1] - a[:, 1], b[:, 0] - a[:, 0])
        props.put("pasture fence", fence_panel, land.on_ground(a[near], -0.05), yaw[near], length[near] / 3.0)


def _hedgerow(props: PropField, land: Land, plot: Plot, draw: np.random.Generator) -> None:
    """Bushes along the border, with gaps."""
    for ring in rings(shapely.buffer(plot.area, 0.8), 1.7):
        near = land.roads.distance_m(ring) < 2 * NEAR_M
        wave = elementary.sin(0.045 * ring[:, 0] + 1.7) + elementary.sin(0.05 * ring[:, 1] + plot.turn_rad)
        chosen = ring[near & (wave > 0.1)]
        chosen = chosen[land.taken.distance_m(chosen) > 3.0]
        put_bushes(props, land.on_ground(chosen, -0.1), draw)
