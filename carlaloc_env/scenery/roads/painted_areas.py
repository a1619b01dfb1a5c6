"""Painted areas: crosswalks, stop lines, turn arrows and other outlines of the map."""

import re
from collections.abc import Sequence

import numpy as np
import shapely

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area, areas_only, strip_polygon
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.crosswalks import outline_points
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Crosswalk
from carlaloc_env.map.lanes.signals import object_pose
from carlaloc_env.map.opendrive.records import Road, RoadObject
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import JunctionField
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.ground.paved_areas import TownAreas
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.hatching import gore_bars
from carlaloc_env.scenery.roads.road_markings import PAINT_M

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
        paint = Material.ROAD_PAINT_WHITE
        out.sheet(area, CELL_M, field.height, lift_m=PAINT_M, material=paint, tag=Tag.ROAD_LINE)

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
