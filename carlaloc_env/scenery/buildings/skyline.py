"""The surroundings of a town: plain far buildings and trees between its edge and the horizon."""

import numpy as np
import shapely

from carlaloc_env.assets.trees import tree
from carlaloc_env.core import clock
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.styles import STYLES
from carlaloc_env.scenery.buildings.walls import around
from carlaloc_env.scenery.ground.terrain import Terrain, Zones
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads
from carlaloc_env.scenery.meshing.props import InstanceIds, copies, poses

NEAREST_M, FARTHEST_M = 12.0, 340.0
"""Distances from the near ground's border between which the surroundings lie [m]."""
CELL_M = 46.0
"""Side of the squares that hold one building each [m]."""
HEIGHTS_M: dict[str, tuple[float, float]] = {
    "downtown": (14.0, 46.0),
    "skyscraper": (25.0, 90.0),
    "small_town": (6.0, 15.0),
    "residential": (6.0, 12.0),
    "industrial": (7.0, 14.0),
    "waterfront": (10.0, 30.0),
}
"""Heights of far buildings beside each kind of zone that has any [m]."""
_WALLS = [wall for name in ("brick_row", "european", "slab", "office") for wall in STYLES[name].walls]
_TREES = ("park", "plane", "conifer")


def add_skyline(
    bounds: Area,
    zones: Zones,
    ground: Terrain,
    seed: int,
    ids: InstanceIds,
    sea: Area | None = None,
) -> list[Mesh]:
    """Far buildings and trees round the border, not in the sea, with an instance id each."""
    draw = clock.stream(seed, "skyline")
    places, distance = _places(bounds, draw)
    if sea is not None:
        dry = ~shapely.dwithin(sea, shapely.points(places), 30.0)
        places, distance = places[dry], distance[dry]
    x0, y0, x1, y1 = shapely.bounds(bounds)
    on_border = np.clip(places, [x0, y0], [x1, y1])
    z = ground.height(on_border) - 0.5
    kinds = [_nearest(zones, point) for point in on_border]
    out = MeshBuilder()
    trees: dict[str, list[Array]] = {kind: [] for kind in _TREES}
    for place, far, base, kind in zip(places, distance, z, kinds, strict=True):
        heights = HEIGHTS_M.get(kind)
        if heights is not None and draw.random() < 0.75 - 0.5 * far / FARTHEST_M:
            out.add(_block(place, float(base), heights, draw).with_instance(ids.take()))
            continue
        for _ in range(int(draw.integers(0, 3))):
            base_m = np.array([*(place + draw.uniform(-18.0, 18.0, 2)), base])
            trees[_TREES[int(draw.integers(len(_TREES)))]].append(base_m)
    meshes = [out.build()]
    for kind in _TREES:
        if trees[kind]:
            bases_m = np.array(trees[kind])
            T = poses(
                bases_m, draw.uniform(0.0, 2 * np.pi, len(bases_m)), draw.uniform(0.8, 1.2, len(bases_m))
            )
            meshes.append(copies(tree(kind, 1, "low"), T, ids.take(len(bases_m))))
    return meshes


def _places(bounds: Area, draw: np.random.Generator) -> tuple[Array, Array]:
    """Jittered grid points round the border (K, 2) and their distances to it [m] (K,)."""
    x0, y0, x1, y1 = shapely.bounds(bounds)
    x = np.arange(x0 - FARTHEST_M, x1 + FARTHEST_M, CELL_M)
    y = np.arange(y0 - FARTHEST_M, y1 + FARTHEST_M, CELL_M)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = grid + draw.uniform(0.2 * CELL_M, 0.8 * CELL_M, grid.shape)
    distance = shapely.distance(bounds, shapely.points(grid))
    keep = (distance > NEAREST_M + 12.0) & (distance < FARTHEST_M)
    return grid[keep], distance[keep]


def _nearest(zones: Zones, point: Array) -> str:
    at = shapely.Point(*point)
    return min(zones, key=lambda zone: float(shapely.distance(zone[1], at)))[0]


def _block(place: Array, base: float, heights: tuple[float, float], draw: np.random.Generator) -> Mesh:
    """A box with a band of windows on every storey."""
    out = MeshBuilder()
    width, depth = draw.uniform(12.0, 24.0), draw.uniform(11.0, 17.0)
    height = heights[0] + (heights[1] - heights[0]) * float(draw.random()) ** 2
    storeys = max(2, round(height / 3.3))
    height = storeys * 3.3
    material, tint = _WALLS[int(draw.integers(len(_WALLS)))]
    box = box_quads([0.0, 0.0, -3.0], [width, depth, height])
    out.quads(box[:4], material=material, tag=Tag.BUILDING, colour=tint)
    out.quads(box[4:], material=Material.ROOF_FLAT, tag=Tag.BUILDING)
    floors = np.arange(storeys) * 3.3
    for wall in around(width, depth):
        bays = max(2, round(wall.width_m / 3.2))
        a = (np.arange(bays) + 0.5) * wall.width_m / bays
        grid_a, grid_z = (axis.ravel() for axis in np.meshgrid(a, floors + 0.9))
        panes = wall.front(grid_a - 0.65, grid_a + 0.65, grid_z, grid_z + 1.5, 0.03)
        out.quads(panes, material=Material.CURTAIN_WALL, tag=Tag.BUILDING, colour=(120, 130, 140))
    turn = poses([(*place, base)], float(draw.integers(0, 4)) * np.pi / 2 + draw.uniform(-0.1, 0.1))
    return copies(out.build(), turn, 0)
