"""Checks of traffic lights, signs and their groups."""

from collections import Counter

from carlaloc_env.map.checks.roads import Row
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.records import OpenDrive


def signal_problems(xodr: OpenDrive, network: LaneNetwork) -> list[Row]:
    """Repeated ids, lights without lanes or group, and references to what does not exist."""
    signals = [signal for road in xodr.roads for signal in road.signals]
    lines = {signal.id: signal.line for signal in signals}
    rows: list[Row] = [
        ("error", "signal", label, lines[label], f"{count} signals share this id")
        for label, count in Counter(signal.id for signal in signals).items()
        if count > 1
    ]
    for road in xodr.roads:
        for reference in road.signal_references:
            if reference.id not in lines:
                message = f"on road {road.id} names a signal that does not exist"
                rows.append(("warning", "signalReference", reference.id, reference.line, message))
    groups = {controller.id for controller in xodr.controllers}
    for controller in xodr.controllers:
        for label in controller.signal_ids:
            if label not in lines:
                message = f"names signal {label}, which does not exist"
                rows.append(("warning", "controller", controller.id, controller.line, message))
    for junction in xodr.junctions:
        for member in junction.controllers:
            if member.id not in groups:
                message = f"names controller {member.id}, which does not exist"
                rows.append(("warning", "junction", junction.id, junction.line, message))
    return rows + _head_problems(network, lines)


def _head_problems(network: LaneNetwork, lines: dict[str, int]) -> list[Row]:
    rows: list[Row] = []
    group_of: dict[int, set[str]] = {}
    for head in network.signals:
        if not head.lanes:
            message = "is a traffic light that no lane obeys"
            rows.append(("warning", "signal", head.id, lines[head.id], message))
        elif head.controller_id is None:
            rows.append(("warning", "signal", head.id, lines[head.id], "is a traffic light in no controller"))
        for lane in head.lanes:
            group_of.setdefault(lane, set()).add(head.controller_id or head.id)
    # A lane under two groups is right only where they open different turns.
    for head in network.signals:
        for lane in head.lanes:
            if len(group_of[lane]) > 1 and not head.junction_lanes:
                record = network.lanes[lane]
                message = f"lane {record.lane_id} of road {record.road_id} obeys two groups"
                rows.append(("error", "signal", head.id, lines[head.id], message))
    for sign in network.static_signs:
        if sign.kind == "other":
            message = f"is a sign of type {sign.type}, which cars do not heed"
            rows.append(("warning", "signal", sign.id, lines.get(sign.id, 0), message))
        if sign.kind in ("stop", "yield") and not sign.lanes:
            message = f"is a {sign.kind} sign that no lane obeys"
            rows.append(("warning", "signal", sign.id, lines.get(sign.id, 0), message))
    return rows
