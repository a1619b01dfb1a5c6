"""Which lane follows which, from lane links, road links and junction connections."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from carlaloc_env.town.opendrive.lane_boundaries import LaneEdges
from carlaloc_env.town.opendrive.records import Connection, Junction, OpenDrive, Road, RoadLink
from carlaloc_env.town.opendrive.road_surface import RoadSurface

DRIVABLE_TYPES = frozenset(
    {"driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane", "bidirectional"}
)
"""Lane types that cars drive on; links between these and other lanes are not followed."""
End = Literal["start", "end"]
"""One end of a road or lane, along s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokenLink:
    """A link in the file that leads nowhere."""

    element: str
    id: str
    line: int
    message: str


class LaneLinks:
    """Successors and predecessors of every lane, in travel direction."""

    def __init__(self, xodr: OpenDrive, surface: RoadSurface, forward: Sequence[bool]) -> None:
        """Follows all links of the map.

        Args:
            xodr: The map.
            surface: Its roads and lanes.
            forward: Per lane, True if traffic runs with growing s.
        """
        self._xodr = xodr
        self._edges: LaneEdges = surface.edges
        self._surface = surface
        self._forward = forward
        self._road = {road.id: n for n, road in enumerate(xodr.roads)}
        self._junction = {junction.id for junction in xodr.junctions}
        self.broken: list[BrokenLink] = []
        self.successors: list[list[int]] = [[] for _ in forward]
        self.predecessors: list[list[int]] = [[] for _ in forward]
        for n, road in enumerate(xodr.roads):
            self._follow_sections(n, road)
            self._follow_road(n, road, "start", road.predecessor)
            self._follow_road(n, road, "end", road.successor)
        for junction in xodr.junctions:
            for connection in junction.connections:
                self._follow_connection(junction, connection)

    def _follow_sections(self, n: int, road: Road) -> None:
        for k, (section, following) in enumerate(zip(road.sections, road.sections[1:], strict=False)):
            for lane in section.lanes:
                for target in lane.successors:
                    if lane.id:
                        self._join((n, k, lane.id), "end", (n, k + 1, target), "start", lane.line)
            for lane in following.lanes:
                for target in lane.predecessors:
                    if lane.id:
                        self._join((n, k + 1, lane.id), "start", (n, k, target), "end", lane.line)

    def _follow_road(self, n: int, road: Road, end: End, link: RoadLink | None) -> None:
        if link is None:
            return
        if link.element_type == "junction":
            if link.element_id not in self._junction:
                self._report(
                    "road", road.id, road.line, f"links to junction {link.element_id}, which does not exist"
                )
            return
        target = self._road.get(link.element_id)
        if target is None:
            self._report("road", road.id, road.line, f"links to road {link.element_id}, which does not exist")
            return
        contact = link.contact or self._nearer_end(n, end, target)
        k = 0 if end == "start" else len(road.sections) - 1
        other = 0 if contact == "start" else len(self._xodr.roads[target].sections) - 1
        for lane in road.sections[k].lanes:
            for to in lane.predecessors if end == "start" else lane.successors:
                if lane.id:
                    self._join((n, k, lane.id), end, (target, other, to), contact, lane.line)

    def _follow_connection(self, junction: Junction, connection: Connection) -> None:
        incoming = self._road.get(connection.incoming_road)
        connecting = self._road.get(connection.connecting_road)
        if incoming is None or connecting is None:
            name = connection.incoming_road if incoming is None else connection.connecting_road
            message = f"connection of junction {junction.id} names road {name}, which does not exist"
            self._report("connection", connection.id, connection.line, message)
            return
        for start, to in connection.lane_links:
            if not any(
                self._link(a, end, b, contact)
                for end, a in self._touching(incoming, start, junction.id)
                for contact, b in self._contacts(connecting, to, connection.contact)
            ):
                if not self._for_cars((incoming, -1, start), (connecting, -1, to)):
                    continue
                message = (
                    f"junction {junction.id}: lane {start} of road {connection.incoming_road} does not lead "
                )
                message += f"onto lane {to} of road {connection.connecting_road}"
                self._report("connection", connection.id, connection.line, message)

    def _touching(self, road: int, lane_id: int, junction_id: str) -> Iterator[tuple[End, int]]:
        """The lane at those ends of a road that lie at the junction."""
        r = self._xodr.roads[road]
        ends: list[tuple[End, RoadLink | None, int]] = [
            ("end", r.successor, len(r.sections) - 1),
            ("start", r.predecessor, 0),
        ]
        for end, link, k in ends:
            here = link is not None and link.element_type == "junction" and link.element_id == junction_id
            lane = self._edges.index.get((road, k, lane_id))
            if here and lane is not None:
                yield end, lane

    def _contacts(self, road: int, lane_id: int, contact: End | None) -> Iterator[tuple[End, int]]:
        ends: tuple[End, ...] = ("start", "end") if contact is None else (contact,)
        for end in ends:
            k = 0 if end == "start" else len(self._xodr.roads[road].sections) - 1
            lane = self._edges.index.get((road, k, lane_id))
            if lane is not None:
                yield end, lane

    def _join(
        self, a: tuple[int, int, int], end_a: End, b: tuple[int, int, int], end_b: End, line: int
    ) -> None:
        road_a, road_b = self._xodr.roads[a[0]].id, self._xodr.roads[b[0]].id
        target = self._edges.index.get(b)
        if target is None:
            if b[2] != 0:
                message = f"lane {a[2]} of road {road_a} links to lane {b[2]} of road {road_b}, "
                message += "which does not exist"
                self._report("lane", str(a[2]), line, message)
        elif not self._link(self._edges.index[a], end_a, target, end_b) and self._for_cars(a, b):
            message = (
                f"lane {a[2]} of road {road_a} links to lane {b[2]} of road {road_b}, which runs against it"
            )
            self._report("lane", str(a[2]), line, message)

    def _link(self, a: int, end_a: End, b: int, end_b: End) -> bool:
        """Joins two lanes where the ends and their traffic allow; False if they do not."""
        leaves_a = self._forward[a] == (end_a == "end")
        leaves_b = self._forward[b] == (end_b == "end")
        if leaves_a == leaves_b:
            return False
        source, target = (a, b) if leaves_a else (b, a)
        lanes = self._edges.lanes
        if (lanes[source].type in DRIVABLE_TYPES) == (lanes[target].type in DRIVABLE_TYPES):
            if target not in self.successors[source]:
                self.successors[source].append(target)
            if source not in self.predecessors[target]:
                self.predecessors[target].append(source)
        return True

    def _for_cars(self, *lanes: tuple[int, int, int]) -> bool:
        """True if all those (road, section, id) are drivable; section −1 asks any section of the road."""
        roads = self._xodr.roads
        for road, section, lane_id in lanes:
            sections = roads[road].sections if section < 0 else (roads[road].sections[section],)
            own = [lane for s in sections if (lane := s.lane(lane_id)) is not None]
            if own and not any(lane.type in DRIVABLE_TYPES for lane in own):
                return False
        return True

    def _nearer_end(self, n: int, end: End, target: int) -> End:
        """For links without contactPoint: the end of the other road that lies nearer."""
        roads = self._xodr.roads
        s = [0.0 if end == "start" else roads[n].length_m, 0.0, roads[target].length_m]
        line = self._surface.plan_view.evaluate(np.array([n, target, target]), np.array(s))
        gaps = np.hypot(line.x_m[1:] - line.x_m[0], line.y_m[1:] - line.y_m[0])
        return "start" if gaps[0] <= gaps[1] else "end"

    def _report(self, element: str, label: str, line: int, message: str) -> None:
        self.broken.append(BrokenLink(element=element, id=label, line=line, message=message))
