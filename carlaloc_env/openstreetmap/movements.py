"""Lanes of legs that lead to lanes of others: by tagged turns, else by the rules of our own towns."""

from __future__ import annotations

import math
from collections.abc import Sequence

from carlaloc_env.authoring.elements.junctions import STRAIGHT_RAD, Movement, lane_pairs, turn_angle
from carlaloc_env.authoring.elements.map_parts import Leg

U_TURN_RAD = math.radians(150)
"""Movements that turn by more lead back."""
Pairs = list[tuple[int, int]]


def find_movements(
    legs: Sequence[Leg], allowed: set[tuple[int, int]], turns: Sequence[Sequence[str]]
) -> list[Movement]:
    """Movements of a junction; a leg that nothing leads out of or into turns back into itself.

    Args:
        legs: Its legs.
        allowed: Pairs of source and target between which the streets lead.
        turns: Marks of the incoming lanes of every leg, from the left; empty where none are tagged.
    """
    movements: list[Movement] = []
    for i, leg in enumerate(legs):
        if not leg.incoming:
            continue
        targets = [j for j in range(len(legs)) if (i, j) in allowed and legs[j].outgoing]
        onward = [j for j in targets if abs(turn_angle(leg, legs[j])) < U_TURN_RAD]
        onward = onward or ([] if leg.outgoing else targets)
        by_turn: dict[str, list[int]] = {"left": [], "straight": [], "right": []}
        for j in sorted(onward, key=lambda j: -turn_angle(leg, legs[j])):
            angle = turn_angle(leg, legs[j])
            by_turn["straight" if abs(angle) <= STRAIGHT_RAD else "left" if angle > 0 else "right"].append(j)
        own: list[Movement] = []
        for turn, group in by_turn.items():
            for j in group:
                pairs = _pairs(leg, legs, j, turn, by_turn, turns[i])
                if pairs:
                    own.append(Movement(i, j, tuple(pairs), turn))
        movements += own + _rest(i, legs, own)
    # A one-way street that nothing else leads into is entered by turning back.
    reached = {m.target for m in movements}
    for i, j in sorted(allowed):
        if j not in reached and not legs[j].incoming and legs[i].incoming:
            movements.append(Movement(i, j, ((0, 0),), "back"))
    used = ({m.source for m in movements}, {m.target for m in movements})
    for i, leg in enumerate(legs):
        count = min(len(leg.incoming), len(leg.outgoing))
        if count and not all(i in legs_used for legs_used in used):
            movements.append(Movement(i, i, tuple((k, k) for k in range(count)), "back"))
    return movements


def _pairs(
    leg: Leg,
    legs: Sequence[Leg],
    j: int,
    turn: str,
    by_turn: dict[str, list[int]],
    marks: Sequence[str],
) -> Pairs:
    room = len(legs[j].outgoing)
    word = {"straight": "through"}.get(turn, turn)
    marked = [k for k, mark in enumerate(marks) if word in mark and "merge" not in mark]
    if len(marks) == len(leg.incoming) and marked:
        lanes = list(range(marked[0], marked[-1] + 1))
    elif turn == "straight":
        lanes = list(range(len(leg.incoming)))
    else:
        return lane_pairs(leg, legs, j, turn, by_turn)
    if turn == "left":
        return [(lane, k) for k, lane in enumerate(lanes[:room])]
    if turn == "right":
        lanes = lanes[-room:]
        return [(lane, room - len(lanes) + k) for k, lane in enumerate(lanes)]
    return _aligned(leg, legs[j], lanes)


def _aligned(leg: Leg, target: Leg, lanes: Sequence[int]) -> Pairs:
    """Neighbouring lanes onto neighbouring lanes, so that none is led farther aside than it must."""
    count = min(len(lanes), len(target.outgoing))
    options = []
    for a in range(len(lanes) - count + 1):
        for b in range(len(target.outgoing) - count + 1):
            pairs = [(lanes[a + k], b + k) for k in range(count)]
            options.append((round(sum(_aside(leg, target, p) ** 2 for p in pairs), 6), a, b, pairs))
    return min(options)[3]


def _aside(leg: Leg, target: Leg, pair: tuple[int, int]) -> float:
    """How far a lane's middle is led sideways, seen along the mean of both headings [m]."""
    source, onto = leg.incoming[pair[0]], target.outgoing[pair[1]]
    a = leg.pose.ahead(0.0, -(source.right_m + 0.5 * source.width_m))
    b = target.out_axis.ahead(0.0, -(onto.right_m + 0.5 * onto.width_m))
    heading = leg.pose.h + 0.5 * turn_angle(leg, target)
    return -(b.x - a.x) * math.sin(heading) + (b.y - a.y) * math.cos(heading)


def _rest(i: int, legs: Sequence[Leg], own: Sequence[Movement]) -> list[Movement]:
    """Lanes that no movement takes follow the movement beside them."""
    movements: list[Movement] = []
    taken = {a for movement in own for a, _ in movement.lanes}
    for lane in range(len(legs[i].incoming)):
        if lane in taken or not own:
            continue
        nearest = min(own, key=lambda m: (m.turn != "straight", min(abs(a - lane) for a, _ in m.lanes)))
        last = len(legs[nearest.target].outgoing) - 1
        beside, onto = min(nearest.lanes, key=lambda p: abs(p[0] - lane))
        onto = min(max(onto + lane - beside, 0), last)
        movements.append(Movement(i, nearest.target, ((lane, onto),), nearest.turn))
    return movements
