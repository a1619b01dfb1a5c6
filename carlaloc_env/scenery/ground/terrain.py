"""The ground between the roads, by zone, and the far land round the town."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area, areas_only
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import EdgeField, GroundGrid
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.triangulation import triangulate

MARGIN_M = 90.0
"""How far the near ground reaches beyond the roads [m]."""
BLEND_M = 8.0
"""Distance from a road over which the ground leaves the road's height [m]."""
CELL_M = 6.0
"""Side of the ground's triangles [m]."""
LAP_M = 0.06
"""How far the ground reaches below sidewalks, and how far it lies below their edge [m]."""
CRACK_M = 0.01
"""Half the width of cracks in what is paved through which no ground shows [m]."""
BANK_SLOPE, BANK_SHOULDER_M = 1.8, 0.8
"""Run over rise of an embankment's sides, and the level shoulder above them [m]."""
LEAST_LAWN_M2 = 120.0
"""Smallest lawn within a paved zone [m²]."""
FAR_CELL_M = 80.0
"""Side of the triangles of far waters [m]."""
SEA_BED_M = 2.0
"""How far the far land lies below far waters [m]."""
FAR_M = 1200.0
"""How far the far land reaches [m]."""
GROUNDS: dict[str, tuple[Material, Tag, tuple[int, int, int]]] = {
    "downtown": (Material.PAVEMENT, Tag.GROUND, (200, 198, 194)),
    "skyscraper": (Material.PAVEMENT, Tag.GROUND, (215, 213, 210)),
    "residential": (Material.GRASS, Tag.TERRAIN, (240, 240, 235)),
    "small_town": (Material.GRASS, Tag.TERRAIN, (230, 235, 225)),
    "industrial": (Material.CONCRETE, Tag.GROUND, (200, 198, 192)),
    "rural": (Material.GRASS, Tag.TERRAIN, (235, 225, 190)),
    "highway": (Material.GRASS, Tag.TERRAIN, (232, 228, 200)),
    "waterfront": (Material.PAVEMENT, Tag.GROUND, (225, 218, 205)),
    "park": (Material.GRASS, Tag.TERRAIN, (225, 245, 215)),
}
"""Ground of each kind of zone on land."""
YARD_M = {"downtown": 24.0, "skyscraper": 30.0, "waterfront": 30.0, "industrial": 45.0}
"""Paved zones are lawns farther than this from anything paved [m]: the middles of blocks, and beyond the
last houses."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Terrain:
    """Height of the ground at any point of the town."""

    edge: EdgeField
    """Heights along the outer edges of everything paved that lies on it."""
    grid: GroundGrid
    """Smooth heights far from roads."""
    bank: EdgeField | None = None
    """Edges of roads on embankments, whose sides fall from them."""
    sloping: bool = False
    """Whether heights of the land are known, so that floors of houses are made for slopes."""

    def height(self, xy_m: Array) -> Array:
        """Height of the ground [m] at points (M, 2)."""
        near, distance = self.edge.nearest(xy_m)
        share = np.clip(distance / BLEND_M, 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        result: Array = near + (self.grid.height(xy_m) - near) * share
        if self.bank is None:
            return result
        top, distance_to_bank = self.bank.nearest(xy_m)
        return np.maximum(result, top - np.maximum(distance_to_bank - BANK_SHOULDER_M, 0.0) / BANK_SLOPE)


class Zones(tuple[tuple[str, Area], ...]):
    """Kinds of scenery with their areas, which do not overlap; the default kind comes last."""

    __slots__ = ()

    @property
    def default(self) -> str:
        """Kind of the ground in no zone of `town.toml`."""
        return self[-1][0]

    def kind_at(self, xy_m: Array, outside: str = "") -> str:
        """Kind at a point (2 or 3,) [m], or `outside` where it lies in no area."""
        return next((kind for kind, area in self if shapely.intersects_xy(area, xy_m[0], xy_m[1])), outside)

    def kinds_at(self, xy_m: Array) -> NDArray[np.str_]:
        """Kind at each point (N, 2 or 3) [m]; empty outside all areas."""
        kinds = np.full(len(xy_m), "", dtype="<U16")
        for kind, area in self:
            shapely.prepare(area)
            kinds[(kinds == "") & shapely.intersects_xy(area, xy_m[:, 0], xy_m[:, 1])] = kind
        return kinds

    def area(self, *kinds: str) -> Area:
        """The areas of some kinds as one."""
        return shapely.union_all([area for kind, area in self if kind in kinds])


def zone_areas(config: TownConfig, bounds: Area) -> Zones:
    """Zone kinds with their areas inside `bounds`, without overlaps; later zones of the file go first."""
    rest, areas = bounds, []
    for zone in reversed(config.zones):
        area = shapely.intersection(shapely.make_valid(shapely.Polygon(zone.polygon)), rest)
        areas.append((zone.kind, areas_only(area)))
        rest = shapely.difference(rest, area)
    areas.append((config.default_zone, areas_only(rest)))
    return Zones((kind, area) for kind, area in areas if area.area > 1.0)


def add_terrain(
    out: MeshBuilder,
    bounds: Area,
    paved: Area,
    zones: Zones,
    ground: Terrain,
    seas: Sequence[tuple[Area, float]] = (),
) -> None:
    """Ground inside the bounds wherever nothing is paved, and the far land and waters outside.

    Args:
        out: Where it goes.
        bounds: The near ground.
        paved: What it leaves free.
        zones: Kinds of scenery with their areas.
        ground: Heights of the ground.
        seas: Waters that go on outside the bounds, with their levels [m].
    """
    # Hairlines between two paved areas would become slits as wide as both laps.
    whole = shapely.buffer(paved, CRACK_M, join_style="mitre")
    free = shapely.difference(bounds, shapely.buffer(whole, -LAP_M - CRACK_M, join_style="mitre"))
    for kind, zone in zones:
        if kind == "water":
            continue
        whole = areas_only(shapely.intersection(free, zone))
        if kind in YARD_M:
            near = shapely.buffer(shapely.simplify(paved, 0.5), YARD_M[kind], quad_segs=3)
            lawn = areas_only(shapely.difference(whole, near), LEAST_LAWN_M2)
            _cover(out, lawn, "park", ground)
            whole = areas_only(shapely.difference(whole, lawn))
        _cover(out, whole, kind, ground)
    _far_land(out, bounds, ground, seas)
    for area, level_m in seas:
        far = shapely.intersection(area, shapely.buffer(bounds, FAR_M, join_style="mitre"))
        beyond = areas_only(shapely.difference(far, bounds))
        water_surface(out, beyond, FAR_CELL_M, level_m)


def water_surface(out: MeshBuilder, area: Area, cell_m: float, level_m: float) -> None:
    """A level surface of water."""
    out.sheet(area, cell_m, lambda xy: np.full(len(xy), level_m), material=Material.WATER, tag=Tag.WATER)


def _cover(out: MeshBuilder, area: Area, kind: str, ground: Terrain) -> None:
    """Ground of a zone's kind."""
    material, tag, colour = GROUNDS[kind]
    xy, triangles = triangulate(area, CELL_M)
    if len(xy):
        z = ground.height(xy) - LAP_M / 2
        tint = np.array(colour) * (0.87 + 0.13 * _mottle(xy))[:, None]
        out.triangles(np.column_stack([xy, z]), triangles, material=material, tag=tag, colour=tint)


def _mottle(xy: Array) -> Array:
    """Slow variation between −1 and 1 without randomness, shape (M,)."""
    x, y = xy.T
    slow = elementary.sin(0.11 * x + 1.3 * elementary.sin(0.05 * y)) * elementary.sin(
        0.09 * y + 1.1 * elementary.sin(0.04 * x)
    )
    quick = elementary.sin(0.37 * x + 2.1 * elementary.sin(0.13 * y)) * elementary.sin(
        0.31 * y + 1.9 * elementary.sin(0.17 * x)
    )
    wave: Array = 0.6 * slow + 0.4 * quick
    return wave


def _far_land(out: MeshBuilder, bounds: Area, ground: Terrain, seas: Sequence[tuple[Area, float]]) -> None:
    """A skirt of ever larger quads from the border of the near ground to the horizon."""
    x0, y0, x1, y1 = shapely.bounds(bounds)
    count = 24
    side = np.linspace(0.0, 1.0, count, endpoint=False)
    ring = np.concatenate(
        [
            np.column_stack([x0 + (x1 - x0) * side, np.full(count, y0)]),
            np.column_stack([np.full(count, x1), y0 + (y1 - y0) * side]),
            np.column_stack([x1 - (x1 - x0) * side, np.full(count, y1)]),
            np.column_stack([np.full(count, x0), y1 - (y1 - y0) * side]),
        ]
    )
    ring = np.concatenate([ring, ring[:1]])
    centre = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    outward = (ring - centre) / np.linalg.norm(ring - centre, axis=1, keepdims=True)
    rows = []
    for reach in (-2.0, 60.0, 250.0, FAR_M):
        xy = ring + outward * reach
        z = ground.height(np.clip(xy, [x0, y0], [x1, y1])) - 0.4
        for area, level_m in seas:
            wet = shapely.dwithin(area, shapely.points(xy), 3.0)
            z = np.where(wet, np.minimum(z, level_m - SEA_BED_M), z)
        rows.append(np.column_stack([xy, z]))
    out.grid(
        np.stack(rows, axis=0)[::-1],
        material=Material.GRASS,
        tag=Tag.TERRAIN,
        colour=(215, 220, 200),
    )
