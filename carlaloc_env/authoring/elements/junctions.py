"""Junctions of any number of legs: movements, connecting roads and the sidewalks of their corners."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from carlaloc_env.authoring.elements.cross_sections import (
    NONE,
    LanePlan,
    Mark,
    SectionPlan,
    blend,
    border_mark,
)
from carlaloc_env.authoring.elements.ids import Numbers
from carlaloc_env.authoring.elements.map_parts import (
    Border,
    ConnectionPart,
    JunctionPart,
    Leg,
    Link,
    RoadPart,
)
from carlaloc_env.authoring.geometry.elevation import Record, hermite, level
from carlaloc_env.authoring.geometry.junction_planes import Plane, in_plane
from carlaloc_env.authoring.geometry.newton import PlanError
from carlaloc_env.authoring.geometry.plan_view_curves import Path, curve_between, wrap

STRAIGHT_RAD = math.radians(40)
"""Movements that turn by less lead straight on."""


@dataclass(frozen=True, slots=True)
class Movement:
    """Traffic from some lanes of one leg to as many lanes of another."""

    source: int
    target: int
    lanes: tuple[tuple[int, int], ...]
    """Pairs of indices into the source's incoming and the target's outgoing lanes, from the left."""
    turn: str


def turn_angle(source: Leg, target: Leg) -> float:
    """Heading change of a movement [rad], left positive, a U-turn being +π."""
    return wrap(target.out_axis.h - source.pose.h)


def lane_pairs(
    leg: Leg, legs: Sequence[Leg], j: int, turn: str, turns: dict[str, list[int]]
) -> list[tuple[int, int]]:
    """Lanes of a movement to leg j: pairs of indices from the left."""
    count, room = len(leg.incoming), len(legs[j].outgoing)
    lanes = list(range(1 if leg.pocket else 0, count))
    if turn == "left":
        if leg.pocket or turns["straight"]:
            lanes = [0]
        elif turns["right"]:
            # At the foot of a T: all lanes that do not turn right.
            lanes = lanes[: max(1, count - len(legs[turns["right"][0]].outgoing))]
        lanes = lanes[:room]
        return [(lane, k) for k, lane in enumerate(lanes)]
    if turn == "right":
        if turns["straight"]:
            lanes = [count - 1]
        elif turns["left"] and len(lanes) == count > 1:
            lanes = lanes[1:]
        lanes = lanes[-room:]
        return [(lane, room - len(lanes) + k) for k, lane in enumerate(lanes)]
    if len(lanes) > room:
        lanes = lanes[:room] if turns["right"] else lanes[-room:]
    return [(lane, k) for k, lane in enumerate(lanes)]


def connect(
    part: JunctionPart,
    source: Leg,
    target: Leg,
    pairs: Sequence[tuple[int, int]],
    numbers: Numbers,
    plane: Plane,
    *,
    outer: bool,
    path: Path | None = None,
    inner: bool = False,
) -> RoadPart:
    """One connecting road; its reference line is the left border of its leftmost lane.

    Args:
        part: The junction.
        source: Leg that the traffic comes from.
        target: Leg that it goes to.
        pairs: Indices into the source's incoming and the target's outgoing lanes, from the left.
        numbers: Counter of identifiers.
        plane: Plane of the junction.
        outer: Whether gutter, shoulder and sidewalk go along on the right.
        path: The reference line; None: the curve between both legs.
        inner: Whether median or inner shoulder go along on the left.
    """
    ins = [source.incoming[a] for a, _ in pairs]
    outs = [target.outgoing[b] for _, b in pairs]
    if path is None:
        start = source.border(source.pose, ins[0].right_m)
        path = curve_between(start, target.border(target.out_axis, outs[0].right_m))
    path = path.settled()
    lanes = [_lane(a, b, path.length) for a, b in zip(ins, outs, strict=True)]
    complete = pairs[-1][0] == len(source.incoming) - 1 and pairs[-1][1] == len(target.outgoing) - 1
    if outer and complete:
        lanes += _paired(source.incoming_outer, target.outgoing_outer, path.length)
    for lane, beyond in zip(lanes, [*lanes[1:], None], strict=True):
        lane.marks = [border_mark(lane, beyond, True)]
        if lane.kind == "driving":
            lane.marks = [Mark(0.0, "none", "standard", 0.0)]
    left = _paired(source.incoming_inner, target.outgoing_inner, path.length) if inner else []
    for lane in left:
        lane.marks = [Mark(0.0, "none", "standard", 0.0)]
    section = SectionPlan(0.0, path.length, NONE, left, lanes, Mark(0.0, "none", "standard", 0.0))
    elevation, tilt = _profiles(source, target, path, plane)
    road = RoadPart(
        id=numbers.connecting_road(part.id),
        name=part.name,
        path=path,
        elevation=elevation,
        tilt=tilt,
        sections=[section],
        speed_kmh=min(source.road.speed_kmh, target.road.speed_kmh),
        junction=part.id,
        predecessor=Link("road", source.road.id, source.end),
        successor=Link("road", target.road.id, target.end),
    )
    links = [(border.lane_id, -k - 1) for k, border in enumerate(ins)]
    part.connections.append(ConnectionPart(source.road.id, road.id, links))
    return road


def _profiles(source: Leg, target: Leg, path: Path, plane: Plane) -> tuple[list[Record], list[Record]]:
    """Elevation and superelevation: in the junction's plane where it slopes, level where both legs are.

    Elsewhere, as at the ends of ramps, a cubic keeps the heights and grades of both legs.
    """
    if not plane.is_level:
        for leg in (source, target):
            gaps = [a - b for a, b in zip(leg.height(), plane.height(leg.pose), strict=True)]
            if max(map(abs, [*gaps, leg.tilt() - plane.tilt(leg.pose)])) > 1e-8:
                raise PlanError(f"road '{leg.road.name}' does not end in the plane of its sloping junction")
        return in_plane(plane, path)
    (z0, grade0), (z1, grade1) = source.height(), target.height()
    if max(abs(grade0), abs(grade1), abs(z0 - z1)) < 1e-9:
        return level(plane.z), []
    return hermite(z0, grade0, z1, -grade1, path.length), []


def _lane(source: Border, target: Border, length: float) -> LanePlan:
    return LanePlan(
        source.lane.key,
        source.lane.kind,
        blend(source.width_m, target.width_m, length),
        height_m=source.lane.height_m,
        surface=source.lane.surface if source.lane.surface == target.lane.surface else "asphalt",
        predecessor=source.lane_id,
        successor=target.lane_id,
    )


def _paired(source: Sequence[Border], target: Sequence[Border], length: float) -> list[LanePlan]:
    """Lanes beside the driving lanes that both legs have: gutter, shoulder, sidewalk, median."""
    after = {_name(border): border for border in target}
    return [_lane(b, after[_name(b)], length) for b in source if _name(b) in after]


def _name(border: Border) -> str:
    return border.lane.key.split(":", 1)[1]
