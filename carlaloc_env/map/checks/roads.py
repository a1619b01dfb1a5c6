"""Checks of single roads: reference line, records, widths, grades, clearance."""

import re

import numpy as np
from scipy.spatial import cKDTree

from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.build_lanes import CAR_WIDTH_M
from carlaloc_env.map.lanes.lane_network import CLEARANCE_M, LaneNetwork
from carlaloc_env.map.opendrive.lane_boundaries import ROUNDING_M
from carlaloc_env.map.opendrive.records import (
    LaneRecord,
    LaneSection,
    Note,
    OpenDrive,
    Road,
    RoadObject,
    Severity,
)

Problem = Note
"""One fault of a map."""
Row = tuple[Severity, str, str, int, str]
"""Values of a `Problem`, in the order of its fields."""


GAP_M = 1e-6
"""Gaps in a reference line from which it is warned of [m]."""
GAP_ERROR_M = 0.1
"""Gaps that are errors [m]."""
HEADING_RAD = 1e-6
"""Kinks of a reference line from which it is warned of [rad]."""
HEADING_ERROR_RAD = 0.05
"""Kinks that are errors [rad]."""
CURVATURE_JUMP_RADPM = 0.01
"""Jumps of curvature from which it is warned of [1/m]."""
LENGTH_M = 1e-6
"""Differences between stated and true length from which it is warned of [m]."""
POLYNOMIAL_LENGTH_M = 1e-3
"""The same of polynomial pieces, whose length is integrated [m]."""
MIN_RADIUS_M = 6.0
"""Narrowest radius that vehicles drive [m]."""
WIDTH_ERROR_M = 0.05
"""Widths below 0 that are errors, not rounding [m]."""
PASSAGE_M = 6.0
"""Roads that come this near to a road's line in the plane pass over or under it [m]."""
PAINT_HEIGHT_M = 0.05
"""Objects that are higher are no paint [m]."""
GRADE = 0.12
"""Steepest grade of a road."""


def road_problems(xodr: OpenDrive, network: LaneNetwork) -> list[Row]:
    """Lengths, ids, furniture off the road, widths, radii and grades."""
    rows: list[Row] = []
    junctions = {junction.id for junction in xodr.junctions}
    for road in xodr.roads:
        total = sum(g.length_m for g in road.geometry)
        if abs(total - road.length_m) > LENGTH_M:
            message = f"length is {road.length_m:g} m, its geometry adds up to {total:.9g} m"
            rows.append(("warning", "road", road.id, road.line, message))
        if road.id in junctions:
            message = "shares its id with a junction, which breaks CARLA's graph"
            rows.append(("warning", "road", road.id, road.line, message))
        if road.junction_id is not None and road.junction_id not in junctions:
            message = f"belongs to junction {road.junction_id}, which does not exist"
            rows.append(("warning", "road", road.id, road.line, message))
        rows += _section_problems(road)
        rows += _furniture_problems(road)
    return rows + _lane_problems(xodr, network)


def _section_problems(road: Road) -> list[Row]:
    rows: list[Row] = []
    for section in road.sections:
        if section.lane(0) is None:
            rows.append(("error", "laneSection", f"of road {road.id}", section.line, "has no centre lane"))
        for lane in section.lanes:
            for mark in lane.road_marks:
                if mark.s_offset_m > section.end_m - section.s_m:
                    message = f"sOffset={mark.s_offset_m:g} lies beyond the section, so it is not drawn"
                    label = f"of lane {lane.id} of road {road.id}"
                    rows.append(("warning", "roadMark", label, lane.line, message))
            if lane.id != 0 and not lane.widths and not lane.borders:
                rows.append(("error", "lane", f"{lane.id} of road {road.id}", lane.line, "has no width"))
            if road.junction_id is None and _bars_changes(section, lane):
                message = "laneChange is not kept: cars may change lanes over the mark"
                label = f"of lane {lane.id} of road {road.id}"
                rows.append(("warning", "roadMark", label, lane.line, message))
    return rows


def _bars_changes(section: LaneSection, lane: LaneRecord) -> bool:
    """Whether a mark forbids a change between this lane and the one outside of it."""
    outer = section.lane(lane.id + (1 if lane.id > 0 else -1))
    between = lane.id != 0 and outer is not None and lane.type == outer.type == "driving"
    return between and any(mark.lane_change != "both" for mark in lane.road_marks)


def _is_built(item: RoadObject) -> bool:
    """Whether an object of the file is painted, or read as a sign."""
    named = re.match(r"[Ss]peed_\d|.*(?:crosswalk|stopline|arrow)", item.name, re.IGNORECASE)
    painted = item.type in ("roadMark", "-1") and item.height_m <= PAINT_HEIGHT_M and bool(item.outlines)
    return item.type == "crosswalk" or painted or named is not None


def _furniture_problems(road: Road) -> list[Row]:
    rows: list[Row] = [
        ("warning", "object", f"{item.id} of road {road.id}", item.line, f"of type {item.type} is not built")
        for item in road.objects
        if not _is_built(item)
    ]
    return rows + [
        ("warning", kind, item.id, item.line, f"s={item.s_m:g} lies beyond road {road.id}")
        for kind, items in (("signal", road.signals), ("object", road.objects))
        for item in items
        if not -0.01 <= item.s_m <= road.length_m + 0.01
    ]


def _lane_problems(xodr: OpenDrive, network: LaneNetwork) -> list[Row]:
    rows: list[Row] = []
    tables, edges = network.tables, network.surface.edges
    owner = np.repeat(np.arange(len(network.lanes)), tables.count)
    station = (np.arange(len(owner)) - tables.first[owner]) * tables.step_m[owner]
    stated = edges.stated_width(owner, network.s_m(owner, station))
    narrow = np.minimum.reduceat(stated, tables.first)
    bend = np.maximum.reduceat(np.abs(tables.curvature_radpm), tables.first)
    steep = np.maximum.reduceat(np.abs(tables.tangent[:, 2]), tables.first)
    for lane in network.lanes:
        line = edges.lanes[lane.index].line
        label = f"{lane.lane_id} of road {lane.road_id}"
        least = narrow[lane.index]
        if least < -ROUNDING_M:
            severity: Severity = "error" if least < -WIDTH_ERROR_M else "warning"
            rows.append((severity, "lane", label, line, f"its width falls to {least:.4g} m; 0 m is taken"))
        if lane.type != edges.lanes[lane.index].type:
            message = f"narrows to {max(least, 0.0):.2f} m, a car has {CAR_WIDTH_M:.2f} m; none drives on it"
            rows.append(("warning", "lane", label, line, message))
        if lane.type != "driving" or lane.length_m < 0.1:
            continue
        if bend[lane.index] > 1.0 / MIN_RADIUS_M * 1.001:
            message = f"its radius falls to {1.0 / bend[lane.index]:.2f} m; cars need {MIN_RADIUS_M:g} m"
            rows.append(("warning", "lane", label, line, message))
        if steep[lane.index] > GRADE:
            message = f"its grade reaches {100.0 * steep[lane.index]:.1f} %"
            rows.append(("warning", "lane", label, line, message))
    return rows


def plan_view_problems(xodr: OpenDrive, network: LaneNetwork) -> list[Row]:
    """Joints inside reference lines, and shapes that other readers stumble over."""
    rows: list[Row] = []
    for n, road in enumerate(xodr.roads):
        jumps = []
        for k, (g, following) in enumerate(zip(road.geometry, road.geometry[1:], strict=False), start=1):
            label = f"{k} of road {road.id}"
            s = np.array([g.s_m + g.length_m, following.s_m])
            # Just before the joint the earlier piece answers; the later one has its own start.
            inner = min(g.s_m + g.length_m, following.s_m)
            at = np.array([np.nextafter(inner, -np.inf)])
            before = network.surface.plan_view.evaluate(np.array([n]), at)
            if abs(s[1] - s[0]) > 1e-6:
                severity: Severity = "error" if abs(s[1] - s[0]) > GAP_ERROR_M else "warning"
                message = f"s={s[1]:.9g}, the piece before ends at {s[0]:.9g}"
                rows.append((severity, "geometry", label, following.line, message))
            gap = float(np.hypot(following.x_m - before.x_m[0], following.y_m - before.y_m[0]))
            turn = float(abs(wrap_angle(following.heading_rad - before.heading_rad[0])))
            if gap > GAP_M or turn > HEADING_RAD:
                bad = gap > GAP_ERROR_M or turn > HEADING_ERROR_RAD
                message = f"starts {gap:.2g} m and {turn:.2g} rad off the end of the piece before"
                rows.append(("error" if bad else "warning", "geometry", label, following.line, message))
            at = np.array([np.nextafter(following.s_m, np.inf)])
            after = network.surface.plan_view.evaluate(np.array([n]), at)
            jumps.append(abs(float(after.curvature_radpm[0] - before.curvature_radpm[0])))
        if jumps and max(jumps) > CURVATURE_JUMP_RADPM:
            k = int(np.argmax(jumps)) + 1
            message = f"curvature jumps by up to {max(jumps):.3g} 1/m; join pieces by spirals"
            rows.append(("warning", "geometry", f"{k} of road {road.id}", road.geometry[k].line, message))
        rows += _nan_in_carla(road)
        rows += _stated_length(network, n, road)
    return rows


def _nan_in_carla(road: Road) -> list[Row]:
    rows: list[Row] = []
    for k, g in enumerate(road.geometry):
        label = f"{k} of road {road.id}"
        if g.kind == "arc" and g.curvature_start_radpm == 0.0:
            message = "has no curvature, which CARLA turns into NaN; write a line"
            rows.append(("warning", "arc", label, g.line, message))
        if g.kind == "spiral" and abs(g.curvature_start_radpm - g.curvature_end_radpm) < 1e-9:
            message = "has equal curvatures, which CARLA turns into NaN; write an arc or a line"
            rows.append(("warning", "spiral", label, g.line, message))
    return rows


def _stated_length(network: LaneNetwork, n: int, road: Road) -> list[Row]:
    """paramPoly3 pieces whose curve is longer or shorter than they say."""
    rows: list[Row] = []
    for k, g in enumerate(road.geometry):
        if g.kind != "paramPoly3" or g.length_m == 0.0:
            continue
        middle = np.array([g.s_m + 0.5 * g.length_m])
        rate = float(network.surface.plan_view.evaluate(np.array([n]), middle).rate[0])
        if abs(rate - 1.0) * g.length_m > POLYNOMIAL_LENGTH_M:
            message = f"length is {g.length_m:.9g} m, its curve has {rate * g.length_m:.9g} m"
            rows.append(("warning", "geometry", f"{k} of road {road.id}", g.line, message))
    return rows


def clearance_problems(network: LaneNetwork) -> list[Row]:
    """Roads outside junctions that cross too low above each other, or at one level."""
    tables = network.tables
    owner = np.repeat(np.arange(len(network.lanes)), tables.count)
    free = np.array([lane.type == "driving" and lane.junction_id is None for lane in network.lanes])
    rows = np.flatnonzero(free[owner])[::2]
    if len(rows) < 2:
        return []
    p = tables.position_m[rows]
    road = np.array([network.road_index[lane.road_id] for lane in network.lanes])[owner[rows]]
    number = min(12, len(rows))
    # A fixed number of neighbours keeps the work bounded on any map.
    away, near = cKDTree(p[:, :2]).query(p[:, :2], k=number, distance_upper_bound=1.5)
    hit = np.isfinite(away) & (near < len(rows))
    other = np.where(hit, near, 0)
    rise = np.abs(p[other, 2] - p[:, 2][:, None])
    linked = _linked(network)
    least_rise_m: dict[tuple[int, int], float] = {}
    for a, k in np.argwhere(hit & (road[other] != road[:, None]) & (rise < CLEARANCE_M)):
        pair = (int(min(road[a], road[other[a, k]])), int(max(road[a], road[other[a, k]])))
        if pair not in linked:
            least_rise_m[pair] = min(least_rise_m.get(pair, np.inf), float(rise[a, k]))
    roads, advice = network.xodr.roads, f"leave {CLEARANCE_M:g} m or join them in a junction"
    messages = {
        pair: f"crosses road {roads[pair[1]].id} with {rise_m:.2f} m between them; {advice}"
        for pair, rise_m in sorted(least_rise_m.items())
    }
    return [("warning", "road", roads[a].id, roads[a].line, text) for (a, _), text in messages.items()]


def passage_problems(network: LaneNetwork) -> list[Row]:
    """Tunnels and bridges of the file that are not built, since no road crosses above or below them."""
    rows: list[Row] = []
    if not any(road.passages for road in network.xodr.roads):
        return rows
    points = network.tables.position_m
    tree = cKDTree(points[:, :2])
    for n, road in enumerate(network.xodr.roads):
        for passage in road.passages:
            s = np.linspace(passage.s_m, passage.s_m + min(passage.length_m, road.length_m), 64)
            line = network.surface.position(np.full(len(s), n), s, np.zeros(len(s)))
            near = tree.query_ball_point(line[:, :2], PASSAGE_M)
            rise = np.concatenate([points[own, 2] - at[2] for own, at in zip(near, line, strict=True)])
            built = rise > CLEARANCE_M if passage.kind == "tunnel" else rise < -CLEARANCE_M
            if not built.any():
                message = "is not built: no road passes over it"
                if passage.kind == "bridge":
                    message = "is built only over a zone of water: no road passes under it"
                label = f"{passage.id} of road {road.id}"
                rows.append(("warning", passage.kind, label, passage.line, message))
    return rows


def _linked(network: LaneNetwork) -> set[tuple[int, int]]:
    """Pairs of roads that follow each other or meet at one junction road."""
    index = network.road_index
    pairs: set[tuple[int, int]] = set()
    for lane in network.lanes:
        around = [index[network.lanes[n].road_id] for n in (*lane.successors, *lane.predecessors)]
        around.append(index[lane.road_id])
        pairs |= {(min(a, b), max(a, b)) for a in around for b in around}
    return pairs
