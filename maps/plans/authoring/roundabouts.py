"""Roundabouts: a ring of arcs and one junction per arm, all traffic anticlockwise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from carlaloc_env.authoring.elements.cross_sections import (
    NONE,
    SIDEWALK_HEIGHT_M,
    LanePlan,
    Mark,
    SectionPlan,
    border_mark,
    constant,
)
from carlaloc_env.authoring.elements.ids import JUNCTION, ROAD, Numbers
from carlaloc_env.authoring.elements.junctions import connect
from carlaloc_env.authoring.elements.map_parts import JunctionPart, Leg, Link, RoadPart, leg_of
from carlaloc_env.authoring.geometry.elevation import level
from carlaloc_env.authoring.geometry.junction_planes import Plane
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Piece, Pose, wrap

from .curves import mirrored, ring_entry


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundaboutShape:
    """Size of a roundabout."""

    island_m: float = 20.5
    """Radius of the island with its kerb [m]; the ring's reference line."""
    lanes: int = 2
    lane_m: float = 4.6
    gutter_m: float = 0.3
    sidewalk_m: float = 3.0
    arm_m: float = 37.0
    """From the centre to the ends of the arms [m]."""
    half_angle_rad: float = math.radians(35.0)
    """Where entries and exits meet the ring, on both sides of an arm's axis."""
    first_spiral_m: float = 6.0
    last_spiral_m: float = 5.0


def build_roundabout(
    name: str,
    centre: tuple[float, float],
    z: float,
    shape: RoundaboutShape,
    legs: Sequence[Leg],
    speed_kmh: float,
    numbers: Numbers,
) -> tuple[list[RoadPart], list[JunctionPart], dict[int, int]]:
    """Ring pieces, connecting roads and junctions; and the junction id that each leg's road meets."""
    order = sorted(range(len(legs)), key=lambda i: wrap(legs[i].out_axis.h))
    ring: list[RoadPart] = []
    parts: list[JunctionPart] = []
    for k, i in enumerate(order):
        following = legs[order[(k + 1) % len(order)]].out_axis.h
        half, next_half = (_half_angle(shape, legs[m]) for m in (i, order[(k + 1) % len(order)]))
        first = legs[i].out_axis.h + half
        sweep = (following - legs[i].out_axis.h) % (2 * math.pi) - half - next_half
        number = numbers.next(ROAD)
        ring.append(_ring_piece(number, f"{name} ring {k + 1}", centre, z, shape, first, sweep, speed_kmh))
        parts.append(JunctionPart(numbers.next(JUNCTION), f"{name} arm {k + 1}"))
    roads = list(ring)
    met: dict[int, int] = {}
    for k, i in enumerate(order):
        into, out_of = ring[k - 1], ring[k]
        into.successor = Link("junction", parts[k].id)
        out_of.predecessor = Link("junction", parts[k].id)
        met[legs[i].road.id] = parts[k].id
        roads += _arm(parts[k], legs[i], into, out_of, centre, z, shape, numbers)
    return roads, parts, met


def _inside(shape: RoundaboutShape, leg: Leg) -> float:
    """From the ring's reference line to the left border of the lanes that an arm uses [m]."""
    return max(0, shape.lanes - len(leg.incoming)) * shape.lane_m


def _half_angle(shape: RoundaboutShape, leg: Leg) -> float:
    """Smaller where an arm meets outer lanes only, so that its traffic moves aside no further."""
    aside = shape.island_m * math.sin(shape.half_angle_rad)
    if _inside(shape, leg) > 0:
        aside -= 1.5
    return math.asin(aside / (shape.island_m + _inside(shape, leg)))


def _on_ring(centre: tuple[float, float], radius: float, angle: float) -> Pose:
    x, y = centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle)
    return Pose(x, y, angle + math.pi / 2)


def _ring_piece(
    number: int,
    name: str,
    centre: tuple[float, float],
    z: float,
    shape: RoundaboutShape,
    first: float,
    sweep: float,
    speed_kmh: float,
) -> RoadPart:
    k = 1 / shape.island_m
    path = Path(_on_ring(centre, shape.island_m, first), (Piece(sweep * shape.island_m, k, k),)).settled()
    lanes = [LanePlan(f"R:{i}", "driving", constant(shape.lane_m)) for i in range(shape.lanes)]
    lanes.append(LanePlan("R:gutter", "shoulder", constant(shape.gutter_m)))
    walk = LanePlan("R:walk", "sidewalk", constant(shape.sidewalk_m), height_m=SIDEWALK_HEIGHT_M)
    lanes.append(walk)
    for lane, beyond in zip(lanes, [*lanes[1:], None], strict=True):
        lane.marks = [border_mark(lane, beyond, True)]
    section = SectionPlan(0.0, path.length, NONE, [], lanes, Mark(0.0, "curb", "standard", 0.15))
    return RoadPart(number, name, path, level(z), [section], speed_kmh)


def _arm(
    part: JunctionPart,
    leg: Leg,
    into: RoadPart,
    out_of: RoadPart,
    centre: tuple[float, float],
    z: float,
    shape: RoundaboutShape,
    numbers: Numbers,
) -> list[RoadPart]:
    """Entry, exit and the ring's own movement; the exit mirrors the entry.

    An arm with fewer lanes than the ring uses the ring's outer lanes.
    """
    ring_in, ring_out = leg_of(into, "end"), leg_of(out_of, "start")
    k, sweep = 1 / shape.island_m, 2 * _half_angle(shape, leg)
    around = Path(ring_in.pose, (Piece(sweep * shape.island_m, k, k),))
    count = min(shape.lanes, len(leg.incoming))
    inside = _inside(shape, leg)
    entry = ring_entry(
        leg.pose.ahead(0.0, -leg.incoming[0].right_m),
        ring_out.out_axis.ahead(0.0, -inside),
        1 / (shape.island_m + inside),
        shape.first_spiral_m,
        shape.last_spiral_m,
    )
    exit_path = mirrored(entry, Pose(centre[0], centre[1], leg.out_axis.h))
    through = [(i, i) for i in range(shape.lanes)]
    inward = [(i, shape.lanes - count + i) for i in range(count)]
    outward = [(b, a) for a, b in inward]
    roads = [
        connect(part, ring_in, ring_out, through, numbers, Plane(*centre, z), outer=False, path=around),
        connect(part, leg, ring_out, inward, numbers, Plane(*centre, z), outer=True, path=entry),
        connect(part, ring_in, leg, outward, numbers, Plane(*centre, z), outer=True, path=exit_path),
    ]
    for road, what in zip(roads, ("ring", "entry", "exit"), strict=True):
        road.name = f"{part.name} {what}"
    return roads
