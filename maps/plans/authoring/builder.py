"""Building a plan: legs, junctions, lights and paint."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from carlaloc_env.authoring.elements import junction_furniture
from carlaloc_env.authoring.elements.ids import JUNCTION, Numbers
from carlaloc_env.authoring.elements.junctions import Movement, connect
from carlaloc_env.authoring.elements.map_parts import (
    ControllerPart,
    JunctionPart,
    Leg,
    Link,
    RoadPart,
    leg_of,
)
from carlaloc_env.authoring.geometry.newton import PlanError
from carlaloc_env.authoring.geometry.plan_view_curves import turning_bulb
from carlaloc_env.authoring.opendrive_writer import opendrive_text

from .curves import u_turn
from .junctions import build_junction
from .layout import Laid, lay_out
from .plan import Node, TownPlan
from .ramps import Gore, build_gore, gore_lines
from .road_splitting import road_parts
from .roundabouts import RoundaboutShape, build_roundabout

SIGNED_M = 60.0
"""Shorter parts between gores carry no speed signs [m]."""


@dataclass(slots=True)
class Builder:
    """Turns a plan into the parts of a map."""

    plan: TownPlan
    numbers: Numbers = field(default_factory=Numbers)
    roads: list[RoadPart] = field(default_factory=list)
    junctions: list[JunctionPart] = field(default_factory=list)
    controllers: list[ControllerPart] = field(default_factory=list)

    def build(self) -> str:
        """OpenDRIVE text of the plan.

        Raises:
            PlanError: The geometry does not fit.
        """
        laid = lay_out(self.plan)
        parts = [road_parts(road, self.numbers) for road in laid]
        self.roads = [part for own in parts for part in own]
        for node in self.plan.nodes.values():
            self._node(node, self._legs(node, parts))
        for road, own in zip(laid, parts, strict=True):
            for k, gore in enumerate(road.road.gores):
                self._gore(gore, road, (own[k], own[(k + 1) % len(own)]), laid, parts)
        for planned, own in zip(self.plan.roads, parts, strict=True):
            for part in own if planned.speed_signs else ():
                if len(own) == 1 or part.length > SIGNED_M:
                    junction_furniture.speed_signs(part, self.numbers, 12.0)
        plan = self.plan
        return opendrive_text(plan.name, plan.projection, self.roads, self.junctions, self.controllers)

    def _gore(
        self,
        gore: Gore,
        road: Laid,
        own: tuple[RoadPart, RoadPart],
        laid: Sequence[Laid],
        parts: Sequence[Sequence[RoadPart]],
    ) -> None:
        """Junction of a ramp."""
        attached = [
            (line, pieces) for line, pieces in zip(laid, parts, strict=True) if gore.name in line.ends
        ]
        if len(attached) != 1:
            raise PlanError(f"gore '{gore.name}' has {len(attached)} ramps; give it one")
        line, pieces = attached[0]
        ramp = leg_of(pieces[-1], "end") if gore.merges else leg_of(pieces[0], "start")
        part = JunctionPart(self.numbers.next(JUNCTION), gore.name)
        self.junctions.append(part)
        legs = (leg_of(own[0], "end"), leg_of(own[1], "start"))
        _join([*legs, ramp], [part.id] * 3)
        lines = gore_lines(gore, road.axis, road.road.closed, road.road.cross)
        inside = line.ends[gore.name].inside
        self.roads += build_gore(gore, part, legs, ramp, inside, lines, self.numbers)

    def _legs(self, node: Node, parts: Sequence[Sequence[RoadPart]]) -> list[Leg]:
        legs = []
        for road, own in zip(self.plan.roads, parts, strict=True):
            if node.name == road.a:
                legs.append(leg_of(own[0], "start"))
            if node.name == road.b:
                legs.append(leg_of(own[-1], "end"))
        return legs

    def _node(self, node: Node, legs: Sequence[Leg]) -> None:
        if node.roundabout is not None:
            self._roundabout(node, node.roundabout, legs)
            return
        part = JunctionPart(self.numbers.next(JUNCTION), node.name)
        self.junctions.append(part)
        _join(legs, [part.id] * len(legs))
        if node.control == "bulb":
            self.roads.append(self._bulb(node, part, legs[0]))
            return
        roads, movements = build_junction(part, legs, self.numbers, node.plane, no_left=node.no_left)
        self.roads += roads + self._u_turns(node, part, legs)
        self._furnish(node, part, legs, movements)

    def _roundabout(self, node: Node, shape: RoundaboutShape, legs: Sequence[Leg]) -> None:
        centre = (node.x, node.y)
        speed = min(30.0, *(leg.road.speed_kmh for leg in legs))
        roads, parts, met = build_roundabout(node.name, centre, node.z, shape, legs, speed, self.numbers)
        self.roads += roads
        self.junctions += parts
        _join(legs, [met[leg.road.id] for leg in legs])
        for leg in legs:
            marks = junction_furniture.mark_leg(
                leg, self.numbers, crosswalk=bool(node.crosswalks), stop_line=True
            )
            junction_furniture.sign_leg(leg, self.numbers, marks, junction_furniture.YIELD)

    def _bulb(self, node: Node, part: JunctionPart, leg: Leg) -> RoadPart:
        inner = leg.incoming[0]
        width = sum(b.width_m for b in (inner, *leg.incoming_outer) if b.lane.kind != "sidewalk")
        path = turning_bulb(leg.pose.ahead(0.0, -inner.right_m), node.bulb_m - width, 16.0, 4.0)
        road = connect(part, leg, leg, [(0, 0)], self.numbers, node.plane, outer=True, path=path)
        road.name = f"{node.name} bulb"
        return road

    def _u_turns(self, node: Node, part: JunctionPart, legs: Sequence[Leg]) -> list[RoadPart]:
        roads = []
        for name in node.u_turns:
            leg = next((leg for leg in legs if leg.road.street == name), None)
            if leg is None or not leg.pocket:
                raise PlanError(f"node '{node.name}': U-turns need a pocket at the end of road '{name}'")
            aside = leg.incoming[0].right_m + leg.outgoing[0].right_m
            path = u_turn(leg.pose.ahead(0.0, -leg.incoming[0].right_m), aside)
            roads.append(connect(part, leg, leg, [(0, 0)], self.numbers, node.plane, outer=False, path=path))
            roads[-1].name = f"{part.name} U-turn of {name}"
        return roads

    def _furnish(
        self, node: Node, part: JunctionPart, legs: Sequence[Leg], movements: Sequence[Movement]
    ) -> None:
        lights = node.control in ("signals", "split", "walkers")
        minor = _minor(node, legs, movements)
        marks = []
        for i, leg in enumerate(legs):
            stops = lights or i in minor
            crosswalk = i in minor if node.crosswalks == "minor" else bool(node.crosswalks)
            crosswalk = crosswalk and not (node.control == "walkers" and i > 0)
            marks.append(junction_furniture.mark_leg(leg, self.numbers, crosswalk=crosswalk, stop_line=stops))
        if lights:
            split = node.control == "split"
            self.controllers += junction_furniture.light_junction(
                part, legs, marks, self.numbers, split=split
            )
        for i in minor if not lights else ():
            code = junction_furniture.YIELD if node.control == "yield" else junction_furniture.STOP
            junction_furniture.sign_leg(legs[i], self.numbers, marks[i], code)
        junction_furniture.paint_arrows(legs, movements, self.numbers, 8.0)


def _join(legs: Sequence[Leg], junctions: Sequence[int]) -> None:
    for leg, junction in zip(legs, junctions, strict=True):
        link = Link("junction", junction)
        if leg.end == "end":
            leg.road.successor = link
        else:
            leg.road.predecessor = link


def _minor(node: Node, legs: Sequence[Leg], movements: Sequence[Movement]) -> list[int]:
    """Legs that give way."""
    if node.control == "all_stop":
        return [i for i, leg in enumerate(legs) if leg.incoming]
    if node.control not in ("stop", "yield"):
        return []
    if node.minor:
        names = [leg.road.street for leg in legs]
        for name in node.minor:
            if name not in names:
                raise PlanError(f"node '{node.name}' has no road '{name}': its roads are {', '.join(names)}")
        return [i for i, leg in enumerate(legs) if leg.road.street in node.minor]
    ahead = {m.source for m in movements if m.turn == "straight"}
    return [i for i, leg in enumerate(legs) if i not in ahead and leg.incoming]
