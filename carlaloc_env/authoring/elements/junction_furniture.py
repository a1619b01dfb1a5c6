"""Furniture and paint at the legs of a junction: lights, signs, stop lines, crosswalks, arrows."""

import math
from collections.abc import Sequence

from carlaloc_env.authoring.elements.ids import CONTROLLER, OBJECT, SIGNAL, Numbers
from carlaloc_env.authoring.elements.junctions import Movement, turn_angle
from carlaloc_env.authoring.elements.map_parts import (
    Border,
    ControllerPart,
    JunctionPart,
    Leg,
    ObjectPart,
    RoadPart,
    SignalPart,
)
from carlaloc_env.map.lanes.lanes import SIGN_CODES

LIGHT, STOP, YIELD, SPEED = "1000001", SIGN_CODES["stop"], SIGN_CODES["yield"], SIGN_CODES["speed"]
"""OpenDRIVE's type of traffic lights, and of the signs that are written."""
CROSSWALK_INSET_M = 1.5
"""Distance of crosswalks from the junction [m]."""
CROSSWALK_M = 3.5
"""Width of crosswalks [m]."""
STOP_LINE_M = 0.4
"""Width of stop lines [m]."""
STOP_LINE_GAP_M = 1.2
"""Distance of stop lines from crosswalks [m]."""


def _kerb(borders: Sequence[Border], outer: Sequence[Border]) -> float:
    """From the axis to the kerb on the right of travel [m]; sidewalks lie beyond it."""
    inner = [b for b in [*borders, *outer] if b.lane.kind != "sidewalk"]
    return max((b.right_m + b.width_m for b in inner), default=0.0)


def _rectangle(
    numbers: Numbers,
    leg: Leg,
    kind: str,
    name: str,
    back_m: float,
    depth_m: float,
    right_m: tuple[float, float],
) -> ObjectPart:
    """Area across the road, `depth_m` deep, centred `back_m` before the end of the leg."""
    middle, half = 0.5 * (right_m[0] + right_m[1]), 0.5 * abs(right_m[1] - right_m[0])
    u = 0.5 * depth_m
    outline = [(-u, -half), (u, -half), (u, half), (-u, half), (-u, -half)]
    hdg = 0.0 if leg.sign > 0 else math.pi
    number = numbers.next(OBJECT)
    return ObjectPart(number, kind, name, leg.s(back_m), -leg.sign * middle, hdg, depth_m, 2 * half, outline)


def mark_leg(leg: Leg, numbers: Numbers, *, crosswalk: bool, stop_line: bool) -> float:
    """Paint crosswalk and stop line of one leg; how far from its end the stop line's near edge lies [m]."""
    back = STOP_LINE_GAP_M
    if crosswalk:
        paint_crosswalk(leg, numbers, CROSSWALK_INSET_M + 0.5 * CROSSWALK_M)
        back = CROSSWALK_INSET_M + CROSSWALK_M + STOP_LINE_GAP_M
    if stop_line and leg.incoming:
        edges = (leg.incoming[0].right_m, leg.incoming[-1].right_m + leg.incoming[-1].width_m)
        centre = back + 0.5 * STOP_LINE_M
        leg.road.objects.append(_rectangle(numbers, leg, "roadMark", "StopLine", centre, STOP_LINE_M, edges))
    return back + STOP_LINE_M


def paint_crosswalk(leg: Leg, numbers: Numbers, centre_m: float) -> None:
    """Paint a crosswalk from kerb to kerb, whose middle lies so far before the end of the leg [m]."""
    kerbs = (-_kerb(leg.outgoing, leg.outgoing_outer), _kerb(leg.incoming, leg.incoming_outer))
    leg.road.objects.append(_rectangle(numbers, leg, "crosswalk", "Crosswalk", centre_m, CROSSWALK_M, kerbs))


def paint_arrows(legs: Sequence[Leg], movements: Sequence[Movement], numbers: Numbers, back_m: float) -> None:
    """Turn arrows on every lane of legs with more than one incoming lane."""
    for i, leg in enumerate(legs):
        if len(leg.incoming) < 2:
            continue
        for k, border in enumerate(leg.incoming):
            turns = {m.turn for m in movements if m.source == i and any(a == k for a, _ in m.lanes)}
            name = "Arrow" + "".join(t.capitalize() for t in ("left", "straight", "right") if t in turns)
            middle = border.right_m + 0.5 * border.width_m
            edges = (middle - 0.5, middle + 0.5)
            leg.road.objects.append(_rectangle(numbers, leg, "roadMark", name, back_m + 6.0, 4.0, edges))


def _post(
    leg: Leg, numbers: Numbers, name: str, code: str, borders: Sequence[Border], back_m: float, right_m: float
) -> SignalPart:
    ids = sorted(b.lane_id for b in borders)
    part = SignalPart(
        numbers.next(SIGNAL), name, leg.s(back_m), -leg.sign * right_m, leg.sign, code, (ids[0], ids[-1])
    )
    leg.road.signals.append(part)
    return part


def sign_leg(leg: Leg, numbers: Numbers, back_m: float, code: str) -> None:
    """Stop or yield sign on the right of a leg."""
    right = _kerb(leg.incoming, leg.incoming_outer) + 0.6
    name = {STOP: "Stop", YIELD: "Yield"}[code]
    part = _post(leg, numbers, name, code, leg.incoming, back_m, right)
    part.z_m = 2.0


def light_junction(
    part: JunctionPart, legs: Sequence[Leg], backs_m: Sequence[float], numbers: Numbers, *, split: bool
) -> list[ControllerPart]:
    """Lights of a junction: one group per leg, one more per left-turn pocket.

    Opposite legs share a sequence number (they are green together), their pockets the next one;
    `split` gives every leg a sequence of its own.
    """
    controllers: list[ControllerPart] = []
    sequence = 0
    for together in _phases(legs, split):
        for pocket in (False, True):
            groups = [i for i in together if legs[i].pocket] if pocket else together
            if pocket and (split or not groups):
                continue
            for i in groups:
                leg = legs[i]
                own = [b for b in leg.incoming if split or b.lane.key.endswith(":pocket") == pocket]
                signal = _light(leg, numbers, own, backs_m[i], left=pocket)
                name = f"{part.name} {leg.road.name}{' left' if pocket else ''}"
                controllers.append(ControllerPart(numbers.next(CONTROLLER), name, sequence, [signal.id]))
            sequence += 1
    part.controllers = [(c.id, c.sequence) for c in controllers]
    return controllers


def _light(leg: Leg, numbers: Numbers, borders: Sequence[Border], back_m: float, *, left: bool) -> SignalPart:
    """A light's pole stands on the right sidewalk, that of a pocket on the left one."""
    right = _kerb(leg.incoming, leg.incoming_outer) + 0.8
    if left:
        right = -_kerb(leg.outgoing, leg.outgoing_outer) - 0.8
    name = "Light_Left" if left else "Light"
    signal = _post(leg, numbers, name, LIGHT, borders, back_m, right)
    signal.dynamic = True
    return signal


def _phases(legs: Sequence[Leg], split: bool) -> list[list[int]]:
    rest = [i for i, leg in enumerate(legs) if leg.incoming]
    phases: list[list[int]] = []
    while rest:
        first = rest.pop(0)
        facing = [j for j in rest if abs(turn_angle(legs[first], legs[j])) < math.radians(40)]
        together = [first] if split or not facing else [first, facing[0]]
        rest = [i for i in rest if i not in together]
        phases.append(together)
    return phases


def speed_signs(road: RoadPart, numbers: Numbers, inset_m: float) -> None:
    """Speed signs where traffic enters a road, one per direction that has lanes."""
    for direction in (1, -1):
        section = road.sections[0] if direction > 0 else road.sections[-1]
        side = section.right if direction > 0 else section.left
        ids = [-(i + 1) * direction for i, lane in enumerate(side) if lane.kind == "driving"]
        if not ids:
            continue
        s = inset_m if direction > 0 else road.length - inset_m
        at = next(sec for sec in reversed(road.sections) if s >= sec.s)
        lanes = at.right if direction > 0 else at.left
        walk = next((i for i, lane in enumerate(lanes) if lane.kind == "sidewalk"), len(lanes))
        border = at.inner_border(-direction * (walk + 1), s - at.s)
        drive = sorted(-direction * (i + 1) for i, lane in enumerate(lanes) if lane.kind == "driving")
        part = SignalPart(
            numbers.next(SIGNAL),
            f"Speed_{road.speed_kmh:.0f}",
            s,
            border - direction * 0.6,
            direction,
            SPEED,
            (drive[0], drive[-1]),
            value=road.speed_kmh,
            z_m=2.0,
        )
        road.signals.append(part)
