"""Surfaces to drive and walk on: roads, sidewalks, junctions, terrain, bridges, paint.

Painted areas: crosswalks, stop lines, turn arrows and other outlines of the map.

Hatching on the paved wedge between two carriageways that part or join side by side.
"""

import re
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import shapely

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area, areas_only, strip_polygon
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import distance_along, interpolated
from carlaloc_env.map.lanes.build_network import outline_points
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Crosswalk
from carlaloc_env.map.lanes.signals import object_pose
from carlaloc_env.map.opendrive.records import Road, RoadObject
from carlaloc_env.road.road_events import no_events
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_graph import grown
from carlaloc_env.scenery.ground.grade_levels import WALL_M, State
from carlaloc_env.scenery.ground.ground_plan import Groundwork
from carlaloc_env.scenery.ground.height_fields import JunctionField
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.paved_areas import TownAreas
from carlaloc_env.scenery.ground.terrain import add_terrain
from carlaloc_env.scenery.ground.water import add_water
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.triangulation import triangulate
from carlaloc_env.scenery.roads.junction_surfaces import (
    add_corners,
    add_islands,
    add_junction_surface,
    add_plain_lanes,
    add_roads,
)
from carlaloc_env.scenery.roads.junction_wear import add_junction_details, add_sidewalk_wear
from carlaloc_env.scenery.roads.road_classes import add_bridge_joints, is_fast_junction
from carlaloc_env.scenery.roads.road_markings import PAINT_M, add_markings
from carlaloc_env.scenery.roads.road_wear import add_road_details
from carlaloc_env.scenery.roads.sidewalks import add_sidewalks
from carlaloc_env.scenery.structures.bridges import add_bridges
from carlaloc_env.scenery.structures.underpasses import add_underpasses

HATCHING_BAR_M, BAR_STEP_M = 0.5, 2.0
"""Width of the oblique bars and their distance along the road [m] (German guideline RMS: 0.5 m wide)."""
RIM_M = 0.2
"""Distance of bars from the lines beside driving lanes [m]."""
LEAST_M = 0.9
"""Wedges narrower than this carry no bars [m]."""
_TOUCH_M = 0.1
_HALF_LENGTH_M = 8.0


def gore_bars(strips: Sequence[Strip], roads: Sequence[Road]) -> list[tuple[tuple[Strip, Strip], Area]]:
    """Bars on each wedge, with the two strips between which it lies."""
    groups: dict[str, list[Strip]] = {}
    for strip in strips:
        junction = roads[strip.road].junction_id
        if junction is not None and strip.junction_id is None:
            groups.setdefault(junction, []).append(strip)
    found = []
    for group in groups.values():
        for pair in combinations(group, 2):
            bars = _hatching_bars(*pair)
            if not bars.is_empty:
                found.append((pair, bars))
    return found


def _hatching_bars(one: Strip, other: Strip) -> Area:
    wedge, middle = _wedge(one, other)
    if wedge.is_empty or middle is None:
        return shapely.MultiPolygon()
    # Opening keeps what is wide enough for a bar.
    inner = shapely.buffer(wedge, -RIM_M, join_style="mitre")
    half = 0.5 * LEAST_M - RIM_M
    inner = shapely.intersection(shapely.buffer(shapely.buffer(inner, -half), 1.1 * half), inner)
    along = distance_along(middle)
    at = np.arange(0.5 * BAR_STEP_M, along[-1], BAR_STEP_M)
    points = interpolated(at, along, middle)
    ahead = interpolated(at + 0.5, along, middle) - points
    ahead /= np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-9)[:, None]
    slant = np.sqrt(0.5) * np.stack([ahead[:, 0] - ahead[:, 1], ahead[:, 0] + ahead[:, 1]], axis=-1)
    lines = np.stack([points - _HALF_LENGTH_M * slant, points + _HALF_LENGTH_M * slant], axis=1)
    bars = shapely.buffer(shapely.linestrings(lines), 0.5 * HATCHING_BAR_M, cap_style="flat")
    return areas_only(shapely.intersection(shapely.union_all(bars), inner), 0.05)


def _wedge(one: Strip, other: Strip) -> tuple[Area, Array | None]:
    """Shoulders of both strips that lie side by side, and the middle (N, 2) of one of them."""
    parts: list[Area] = []
    middle = None
    for strip, beside in ((one, other), (other, one)):
        span = beside.span(("roadway",))
        if span is None:
            continue
        area = strip_polygon(beside.edges_m[span[0]], beside.edges_m[span[1]])
        for lane, record in enumerate(strip.lanes):
            if record.type != "shoulder":
                continue
            left, right = strip.lane_edges(lane)
            shoulder = strip_polygon(left, right)
            if shoulder.area > 1.0 and shapely.dwithin(shoulder, area, _TOUCH_M):
                parts.append(shoulder)
                middle = 0.5 * (left + right)[:, :2] if middle is None else middle
    if not parts:
        return shapely.MultiPolygon(), None
    return shapely.buffer(shapely.union_all(parts), 0.02, join_style="mitre"), middle


BAR_M, BAR_GAP_M = 0.5, 0.6
"""Width of a crosswalk's bars and the gap between them [m]."""
STOP_LINE_M = 0.4
"""Width of stop lines that the map gives as bare lines [m]."""
EDGE_M = 0.02
"""Least distance of painted areas from the roadway's edge [m]."""
CELL_M = 1.0
"""Side of the triangles of painted areas, so that they follow the road [m]."""


class RoadPainter:
    """Lays painted areas onto roads and junctions."""

    def __init__(self, network: LaneNetwork, strips: Sequence[Strip], areas: TownAreas) -> None:
        self._network = network
        loose = [
            strip_polygon(*strip.lane_edges(lane))
            for strip in strips
            for lane in range(len(strip.lanes))
            if strip.kind(lane) == "roadway" and strip.unpaved(lane)
        ]
        # No paint holds on gravel.
        self._paintable = shapely.difference(shapely.buffer(areas.roadway, -EDGE_M), shapely.union_all(loose))
        shapely.prepare(self._paintable)
        self._strips = strips
        self._fields: dict[str, JunctionField] = {}

    def add_all(self, out: MeshBuilder) -> None:
        """Crosswalks, stop lines, arrows and zones of all roads, and the hatching where roads part."""
        for crosswalk in self._network.crosswalks:
            self._paint(out, self._field(crosswalk.road_id), _bars(crosswalk))
        for road in self._network.xodr.roads:
            for item in road.objects:
                area = self._object_area(road, item)
                if area is not None and not area.is_empty:
                    self._paint(out, self._field(road.id), area)
        for pair, bars in gore_bars(self._strips, self._network.xodr.roads):
            self._paint(out, JunctionField(pair, self._network.surface), bars)

    def _object_area(self, road: Road, item: RoadObject) -> Area | None:
        name = item.name.split("__")[0]
        turn = re.search(r"Arrow", name)
        if item.type == "crosswalk" or not (item.outlines or turn):
            return None
        T = object_pose(self._network, road, item)
        if turn:
            return _moved(_arrow(name), T)
        if item.type not in ("roadMark", "-1") or item.height_m > 0.05:
            return None
        points = outline_points(self._network, road, item, item.outlines[0])
        if len(points) < 2:
            return None
        flat = shapely.convex_hull(shapely.MultiPoint(points[:, :2]))
        if flat.area < 0.02:
            return shapely.buffer(shapely.LineString(points[:2, :2]), STOP_LINE_M / 2, cap_style="flat")
        return _hatched(flat) if len(points) > 8 else flat

    def _paint(self, out: MeshBuilder, field: JunctionField, area: Area) -> None:
        area = areas_only(shapely.intersection(area, self._paintable), 5e-3)
        xy, triangles = triangulate(area, CELL_M)
        if not len(xy):
            return
        points = np.column_stack([xy, field.height(xy) + PAINT_M])
        out.triangles(points, triangles, material=Material.ROAD_PAINT_WHITE, tag=Tag.ROAD_LINE)

    def _field(self, road_id: str) -> JunctionField:
        road = self._network.xodr.roads[self._network.road_index[road_id]]
        key = f"road {road_id}" if road.junction_id is None else f"junction {road.junction_id}"
        if key not in self._fields:
            strips = [
                strip
                for strip in self._strips
                if strip.road_id == road_id
                or (strip.junction_id is not None and strip.junction_id == road.junction_id)
            ]
            self._fields[key] = JunctionField(strips, self._network.surface)
        return self._fields[key]


def _bars(crosswalk: Crosswalk) -> Area:
    """Bars along the road, one beside the other across it."""
    hull = shapely.convex_hull(shapely.MultiPoint(crosswalk.polygon_m[:, :2]))
    start, end = crosswalk.start_m[:2], crosswalk.end_m[:2]
    length = float(np.hypot(*(end - start)))
    if length < 1.0:
        return hull
    across = (end - start) / length
    along = np.array([-across[1], across[0]]) * (crosswalk.width_m + 2.0)
    count = max(1, int((length - BAR_GAP_M) / (BAR_M + BAR_GAP_M)))
    first = (length - count * (BAR_M + BAR_GAP_M) + BAR_GAP_M) / 2
    bars = []
    for k in range(count):
        a = start + across * (first + k * (BAR_M + BAR_GAP_M))
        b = a + across * BAR_M
        bars.append(shapely.Polygon([a - along, b - along, b + along, a + along]))
    return shapely.intersection(shapely.MultiPolygon(bars), hull)


def _hatched(area: Area) -> Area:
    """Chevron zones: oblique bars inside an outline."""
    x0, y0, x1, y1 = shapely.bounds(area)
    reach = x1 - x0 + y1 - y0
    bars = []
    for offset in np.arange(-reach, reach, 1.8):
        a = np.array([x0 + offset, y0])
        b = a + np.array([reach, reach])
        bars.append(shapely.LineString([a, b]).buffer(0.2, cap_style="flat"))
    rim = shapely.difference(area, shapely.buffer(area, -0.15))
    return shapely.union(rim, shapely.intersection(shapely.union_all(bars), area))


def _arrow(name: str) -> Area:
    """Turn arrow 4 m long about the origin, pointing along +x, after its object's name."""
    parts = []
    if "Straight" in name or not ("Left" in name or "Right" in name):
        parts.append(shapely.Polygon([(-2.0, -0.08), (0.9, -0.08), (0.9, 0.08), (-2.0, 0.08)]))
        parts.append(shapely.Polygon([(0.8, -0.32), (2.0, 0.0), (0.8, 0.32)]))
    for word, side in (("Left", 1.0), ("Right", -1.0)):
        if word in name:
            stem = shapely.LineString([(-2.0, 0.0), (-0.1, 0.0), (0.35, 0.12 * side), (0.6, 0.5 * side)])
            parts.append(shapely.buffer(stem, 0.08, cap_style="flat", join_style="round"))
            tip = [(0.22, 0.42 * side), (0.6 + 0.2, 1.15 * side), (0.98, 0.42 * side)]
            parts.append(shapely.Polygon(tip))
    return shapely.union_all(parts)


def _moved(shape: Area, T: Array) -> Area:
    return shapely.transform(shape, lambda xy: elementary.matrix_product(xy, T[:2, :2].T) + T[:2, 3])


PROMENADE_M = 3.7
"""Quays this near to something paved have a railing of their own [m]."""


class Surfaces:
    """Builders that the surfaces of a town go to, by what becomes of them."""

    def __init__(self) -> None:
        self.lanes = MeshBuilder()
        """Seen, but rolled over by way of `solid`'s plainer lanes."""
        self.raised = MeshBuilder()
        """Seen and solid."""
        self.solid = MeshBuilder()
        """Solid, but not seen."""
        self.paint = MeshBuilder()
        """Seen only."""
        self.events: list[Array] = [no_events()]
        """Events that wheels feel beside the meshes, (N, 7) each."""


def add_surfaces(out: Surfaces, network: LaneNetwork, work: Groundwork, seed: int) -> Array:
    """Everything flat; gives the places of lamps below roofs [m], shape (K, 3)."""
    add_roads(out.lanes, work.strips, work.roads, seed)
    add_plain_lanes(out.solid, work.strips)
    out.events.append(add_road_details(out.lanes, work.strips, work.roads, seed))
    out.events.append(add_bridge_joints(out.lanes, work.strips, work.levels, seed))
    add_sidewalks(out.raised, work.strips, work.roads, seed)
    add_sidewalk_wear(out.lanes, work.strips, work.roads, seed)
    _add_junctions(out, work, seed)
    add_islands(out.raised, work.areas, work.kerb)
    add_terrain(out.raised, work.bounds, _ground_paving(work), work.zones, work.ground, work.seas)
    lamps = add_underpasses(out.raised, work.levels)
    if work.raised is not None:
        add_bridges(out.raised, work.levels, work.raised, work.kerb, work.ground)
    _add_waters(out, work)
    add_markings(out.paint, work.strips, work.roads)
    RoadPainter(network, work.strips, work.areas).add_all(out.paint)
    return lamps


def _add_junctions(out: Surfaces, work: Groundwork, seed: int) -> None:
    for junction in work.areas.junctions:
        deck = work.deck if junction.id in work.carried else None
        surface = JunctionField(junction.strips, work.surface)
        fast = is_fast_junction(junction, work.roads)
        add_junction_surface(out.raised, junction, surface, seed, fast=fast)
        out.events.append(add_junction_details(out.lanes, junction, surface, seed, fast=fast))
        add_corners(out.raised, junction, work.areas, work.kerb if deck is None else deck)


def _add_waters(out: Surfaces, work: Groundwork) -> None:
    beside = shapely.buffer(work.areas.paved, PROMENADE_M)
    lined = shapely.difference(shapely.buffer(work.zones.area("waterfront"), 1.5), beside)
    above = shapely.buffer(work.overhead, 0.8)
    add_water(out.raised, work.levels.waters, work.shore, work.ground, above, lined)


def _ground_paving(work: Groundwork) -> Area:
    """Ground that the terrain leaves free: paving, open cuts, filled stretches and waters."""
    levels = work.levels
    result = shapely.union(
        work.areas.low_paved, shapely.union(levels.area(State.FILLED, State.BANK), levels.landings())
    )
    for stretch in levels.stretches:
        result = shapely.difference(result, stretch.area(stretch.detached))
        result = shapely.union(result, stretch.area(grown(~stretch.detached), WALL_M))
    return areas_only(shapely.union_all([result, levels.upper, *(water.area for water in levels.waters)]))
