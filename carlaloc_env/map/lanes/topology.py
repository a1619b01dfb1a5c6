"""Which lane follows which, from lane links, road links and junction connections."""

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.opendrive.lane_boundaries import LaneEdges
from carlaloc_env.map.opendrive.records import (
    Connection,
    Junction,
    Note,
    OpenDrive,
    Road,
    RoadLink,
    Severity,
)
from carlaloc_env.map.opendrive.road_surface import RoadSurface

DRIVABLE_TYPES = frozenset(
    {"driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane", "bidirectional"}
)
"""Lane types that cars drive on; links between these and other lanes are not followed."""
End = Literal["start", "end"]
"""One end of a road or lane, along s."""


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
        self.broken: list[Note] = []
        """Links in the file that lead nowhere, and links that are missing."""
        self.successors: list[list[int]] = [[] for _ in forward]
        self.predecessors: list[list[int]] = [[] for _ in forward]
        for n, road in enumerate(xodr.roads):
            self._follow_sections(n, road)
            self._follow_road(n, road, "start", road.predecessor)
            self._follow_road(n, road, "end", road.successor)
        for junction in xodr.junctions:
            for connection in junction.connections:
                self._follow_connection(junction, connection)
        self._join_unlinked()

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
        numbers = self._junction if link.element_type == "junction" else self._road
        if link.element_id not in numbers:
            message = f"links to {link.element_type} {link.element_id}, which does not exist"
            self._report("road", road.id, road.line, message, "warning")
            return
        if link.element_type == "junction":
            return
        target = self._road[link.element_id]
        contact = link.contact or self._nearer_end(n, end, target)
        own, other = self._section(n, end), self._section(target, contact)
        for lane in road.sections[own[1]].lanes:
            for to in lane.predecessors if end == "start" else lane.successors:
                if lane.id:
                    self._join((*own, lane.id), end, (*other, to), contact, lane.line)

    def _follow_connection(self, junction: Junction, connection: Connection) -> None:
        incoming = self._road.get(connection.incoming_road)
        connecting = self._road.get(connection.connecting_road)
        if incoming is None or connecting is None:
            name = connection.incoming_road if incoming is None else connection.connecting_road
            message = f"connection of junction {junction.id} names road {name}, which does not exist"
            self._report("connection", connection.id, connection.line, message, "warning")
            return
        touching = self._touching(incoming, junction.id)[::-1]
        contacts: list[End] = ["start", "end"] if connection.contact is None else [connection.contact]
        for start, to in connection.lane_links:
            if not any(
                self._link(a, end, b, contact)
                for end, a in self._lanes_at(incoming, start, touching)
                for contact, b in self._lanes_at(connecting, to, contacts)
            ):
                if not self._for_cars((incoming, -1, start), (connecting, -1, to)):
                    continue
                message = f"junction {junction.id}: lane {start} of road {connection.incoming_road} "
                message += f"does not lead onto lane {to} of road {connection.connecting_road}"
                self._report("connection", connection.id, connection.line, message)

    def _join_unlinked(self) -> None:
        """Lanes that meet where the file joins their roads or sections but states no lane link at all."""
        for n, road in enumerate(self._xodr.roads):
            for k, section in enumerate(road.sections[1:], start=1):
                self._meet((n, k - 1), "end", (n, k), "start", section.line)
            for end, link in self._ends(road):
                target = self._road.get(link.element_id) if link and link.element_type == "road" else None
                if link is not None and target is not None:
                    contact = link.contact or self._nearer_end(n, end, target)
                    self._meet(self._section(n, end), end, self._section(target, contact), contact, road.line)
        for junction in self._xodr.junctions:
            for connection in junction.connections:
                incoming = self._road.get(connection.incoming_road)
                connecting = self._road.get(connection.connecting_road)
                if incoming is None or connecting is None or connection.lane_links:
                    continue
                for end in self._touching(incoming, junction.id):
                    contact = connection.contact or self._nearer_end(incoming, end, connecting)
                    a, b = self._section(incoming, end), self._section(connecting, contact)
                    self._meet(a, end, b, contact, connection.line)

    @staticmethod
    def _ends(road: Road) -> tuple[tuple[End, RoadLink | None], tuple[End, RoadLink | None]]:
        return ("start", road.predecessor), ("end", road.successor)

    def _section(self, road: int, end: End) -> tuple[int, int]:
        return road, 0 if end == "start" else len(self._xodr.roads[road].sections) - 1

    def _meet(self, a: tuple[int, int], end_a: End, b: tuple[int, int], end_b: End, line: int) -> None:
        ours, theirs = self._cars(*a), self._cars(*b)
        linked = any(y in self.successors[x] + self.predecessors[x] for x in ours for y in theirs)
        if not ours or not theirs or linked:
            return
        here, width_m = self._lane_ends(ours, end_a)
        there, _ = self._lane_ends(theirs, end_b)
        for x, point, width in zip(ours, here, width_m, strict=True):
            gap = there - point
            near = np.flatnonzero(np.sqrt(np.sum(gap * gap, axis=1)) < 0.5 * width)
            fits = [theirs[k] for k in near if self._flows(x, end_a, theirs[k], end_b)]
            if len(fits) == 1 and self._link(x, end_a, fits[0], end_b):
                lanes = self._edges.lanes
                other = f"lane {lanes[fits[0]].id} of road {self._xodr.roads[b[0]].id}"
                message = f"has no lane link to {other}, the only one that it meets, which is taken"
                label = f"{lanes[x].id} of road {self._xodr.roads[a[0]].id}"
                self._report("lane", label, line, message, "warning")

    def _cars(self, road: int, section: int) -> list[int]:
        """Lanes of a section that cars drive on."""
        lanes, index = self._xodr.roads[road].sections[section].lanes, self._edges.index
        return [index[road, section, k.id] for k in lanes if k.id and k.type in DRIVABLE_TYPES]

    def _lane_ends(self, lanes: list[int], end: End) -> tuple[Array, Array]:
        """Centres (M, 3) and widths (M,) of lanes at one end [m]."""
        sections = [self._edges.sections[n] for n in lanes]
        s = np.array([section.s_m if end == "start" else section.end_m for section in sections])
        numbers = np.array(lanes)
        return self._surface.lane_centre(numbers, s).position_m, self._edges.width(numbers, s)

    def _touching(self, road: int, junction_id: str) -> list[End]:
        """Those ends of a road that lie at the junction."""
        ends = self._ends(self._xodr.roads[road])
        return [end for end, k in ends if k and k.element_type == "junction" and k.element_id == junction_id]

    def _lanes_at(self, road: int, lane_id: int, ends: Sequence[End]) -> Iterator[tuple[End, int]]:
        """The lane of that id at those ends of a road where there is one."""
        for end in ends:
            lane = self._edges.index.get((*self._section(road, end), lane_id))
            if lane is not None:
                yield end, lane

    def _join(
        self, a: tuple[int, int, int], end_a: End, b: tuple[int, int, int], end_b: End, line: int
    ) -> None:
        road_a, road_b = self._xodr.roads[a[0]].id, self._xodr.roads[b[0]].id
        message = f"lane {a[2]} of road {road_a} links to lane {b[2]} of road {road_b}"
        target = self._edges.index.get(b)
        if target is None:
            if b[2] != 0:
                self._report("lane", str(a[2]), line, f"{message}, which does not exist")
        elif not self._link(self._edges.index[a], end_a, target, end_b) and self._for_cars(a, b):
            self._report("lane", str(a[2]), line, f"{message}, which runs against it")

    def _link(self, a: int, end_a: End, b: int, end_b: End) -> bool:
        """Joins two lanes where the ends and their traffic allow; False if they do not."""
        if not self._flows(a, end_a, b, end_b):
            return False
        source, target = (a, b) if self._forward[a] == (end_a == "end") else (b, a)
        lanes = self._edges.lanes
        if (lanes[source].type in DRIVABLE_TYPES) == (lanes[target].type in DRIVABLE_TYPES):
            if target not in self.successors[source]:
                self.successors[source].append(target)
            if source not in self.predecessors[target]:
                self.predecessors[target].append(source)
        return True

    def _flows(self, a: int, end_a: End, b: int, end_b: End) -> bool:
        """Whether traffic leaves one of two lanes and enters the other where these ends meet."""
        return (self._forward[a] == (end_a == "end")) != (self._forward[b] == (end_b == "end"))

    def _for_cars(self, *lanes: tuple[int, int, int]) -> bool:
        """True if all those (road, section, id) are drivable; section −1 asks any section of the road."""
        roads = self._xodr.roads
        for road, section, lane_id in lanes:
            sections = roads[road].sections if section < 0 else (roads[road].sections[section],)
            records = [lane for s in sections if (lane := s.lane(lane_id)) is not None]
            if records and not any(lane.type in DRIVABLE_TYPES for lane in records):
                return False
        return True

    def _nearer_end(self, n: int, end: End, target: int) -> End:
        """For links without contactPoint: the end of the other road that lies nearer."""
        roads = self._xodr.roads
        s = [0.0 if end == "start" else roads[n].length_m, 0.0, roads[target].length_m]
        line = self._surface.plan_view.evaluate(np.array([n, target, target]), np.array(s))
        gaps = np.hypot(line.x_m[1:] - line.x_m[0], line.y_m[1:] - line.y_m[0])
        return "start" if gaps[0] <= gaps[1] else "end"

    def _report(
        self, element: str, label: str, line: int, message: str, severity: Severity = "error"
    ) -> None:
        note = Note(severity=severity, element=element, id=label, line=line, message=message)
        self.broken.append(note)
