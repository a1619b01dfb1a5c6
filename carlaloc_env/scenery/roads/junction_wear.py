"""Wear of junctions: gutters, covers, repairs and cracks."""

from collections.abc import Callable

import numpy as np
import shapely

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area, areas_only
from carlaloc_env.core.array_types import Array
from carlaloc_env.road.road_events import no_events
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import JunctionField
from carlaloc_env.scenery.ground.paved_areas import JunctionArea
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.triangulation import triangulate
from carlaloc_env.scenery.roads.fast_roads import FAST_DETAILS, FAST_SURFACE
from carlaloc_env.scenery.roads.junction_surfaces import unpaved_junction
from carlaloc_env.scenery.roads.lane_surfaces import is_gutter
from carlaloc_env.scenery.roads.repairs import (
    COLLAR_GREY,
    COLLAR_M,
    COLLARS,
    COVER_RADIUS_M,
    PATCH_M,
    SEAL_M,
    SEAL_WIDTH_M,
    SQUARE,
    cover_rings,
    lay_cover,
    repair_surface,
)
from carlaloc_env.scenery.roads.road_events import felt
from carlaloc_env.scenery.roads.road_wear import CRACK_M

AREA_M2 = 350.0
"""Area of a junction for each repair, each crack and each cover [m²]."""
MARGIN_M = 0.4
"""Distance of all of it from kerbs and from where roads begin [m]."""
GUTTER_LIFT_M = 0.0015
"""Height of gutters above the junction's asphalt [m]."""
_CELL_M = 1.5


def add_junction_details(
    out: MeshBuilder, junction: JunctionArea, field: JunctionField, seed: int, *, fast: bool
) -> Array:
    """Wear of one junction, `fast` where only fast roads meet.

    Returns:
        Events that wheels feel, shape (N, 7).
    """
    events = [no_events()]
    if unpaved_junction(junction):
        return events[0]
    _gutters(out, junction, field)
    inner = areas_only(shapely.buffer(junction.roadway, -MARGIN_M), 4.0)
    if inner.is_empty or inner.area < 40.0:
        return events[0]
    heights = clock.stream(seed, f"felt/junction/{junction.id}")
    draw = clock.stream(seed, f"junction details/{junction.id}")
    number = inner.area / AREA_M2 * (FAST_DETAILS if fast else 1.0)
    sheets = _Sheets(inner)
    for point in _points(inner, 0 if fast else draw.poisson(number), draw):
        rings = point + elementary.matrix_product(cover_rings(), _turned(draw))
        if shapely.contains_xy(inner, *rings[:12].T).all():
            sheets.add(rings, lay_cover)
            lid = COVER_RADIUS_M * SQUARE * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]])
            events.append(felt("cover", point + lid, heights))
            collar = shapely.Point(*point).buffer(0.5 * COLLAR_M, cap_style="square")
            if draw.random() < COLLARS:
                sheets.lay(collar, PATCH_M, Material.ASPHALT, float(draw.uniform(*COLLAR_GREY)))
            else:
                sheets.keep(collar)
    for point in _points(inner, draw.poisson(number), draw):
        patch, (material, grey, sealed) = (
            _patch(point, draw),
            repair_surface(draw, FAST_SURFACE if fast else None),
        )
        rim = shapely.buffer(patch, SEAL_WIDTH_M, join_style="mitre")
        if sheets.free(rim):
            sheets.lay(patch, PATCH_M, material, grey)
            if shapely.contains(inner, patch):
                events.append(felt("patch", shapely.get_coordinates(patch)[:3], heights))
            if sealed:
                sheets.lay(rim, SEAL_M, Material.PLAIN, 7.0)
    cracks = [_crack(point, draw) for point in _points(inner, draw.poisson(number), draw)]
    sheets.lay(shapely.union_all(cracks), CRACK_M, Material.PLAIN, 6.0)
    sheets.build(out, field)
    return np.concatenate(events)


class _Sheets:
    """Thin sheets on a junction; each leaves free what earlier ones cover."""

    def __init__(self, inner: Area) -> None:
        self._inner = inner
        self._taken: Area = shapely.MultiPolygon()
        self._found: list[tuple[Array, Callable[[MeshBuilder, Array], None]]] = []

    def add(self, xy: Array, lay: Callable[[MeshBuilder, Array], None]) -> None:
        """Points (K, 2) on the junction; `lay` gets them with their heights, (K, 3)."""
        self._found.append((xy, lay))

    def build(self, out: MeshBuilder, field: JunctionField) -> None:
        """Lay everything in the order in which it came; heights are looked up all at once."""
        if not self._found:
            return
        xy = np.concatenate([part for part, _ in self._found])
        points = np.column_stack([xy, field.height(xy)])
        ends = np.cumsum([len(part) for part, _ in self._found])
        for (_, lay), part in zip(self._found, np.split(points, ends[:-1]), strict=True):
            lay(out, part)

    def free(self, area: Area) -> bool:
        """Whether nothing lies there."""
        return not shapely.intersects(self._taken, area)

    def keep(self, area: Area) -> None:
        """Leave an area free from now on."""
        self._taken = shapely.union(self._taken, area)

    def lay(self, area: Area, lift_m: float, material: Material, grey: float) -> None:
        """Lay what of an area is free."""
        bare = shapely.difference(shapely.intersection(area, self._inner), self._taken)
        self.keep(area)
        xy, triangles = triangulate(areas_only(bare), _CELL_M)

        def sheet(out: MeshBuilder, points: Array) -> None:
            high = points + np.array([0.0, 0.0, lift_m])
            out.triangles(high, triangles, material=material, tag=Tag.ROAD, colour=(grey, grey, grey))

        if len(xy):
            self.add(xy, sheet)


def _turned(draw: np.random.Generator) -> Array:
    turn = float(draw.uniform(0.0, 2.0 * np.pi))
    return np.array(
        [[elementary.cos(turn), elementary.sin(turn)], [-elementary.sin(turn), elementary.cos(turn)]]
    )


def _gutters(out: MeshBuilder, junction: JunctionArea, field: JunctionField) -> None:
    """Concrete gutters along the kerbs of a junction whose roads have them."""
    widths = [
        float((strip.t_m[lane] - strip.t_m[lane + 1]).mean())
        for strip in junction.strips
        for lane in range(len(strip.lanes))
        if is_gutter(strip, lane)
    ]
    if not widths or junction.sidewalk.is_empty:
        return
    beside = shapely.buffer(junction.sidewalk, float(np.median(widths)))
    xy, triangles = triangulate(areas_only(shapely.intersection(junction.roadway, beside), 0.05), _CELL_M)
    if len(xy):
        points = np.column_stack([xy, field.height(xy) + GUTTER_LIFT_M])
        out.triangles(points, triangles, material=Material.CONCRETE, tag=Tag.ROAD, colour=(178, 176, 170))


def _points(area: Area, count: int, draw: np.random.Generator) -> Array:
    """Up to `count` points (K, 2) in an area."""
    x0, y0, x1, y1 = shapely.bounds(area)
    xy = draw.uniform((x0, y0), (x1, y1), (4 * int(count) + 4, 2))
    shapely.prepare(area)
    return np.asarray(xy[shapely.contains_xy(area, xy[:, 0], xy[:, 1])][: int(count)])


def _patch(point: Array, draw: np.random.Generator) -> Area:
    """A rectangle in any direction."""
    turn = float(draw.uniform(0.0, np.pi))
    along = np.array([elementary.cos(turn), elementary.sin(turn)])
    half = along * float(draw.uniform(0.6, 3.0))
    line = shapely.LineString([point - half, point + half])
    return shapely.buffer(line, float(draw.uniform(0.4, 1.0)), cap_style="flat")


def _crack(point: Array, draw: np.random.Generator) -> Area:
    """A line that wanders."""
    turn = float(draw.uniform(0.0, 2.0 * np.pi)) + np.cumsum(draw.normal(0.0, 0.35, 9))
    steps = np.stack([elementary.cos(turn), elementary.sin(turn)], axis=-1) * float(draw.uniform(0.3, 0.8))
    line = shapely.LineString(point + np.cumsum(steps, axis=0))
    return shapely.buffer(line, float(draw.uniform(0.02, 0.035)), cap_style="flat", join_style="bevel")
