"""A town as nodes and roads between them; building it makes legs, junctions, lights and paint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from . import furniture
from .curves import Path, Pose, fillet, turning_bulb
from .idents import JUNCTION, OBJECT, ROAD, Numbers
from .junctions import Movement, build_junction, connect, setbacks
from .newton import PlanError
from .parts import BridgePart, ControllerPart, JunctionPart, Leg, Link, RoadPart, TunnelPart, leg_of
from .profiles import Climb, Dip, Record, climb, dip, hermite, level, smooth
from .roundabouts import RoundaboutShape, build_roundabout
from .sections import CrossSection, road_sections
from .writer import opendrive_text

WALKERS_SETBACK_M = 1.5
"""Half the length of the junction that stands for a crosswalk with lights between junctions [m]."""


@dataclass(slots=True, kw_only=True)
class Node:
    """Where roads meet."""

    name: str
    x: float
    y: float
    z: float = 0.0
    control: str = "signals"
    """`signals`, `split` (lights, one leg at a time), `walkers` (lights for one crosswalk between two legs),
    `stop`, `yield`, `all_stop`, `none`, `bulb`."""
    corner_m: float = 9.0
    """Kerb radius of the corners, about [m]."""
    crosswalks: bool | str = True
    """On all legs, on none, or `minor`: only on those that give way."""
    minor: tuple[str, ...] = ()
    """Roads that give way at a `stop` or `yield` node; empty: the legs with no leg straight ahead."""
    roundabout: RoundaboutShape | None = None
    bulb_m: float = 12.0
    """Kerb radius of a cul-de-sac's bulb [m]."""
    grade: tuple[float, float] = (0.0, 0.0)
    """Slope of the land towards east and north, which roads without a `climb` follow through the node."""

    def ground(self, pose: Pose) -> tuple[float, float]:
        """Height of the node's plane at a point [m], and its grade along the heading there."""
        east, north = self.grade
        z = self.z + east * (pose.x - self.x) + north * (pose.y - self.y)
        return round(z, 9), round(east * math.cos(pose.h) + north * math.sin(pose.h), 11)


@dataclass(slots=True, kw_only=True)
class Road:
    """A two-way road between two nodes."""

    name: str
    a: str
    b: str
    cross: CrossSection
    speed_kmh: float
    bends: tuple[tuple[float, float, float, float], ...] = ()
    """x, y, radius, clothoid length [m] of every bend."""
    ends: tuple[str, str] = ("plain", "plain")
    """Layouts at a and b: `plain`, `pocket`, `median` (sections.road_sections)."""
    taper_m: float = 20.0
    stores_m: tuple[float, float] = (30.0, 30.0)
    climb: Climb | Dip | None = None
    shifts: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))
    """How far the axis passes beside the nodes a and b [m, east and north], for staggered legs."""
    tunnel: tuple[str, float] | None = None
    """Name and length [m] of the cover over the lowest point of a `Dip`."""
    bridges: tuple[tuple[str, float, float, float], ...] = ()
    """Name, x, y of the middle and length [m] of every bridge; it lies on the road's first straight."""
    speed_signs: bool = True
    """Whether a sign tells the limit where traffic enters."""


@dataclass(slots=True, kw_only=True)
class TownPlan:
    """Collects nodes and roads; `build` returns OpenDRIVE text."""

    name: str
    projection: str
    nodes: dict[str, Node] = field(default_factory=dict)
    roads: list[Road] = field(default_factory=list)

    def node(self, name: str, x: float, y: float, z: float = 0.0, **options: object) -> None:
        """Add a node; the options are those of `Node`."""
        self.nodes[name] = Node(name=name, x=x, y=y, z=z, **options)  # type: ignore[arg-type]

    def road(
        self, name: str, a: str, b: str, cross: CrossSection, speed_kmh: float, **options: object
    ) -> None:
        """Add a road; the options are those of `Road`."""
        self.roads.append(Road(name=name, a=a, b=b, cross=cross, speed_kmh=speed_kmh, **options))  # type: ignore[arg-type]

    def build(self) -> str:
        """OpenDRIVE text of the town.

        Raises:
            PlanError: the geometry does not fit.
        """
        return _Builder(self).build()


@dataclass(slots=True)
class _Builder:
    plan: TownPlan
    numbers: Numbers = field(default_factory=Numbers)
    roads: list[RoadPart] = field(default_factory=list)
    junctions: list[JunctionPart] = field(default_factory=list)
    controllers: list[ControllerPart] = field(default_factory=list)

    def build(self) -> str:
        paths = [self._axis(road) for road in self.plan.roads]
        trims = self._trims(paths)
        parts = [self._road(*item) for item in zip(self.plan.roads, paths, trims, strict=True)]
        self.roads = list(parts)
        for node in self.plan.nodes.values():
            self._node(node, self._legs(node, parts))
        for road, part in zip(self.plan.roads, parts, strict=True):
            if road.speed_signs:
                furniture.speed_signs(part, self.numbers, 12.0)
        plan = self.plan
        return opendrive_text(plan.name, plan.projection, self.roads, self.junctions, self.controllers)

    def _axis(self, road: Road) -> Path:
        for name in (road.a, road.b):
            if name not in self.plan.nodes:
                raise PlanError(f"road '{road.name}' ends at node '{name}', which the plan does not have")
        a, b = self.plan.nodes[road.a], self.plan.nodes[road.b]
        first, last = road.shifts
        inner = ((x, y) for x, y, _, _ in road.bends)
        points = [(a.x + first[0], a.y + first[1]), *inner, (b.x + last[0], b.y + last[1])]
        return fillet(points, [(radius, spiral) for _, _, radius, spiral in road.bends])

    def _trims(self, paths: Sequence[Path]) -> list[list[float]]:
        trims = [[0.0, 0.0] for _ in paths]
        for node in self.plan.nodes.values():
            met = [
                (i, side)
                for i, road in enumerate(self.plan.roads)
                for side, name in enumerate((road.a, road.b))
                if name == node.name
            ]
            if not met:
                raise PlanError(f"no road ends at node '{node.name}'")
            headings = [paths[i].start.h if side == 0 else paths[i].end.h + math.pi for i, side in met]
            kerbs = [self.plan.roads[i].cross.kerb_at(self.plan.roads[i].ends[side]) for i, side in met]
            if node.roundabout is not None:
                lengths = [node.roundabout.arm_m] * len(met)
            elif node.control == "bulb":
                lengths = [0.0]
            else:
                least = WALKERS_SETBACK_M if node.control == "walkers" else 6.0
                lengths = setbacks(headings, kerbs, node.corner_m, least)
            for (i, side), length in zip(met, lengths, strict=True):
                trims[i][side] = length
        return trims

    def _road(self, road: Road, axis: Path, trim: Sequence[float]) -> RoadPart:
        path = axis.trimmed(trim[0], trim[1]).settled()
        sections = road_sections(road.cross, path.length, road.ends, road.taper_m, road.stores_m)
        elevation, bottom = _elevation(road, path, self.plan.nodes[road.a], self.plan.nodes[road.b])
        number = self.numbers.next(ROAD)
        part = RoadPart(number, road.name, path, elevation, sections, road.speed_kmh)
        if road.tunnel is not None:
            name, length = road.tunnel
            part.tunnels.append(TunnelPart(self.numbers.next(OBJECT), name, bottom - length / 2, length))
        for name, x, y, length in road.bridges:
            middle = _along(path, x, y)
            part.bridges.append(BridgePart(self.numbers.next(OBJECT), name, middle - length / 2, length))
        return part

    def _legs(self, node: Node, parts: Sequence[RoadPart]) -> list[Leg]:
        legs = []
        for road, part in zip(self.plan.roads, parts, strict=True):
            for end, name in (("start", road.a), ("end", road.b)):
                if name == node.name:
                    legs.append(leg_of(part, end))
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
        roads, found = build_junction(part, legs, self.numbers, node.z)
        self.roads += roads
        self._furnish(node, part, legs, found)

    def _roundabout(self, node: Node, shape: RoundaboutShape, legs: Sequence[Leg]) -> None:
        centre = (node.x, node.y)
        speed = min(30.0, *(leg.road.speed_kmh for leg in legs))
        roads, parts, met = build_roundabout(node.name, centre, node.z, shape, legs, speed, self.numbers)
        self.roads += roads
        self.junctions += parts
        _join(legs, [met[leg.road.id] for leg in legs])
        for leg in legs:
            marks = furniture.mark_leg(leg, self.numbers, crosswalk=bool(node.crosswalks), stop_line=True)
            furniture.sign_leg(leg, self.numbers, marks, furniture.YIELD)

    def _bulb(self, node: Node, part: JunctionPart, leg: Leg) -> RoadPart:
        inner = leg.incoming[0]
        width = sum(b.width_m for b in (inner, *leg.incoming_outer) if b.lane.kind != "sidewalk")
        path = turning_bulb(leg.pose.ahead(0.0, -inner.right_m), node.bulb_m - width, 16.0, 4.0)
        road = connect(part, leg, leg, [(0, 0)], self.numbers, node.z, outer=True, path=path)
        road.name = f"{node.name} bulb"
        return road

    def _furnish(
        self, node: Node, part: JunctionPart, legs: Sequence[Leg], found: Sequence[Movement]
    ) -> None:
        lights = node.control in ("signals", "split", "walkers")
        minor = _minor(node, legs, found)
        marks = []
        for i, leg in enumerate(legs):
            stops = lights or i in minor
            crosswalk = i in minor if node.crosswalks == "minor" else bool(node.crosswalks)
            crosswalk = crosswalk and not (node.control == "walkers" and i > 0)
            marks.append(furniture.mark_leg(leg, self.numbers, crosswalk=crosswalk, stop_line=stops))
        if lights:
            split = node.control == "split"
            self.controllers += furniture.light_junction(part, legs, marks, self.numbers, split=split)
        for i in minor if not lights else ():
            code = furniture.YIELD if node.control == "yield" else furniture.STOP
            furniture.sign_leg(legs[i], self.numbers, marks[i], code)
        furniture.paint_arrows(legs, found, self.numbers, 8.0)


def _join(legs: Sequence[Leg], junctions: Sequence[int]) -> None:
    for leg, junction in zip(legs, junctions, strict=True):
        link = Link("junction", junction)
        if leg.end == "end":
            leg.road.successor = link
        else:
            leg.road.predecessor = link


def _minor(node: Node, legs: Sequence[Leg], found: Sequence[Movement]) -> list[int]:
    """Legs that give way."""
    if node.control == "all_stop":
        return list(range(len(legs)))
    if node.control not in ("stop", "yield"):
        return []
    if node.minor:
        names = [leg.road.name for leg in legs]
        for name in node.minor:
            if name not in names:
                raise PlanError(f"node '{node.name}' has no road '{name}': its roads are {', '.join(names)}")
        return [i for i, leg in enumerate(legs) if leg.road.name in node.minor]
    ahead = {m.source for m in found if m.turn == "straight"}
    return [i for i in range(len(legs)) if i not in ahead]


def _along(path: Path, x: float, y: float) -> float:
    """Station of a point beside the first straight of a road."""
    dx, dy = x - path.start.x, y - path.start.y
    return dx * math.cos(path.start.h) + dy * math.sin(path.start.h)


def _elevation(road: Road, path: Path, a: Node, b: Node) -> tuple[list[Record], float]:
    """Elevation records, and the station of the lowest point of a dip."""
    z0, z1, length = a.z, b.z, path.length
    if isinstance(road.climb, Dip):
        bottom = _along(path, road.climb.x, road.climb.y)
        return dip(z0, z1, length, road.climb, bottom), bottom
    if isinstance(road.climb, Climb):
        return climb(z0, z1, length, road.climb), 0.0
    if any(a.grade) or any(b.grade):
        return hermite(*a.ground(path.start), *b.ground(path.end), length), 0.0
    return (level(z0) if z0 == z1 else smooth(z0, z1, length)), 0.0
