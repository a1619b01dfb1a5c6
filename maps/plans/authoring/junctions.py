"""Junctions of plans: their movements and connecting roads, and how far legs end from the node."""

import math
from collections.abc import Sequence

from carlaloc_env.authoring.elements.ids import Numbers
from carlaloc_env.authoring.elements.junctions import STRAIGHT_RAD, Movement, connect, lane_pairs, turn_angle
from carlaloc_env.authoring.elements.map_parts import JunctionPart, Leg, RoadPart
from carlaloc_env.authoring.geometry.junction_planes import Plane
from carlaloc_env.authoring.geometry.plan_view_curves import wrap


def movements(legs: Sequence[Leg], no_left: Sequence[str]) -> list[Movement]:
    """Every legal movement: pocket or left lane to the left, right lane to the right, the rest straight."""
    legal: list[Movement] = []
    for i, leg in enumerate(legs):
        turns: dict[str, list[int]] = {"left": [], "straight": [], "right": []}
        for j, other in enumerate(legs):
            if j != i and other.outgoing and leg.incoming:
                angle = turn_angle(leg, other)
                key = "straight" if abs(angle) <= STRAIGHT_RAD else "left" if angle > 0 else "right"
                if key != "left" or leg.road.street not in no_left:
                    turns[key].append(j)
        for turn, targets in turns.items():
            for j in targets:
                pairs = lane_pairs(leg, legs, j, turn, turns)
                if pairs:
                    legal.append(Movement(i, j, tuple(pairs), turn))
    return legal


def build_junction(
    part: JunctionPart,
    legs: Sequence[Leg],
    numbers: Numbers,
    plane: Plane,
    *,
    no_left: Sequence[str],
) -> tuple[list[RoadPart], list[Movement]]:
    """Fill a junction: one connecting road per movement.

    The outermost movement from every leg (its right turn, or straight on along the far side of a T)
    carries gutter and sidewalk lanes round the corner, as CARLA's own maps do.
    """
    roads: list[RoadPart] = []
    legal = movements(legs, no_left)
    for movement in legal:
        source, target = legs[movement.source], legs[movement.target]
        angles = {j: turn_angle(source, other) for j, other in enumerate(legs) if j != movement.source}
        outermost = min(angles, key=lambda j: angles[j]) == movement.target
        road = connect(part, source, target, movement.lanes, numbers, plane, outer=outermost)
        road.name = f"{part.name} {movement.turn} from {source.road.name}"
        roads.append(road)
    return roads, legal


def setbacks(
    headings: Sequence[float], kerbs: Sequence[float], corner_m: float, least_m: float
) -> list[float]:
    """How far from the node each leg must end so that kerbs of radius `corner_m` fit between legs [m]."""
    result = []
    for i, (heading, kerb) in enumerate(zip(headings, kerbs, strict=True)):
        need = least_m
        for j, (other, other_kerb) in enumerate(zip(headings, kerbs, strict=True)):
            angle = abs(wrap(other - heading))
            if i != j and angle < math.pi - STRAIGHT_RAD:
                crossing = (other_kerb + kerb * math.cos(angle)) / math.sin(angle)
                need = max(need, crossing + corner_m / math.tan(angle / 2))
        result.append(need)
    return result
