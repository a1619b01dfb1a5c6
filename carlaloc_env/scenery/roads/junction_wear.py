"""Covers, repairs and cracks of junctions and sidewalks.

Lids and mended places in sidewalks, as rare as on real ones.
"""

from collections.abc import Callable, Sequence

import numpy as np
import shapely

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area, areas_only
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.road.road_events import no_events
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import JunctionField
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.paved_areas import JunctionArea
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.triangulation import triangulate
from carlaloc_env.scenery.roads.junction_surfaces import is_gutter, unpaved_junction
from carlaloc_env.scenery.roads.road_classes import (
    COLLAR_GREY,
    COLLAR_M,
    COLLARS,
    COVER_RADIUS_M,
    DETAILS,
    PATCH_M,
    SEAL_M,
    SEAL_WIDTH_M,
    SQUARE,
    SURFACE,
    cover_rings,
    felt,
    lay_cover,
    repair_surface,
)
from carlaloc_env.scenery.roads.road_wear import CRACK_M, Rectangle
from carlaloc_env.scenery.roads.sidewalks import FLARE_M, KERB_STONE_M, raised_runs, run_edges

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
    number = inner.area / AREA_M2 * (DETAILS if fast else 1.0)
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
        patch, (material, grey, sealed) = _patch(point, draw), repair_surface(draw, SURFACE if fast else None)
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


MENDED_M2, LID_M2 = 160.0, 70.0
"""Area of sidewalk for each mended place and for each lid [m²]."""
SLAB_M = (0.6, 0.4)
"""Slabs across and along the sidewalk [m]; every second row lies half a slab aside."""
LIFT_M = 0.0014
"""Height of all of it above the slabs [m]."""
FRAME_M = 0.045
"""Width of a lid's frame [m]."""
NARROWEST_M = 1.3
"""Narrower sidewalks stay bare [m]."""
SHORTEST_M = 4.0
"""Shorter ones stay bare [m]."""
_FRAME, _IRON = (150.0, 148.0, 140.0), (13.0, 12.5, 12.0)


def add_sidewalk_wear(out: MeshBuilder, strips: Sequence[Strip], roads: Sequence[Road], seed: int) -> None:
    """Details of all sidewalks outside junctions; none where kerbs are dropped."""
    for strip in strips:
        if strip.junction_id is not None:
            continue
        draw = clock.stream(seed, f"pavement details/{strip.road_id}/{strip.section}")
        dropped = [
            (item.s_m - 0.5 * item.length_m - FLARE_M - 0.3, item.s_m + 0.5 * item.length_m + FLARE_M + 0.3)
            for item in roads[strip.road].objects
            if item.type == "crosswalk"
        ]
        for first, last in raised_runs(strip):
            if strip.kind(first) == "sidewalk":
                _Run(strip, first, last, dropped).lay(out, draw)


class _Run:
    """Neighbouring lanes of sidewalk between two lines."""

    def __init__(self, strip: Strip, first: int, last: int, dropped: Sequence[tuple[float, float]]) -> None:
        left, right = run_edges(strip, first, last)
        self._s, self._right, self._across = strip.s_m, right, left - right
        width = np.sqrt(np.sum(self._across[:, :2] ** 2, axis=1))
        self._across /= np.maximum(width, 1e-6)[:, None]
        kerbs = (
            last < len(strip.lanes) - 1 and strip.kind(last + 1) == "roadway",
            first > 0 and strip.kind(first - 1) == "roadway",
        )
        self._low_m = KERB_STONE_M * kerbs[0]
        self._high_m = float(width.min()) - KERB_STONE_M * kerbs[1]
        self._dropped = dropped

    def lay(self, out: MeshBuilder, draw: np.random.Generator) -> None:
        """Lay mended places and lids, none over another."""
        length, width = self._s[-1] - self._s[0], self._high_m - self._low_m
        area = length * width
        if width < NARROWEST_M or length < SHORTEST_M:
            return
        taken: list[Rectangle] = []
        for _ in range(int(draw.poisson(area / LID_M2))):
            lid = self._lid(draw)
            if self._free(lid, taken):
                inner = (lid[0] + FRAME_M, lid[1] - FRAME_M, lid[2] + FRAME_M, lid[3] - FRAME_M)
                self._quad(out, lid, LIFT_M, Material.CONCRETE, _FRAME)
                self._quad(out, inner, LIFT_M + 0.0005, Material.PLAIN, _IRON)
        for _ in range(int(draw.poisson(area / MENDED_M2))):
            grey = float(draw.uniform(85.0, 165.0))
            for slab in self._slabs(draw):
                if self._free(slab, taken):
                    self._quad(out, slab, LIFT_M, Material.ASPHALT, (grey, grey, grey))

    def _lid(self, draw: np.random.Generator) -> Rectangle:
        """Of water, gas, telephone or electricity."""
        sizes = ((0.30, 0.30), (0.45, 0.35), (0.70, 0.50), (0.90, 0.60), (1.20, 0.60))
        long, wide = sizes[int(draw.integers(len(sizes)))]
        s = float(draw.uniform(self._s[0] + 0.3, self._s[-1] - 0.3 - long))
        across = float(draw.uniform(self._low_m + 0.15, self._high_m - 0.15 - wide))
        return s, s + long, across, across + wide

    def _slabs(self, draw: np.random.Generator) -> list[Rectangle]:
        """Up to four neighbouring slabs in two rows, whose place asphalt has taken."""
        first, last = int(self._s[0] / SLAB_M[1]) + 1, int(self._s[-1] / SLAB_M[1]) - 2
        row = int(draw.integers(first, last + 1))
        columns = int((self._high_m - self._low_m) / SLAB_M[0])
        column = int(draw.integers(0, max(columns - 1, 1)))
        found = []
        for k in range(int(draw.integers(1, 3))):
            begin = self._low_m + SLAB_M[0] * (column - 0.5 * ((row + k) % 2))
            end = begin + SLAB_M[0] * int(draw.integers(1, 3))
            low, high = max(begin, self._low_m), min(end, self._high_m)
            found.append(((row + k) * SLAB_M[1], (row + k + 1) * SLAB_M[1], low, high))
        return found

    def _free(self, place: Rectangle, taken: list[Rectangle]) -> bool:
        """Whether a place lies on slabs and on nothing else; it is taken from now on."""
        s0, s1, t0, t1 = place
        outside = s0 < self._s[0] or s1 > self._s[-1] or t1 - t0 < 0.15
        dropped = any(low < s1 and s0 < high for low, high in self._dropped)
        if outside or dropped or any(a < s1 and s0 < b and c < t1 and t0 < d for a, b, c, d in taken):
            return False
        taken.append((s0 + 1e-3, s1 - 1e-3, t0 + 1e-3, t1 - 1e-3))
        return True

    def _quad(
        self, out: MeshBuilder, place: Rectangle, lift_m: float, material: Material, colour: Sequence[float]
    ) -> None:
        s0, s1, t0, t1 = place
        s, across = np.array([s0, s1, s1, s0]), np.array([t0, t0, t1, t1])
        points = interpolated(s, self._s, self._right)
        points += across[:, None] * interpolated(s, self._s, self._across)
        points[:, 2] += lift_m
        uv = np.stack([across, s], axis=-1)
        out.quads(points[None], material=material, tag=Tag.SIDEWALK, uv_m=uv[None], colour=colour)
