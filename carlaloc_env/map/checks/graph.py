"""Checks of the lane graph: gaps at links, mirrored links, dead ends, connectedness."""

import itertools
from collections import Counter

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from carlaloc_env.core import elementary
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.checks.roads import Row
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Lane
from carlaloc_env.map.lanes.topology import DRIVABLE_TYPES
from carlaloc_env.map.opendrive.records import OpenDrive, Road, Severity

LINK_BOUNDS = (
    ("gap", "m", 1e-3, 1.0),
    ("heading", "rad", 1e-3, 0.5),
    ("height", "m", 1e-3, 0.2),
    ("width", "m", 1e-3, np.inf),
    ("slope", "", 0.01, np.inf),
    ("curvature", "1/m", 0.01, np.inf),
)
"""Values compared where one lane follows another: name, unit, bound of a warning, of an error, which
no car drives over."""


def link_problems(network: LaneNetwork) -> list[Row]:
    """Steps of position, heading, height, width, slope and curvature between successive lanes."""
    edges = [
        (lane.index, n) for lane in network.lanes if lane.type in DRIVABLE_TYPES for n in lane.successors
    ]
    if not edges:
        return []
    a, b = np.array(edges).T
    end, start = network.exact_pose(a, network.tables.length_m[a]), network.exact_pose(b, np.zeros(len(b)))
    delta = end.position_m - start.position_m
    width = network.width_m(a, network.tables.length_m[a]) - network.width_m(b, np.zeros(len(b)))
    steps = np.stack(
        [
            np.hypot(delta[:, 0], delta[:, 1]),
            np.abs(wrap_angle(end.heading_rad - start.heading_rad)),
            np.abs(delta[:, 2]),
            np.abs(width),
            np.abs(elementary.tan(end.pitch_rad) - elementary.tan(start.pitch_rad)),
            np.abs(end.curvature_radpm - start.curvature_radpm),
        ]
    )
    warn = steps > np.array([bound[2] for bound in LINK_BOUNDS])[:, None]
    bad = steps > np.array([bound[3] for bound in LINK_BOUNDS])[:, None]
    rows: list[Row] = []
    for k in np.flatnonzero(warn.any(axis=0)):
        parts = [
            f"{name} {steps[n, k]:.2g} {unit}".strip()
            for n, (name, unit, _, _) in enumerate(LINK_BOUNDS)
            if warn[n, k]
        ]
        to = network.lanes[b[k]]
        message = f"does not meet lane {to.lane_id} of road {to.road_id}: step in {', '.join(parts)}"
        severity: Severity = "error" if bad[:, k].any() else "warning"
        rows.append((severity, "lane", _label(network, a[k]), _line(network, a[k]), message))
    return rows


def reciprocity_problems(xodr: OpenDrive) -> list[Row]:
    """Road links and junction lane links whose other side does not answer."""
    rows: list[Row] = []
    roads = {road.id: road for road in xodr.roads}
    for road in xodr.roads:
        for end, link in (("start", road.predecessor), ("end", road.successor)):
            if link is None or link.element_type != "road" or link.element_id not in roads:
                continue
            other = roads[link.element_id]
            if road.junction_id is None and not _answers(other, link.contact, road.id, end):
                message = f"links to road {other.id}, which does not link back"
                rows.append(("warning", "road", road.id, road.line, message))
            if link.contact is None:
                message = f"its link to road {other.id} has no contactPoint"
                rows.append(("warning", "road", road.id, road.line, message))
        rows += _section_links(road)
    for junction in xodr.junctions:
        if junction.type == "direct":
            continue
        for connection in junction.connections:
            through = roads.get(connection.connecting_road)
            if through is None:
                continue
            section = through.sections[0 if connection.contact == "start" else -1]
            for start, to in connection.lane_links:
                lane = section.lane(to)
                if lane is None or lane.type not in DRIVABLE_TYPES:
                    continue
                if start not in (lane.predecessors if connection.contact == "start" else lane.successors):
                    message = f"lane link {start} → {to}: lane {to} of road {through.id} does not link back"
                    label = f"{connection.id} of junction {junction.id}"
                    rows.append(("warning", "connection", label, connection.line, message))
    return rows


def membership_problems(xodr: OpenDrive) -> list[Row]:
    """Roads of a junction's connections that name another junction."""
    rows: list[Row] = []
    roads = {road.id: road for road in xodr.roads}
    for junction in xodr.junctions:
        for connection in junction.connections:
            road = roads.get(connection.connecting_road)
            if road is None or junction.type == "virtual":
                continue
            message = f"connecting road {road.id} belongs to junction {road.junction_id}"
            named = {road.junction_id or ""}
            if junction.type == "direct":
                ends = {"start": road.predecessor, "end": road.successor}
                links = ends.values() if connection.contact is None else (ends[connection.contact],)
                named = {k.element_id for k in links if k is not None and k.element_type == "junction"}
                back = "junction " + " and ".join(sorted(named)) if named else "no junction"
                message = f"linked road {road.id} points back to {back}"
            if junction.id not in named:
                label = f"{connection.id} of junction {junction.id}"
                message = f"{message}, not to junction {junction.id}"
                rows.append(("warning", "connection", label, connection.line, message))
    return rows


def _section_links(road: Road) -> list[Row]:
    """Links between two sections of a road that one of the two lanes does not state."""
    rows: list[Row] = []
    for before, after in itertools.pairwise(road.sections):
        ours, theirs = ([k for k in s.lanes if k.type in DRIVABLE_TYPES] for s in (before, after))
        forth = {(lane.id, n) for lane in ours for n in lane.successors}
        back = {(n, lane.id) for lane in theirs for n in lane.predecessors}
        for a, b in sorted(forth ^ back):
            silent = after.lane(b) if (a, b) in forth else before.lane(a)
            if silent is not None and silent.type in DRIVABLE_TYPES:
                other = a if (a, b) in forth else b
                side = "before" if other == a else "after"
                message = f"does not link back to lane {other} of the section {side}"
                rows.append(("warning", "lane", f"{silent.id} of road {road.id}", silent.line, message))
    return rows


def _answers(other: Road, contact: str | None, road_id: str, end: str) -> bool:
    link = {"start": other.predecessor, "end": other.successor}.get(contact or "")
    if contact is None:
        return any(k is not None and k.element_id == road_id for k in (other.predecessor, other.successor))
    return link is not None and link.element_id == road_id and link.contact in (end, None)


def graph_problems(network: LaneNetwork) -> list[Row]:
    """Dead ends, lanes that nothing leads to, links at zero width, and unreachable parts."""
    rows: list[Row] = []
    driving = [lane for lane in network.lanes if lane.type == "driving"]
    if not driving:
        types = ", ".join(sorted({lane.type for lane in network.lanes})[:8])
        message = f"no lane is of type driving, so no car can drive ({types})"
        rows.append(("error", "OpenDRIVE", "", 1, message))
    for lane in driving:
        label, line = _label(network, lane.index), _line(network, lane.index)
        ends = network.width_m([lane.index, lane.index], [0.0, lane.length_m])
        beside = lane.left is not None or lane.right is not None
        if not lane.successors and not (ends[1] < 0.5 and beside):
            junction = _junction_at(network, lane, ahead=True)
            message = (
                f"no connection of junction {junction} leads on from it" if junction else "no lane follows"
            )
            rows.append(("warning", "lane", label, line, f"is a dead end: {message}"))
        if not lane.predecessors and not (ends[0] < 0.5 and beside):
            junction = _junction_at(network, lane, ahead=False)
            message = f"connection of junction {junction}" if junction else "lane"
            rows.append(("warning", "lane", label, line, f"cannot be entered: no {message} leads to it"))
        shut = (ends[0] < 1e-3 and lane.predecessors) or (ends[1] < 1e-3 and lane.successors)
        if lane.length_m > 0.1 and shut:
            rows.append(("warning", "lane", label, line, "is linked at an end where it has no width"))
    apart = _unreachable(network)
    if apart:
        largest = Counter(lane.road_id for lane in driving if lane.index in apart)
        first = min(apart)
        names = ", ".join(sorted(largest)[:8])
        message = f"{len(apart)} driving lanes cannot both be reached from and reach the rest (roads {names})"
        rows.append(("warning", "lane", _label(network, first), _line(network, first), message))
    return rows


def _junction_at(network: LaneNetwork, lane: Lane, *, ahead: bool) -> str | None:
    """The junction to which a lane's road links at its end (ahead) or start, seen as cars drive."""
    road = network.xodr.roads[network.road_index[lane.road_id]]
    at_end = lane.forward == ahead
    link = road.successor if at_end else road.predecessor
    outermost = lane.section == (len(road.sections) - 1 if at_end else 0)
    return link.element_id if outermost and link and link.element_type == "junction" else None


def _unreachable(network: LaneNetwork) -> set[int]:
    """Driving lanes outside the largest strongly connected part; lane changes count as ways."""
    driving = [lane for lane in network.lanes if lane.type == "driving"]
    pairs = [
        (lane.index, n)
        for lane in driving
        for n in (*lane.successors, lane.left, lane.right)
        if n is not None and network.lanes[n].type == "driving"
    ]
    if not pairs:
        return {lane.index for lane in driving[1:]}
    a, b = np.array(pairs).T
    size = len(network.lanes)
    graph = csr_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(size, size))
    _, part = connected_components(graph, directed=True, connection="strong")
    main = Counter(int(part[lane.index]) for lane in driving).most_common(1)[0][0]
    return {lane.index for lane in driving if part[lane.index] != main}


def _label(network: LaneNetwork, lane: int) -> str:
    record = network.lanes[lane]
    return f"{record.lane_id} of road {record.road_id}"


def _line(network: LaneNetwork, lane: int) -> int:
    return network.surface.edges.lanes[lane].line
