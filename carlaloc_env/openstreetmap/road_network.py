"""Streets and junctions of an extract as parts of a map: roads, connecting roads, bulbs at their ends."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
import shapely.ops

from carlaloc_env.authoring.elements.cross_sections import CrossSection, SectionPlan, constant, road_sections
from carlaloc_env.authoring.elements.ids import JUNCTION, ROAD, Numbers
from carlaloc_env.authoring.elements.junctions import Movement, connect, turn_angle
from carlaloc_env.authoring.elements.map_parts import (
    Border,
    ControllerPart,
    JunctionPart,
    Leg,
    Link,
    RoadPart,
    leg_of,
)
from carlaloc_env.authoring.geometry.elevation import Record, level
from carlaloc_env.authoring.geometry.junction_planes import Plane
from carlaloc_env.authoring.geometry.newton import PlanError
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Pose, turning_bulb
from carlaloc_env.core.array_types import Array
from carlaloc_env.openstreetmap.axes import between, curvatures, fit, sampled
from carlaloc_env.openstreetmap.clusters import SHARP_RAD, Cluster, End, reachable, route_inside
from carlaloc_env.openstreetmap.movements import find_movements
from carlaloc_env.openstreetmap.road_graph import Chain
from carlaloc_env.openstreetmap.tags import Street

LEAST_RADIUS_M, TIGHTEST_M = 6.15, 2.5
"""Least radius of the middle of any lane, and of one that is the only way on [m]."""
ROUTE_M = 3.0
"""Turns that leave the streets inside a junction farther than this follow them [m]."""
STREET_M = 4.0
"""Turning bulbs keep so far away from other streets [m]."""
GUTTER_M = 0.3
"""Width of gutters [m]."""


Turn = tuple[int, int, int, int]
"""Chain and side of the leg one comes from, and of the one into which one turns."""
Memo = tuple[dict[object, Path], dict[object, tuple[Path, float]]]
"""Lines of roads, and of turns with their least radius, that were found before."""


@dataclass(slots=True)
class Tight:
    """A turn below the least radius: left out, unless it is the only way on."""

    source: End
    target: End
    radius_m: float
    spare: bool = False
    """Whether other turns lead out of its lanes, and into the other leg."""
    sharp: bool = False
    built: bool = False

    @property
    def turn(self) -> Turn:
        """Chains and sides that it joins."""
        return self.source.chain, self.source.side, self.target.chain, self.target.side


@dataclass(slots=True)
class Junction:
    """A built junction, with what its furniture needs."""

    cluster: Cluster
    part: JunctionPart
    legs: list[Leg]
    movements: list[Movement]


@dataclass(slots=True)
class Crossing:
    """Two streets of different levels, or a street and a railway, one above the other."""

    upper: int | None
    """Chain on top; None: the railway."""
    lower: int | None
    x: float
    y: float


@dataclass(slots=True)
class Heights:
    """Heights of a town that is flat; `heights.py` has those with bridges or sloping land."""

    missed: list[tuple[Crossing, float]] = field(default_factory=list)
    """Crossings without the clearance, and what it lacks [m]."""
    off_m: dict[int, float] = field(default_factory=dict)
    """How far each chain leaves the land at most, where that is known [m]."""

    def of_road(self, chain: int, first_m: float, path: Path) -> tuple[list[Record], list[Record]]:
        """Elevation and superelevation of a chain's road, which begins at `first_m`."""
        return level(0.0), []

    def of_cluster(self, cluster: Cluster) -> Plane:
        """Plane of a junction."""
        return Plane(0.0, 0.0, 0.0)


@dataclass(slots=True)
class RoadNetwork:
    """Parts of a map, and what could not be built."""

    heights: Heights
    """Heights of its streets."""
    roads: list[RoadPart] = field(default_factory=list)
    junctions: list[Junction] = field(default_factory=list)
    parts: list[JunctionPart] = field(default_factory=list)
    controllers: list[ControllerPart] = field(default_factory=list)
    numbers: Numbers = field(default_factory=Numbers)
    of_chain: dict[int, RoadPart] = field(default_factory=dict)
    """Road of every chain that is not inside a junction."""
    tight: list[Tight] = field(default_factory=list)
    """Turns that would be too tight."""


def build_network(
    chains: Sequence[Chain],
    clusters: Sequence[Cluster],
    heights: Heights,
    banned: Mapping[tuple[int, int], frozenset[int]],
    solid: shapely.STRtree,
    memo: Memo,
    needed: Container[Turn],
    *,
    yellow: bool,
) -> RoadNetwork:
    """Roads between junctions, and the lanes through these.

    Args:
        chains: Streets.
        clusters: Their junctions.
        heights: Heights of both.
        banned: Ways into which one may not turn from a way (key: way and node); `restrictions`.
        solid: Footprints on which no turning bulb may lie.
        memo: Lines that were found before.
        needed: Turns that are built though they are tight and others lead on.
        yellow: Whether centre lines are yellow.
    """
    network = RoadNetwork(heights)
    setback = {(end.chain, end.side): end for cluster in clusters for end in cluster.ends}
    streets = shapely.STRtree([shapely.LineString(chain.line) for chain in chains])
    for cluster in clusters:
        if len(cluster.ends) == 1 and cluster.ends[0].setback_m == 0.0:
            end = cluster.ends[0]
            end.setback_m = _bulb_setback(end, chains[end.chain], solid, streets)
    for k, chain in enumerate(chains):
        if (k, 0) in setback:
            first, last = setback[k, 0], setback[k, 1]
            span = (round(first.setback_m, 3), round(chain.length_m - last.setback_m, 3))
            key = (k, span)
            if key not in memo[0]:
                memo[0][key] = _axis(chain, *span)
            part = _road(chain, k, span[0], memo[0][key], heights, network.numbers, yellow=yellow)
            network.roads.append(part)
            network.of_chain[k] = part
    for cluster in clusters:
        if cluster.ends:
            _junction(cluster, chains, network, banned, memo, needed)
    return network


def cross_section(street: Street) -> CrossSection:
    """Cross-section of a street."""
    ahead, back = street.lanes
    return CrossSection(
        lanes=ahead,
        back=0 if street.oneway else back,
        lane_m=round(street.lane_m, 3),
        bike_m=street.bike_m,
        gutter_m=GUTTER_M,
        sidewalk_m=round(street.walks[1], 2),
        left_sidewalk_m=round(street.walks[0], 2),
        marks="none" if street.rank <= 1 else "full",
        surface=street.surface,
    )


def _road(
    chain: Chain, number: int, first_m: float, path: Path, heights: Heights, numbers: Numbers, *, yellow: bool
) -> RoadPart:
    street = chain.street
    sections = road_sections(cross_section(street), path.length, ("plain", "plain"), 20.0, (30.0, 30.0))
    shift = (0.5 * (street.lanes[0] - street.lanes[1])) * street.lane_m
    for section in sections:
        section.offset = constant(round(shift, 6))
        if not yellow:
            _whiten(section)
    part = RoadPart(numbers.next(ROAD), street.name, path, level(0.0), sections, street.speed_kmh)
    part.street, part.kind = str(number), street.kind
    part.elevation, part.tilt = heights.of_road(number, first_m, path)
    return part


def _axis(chain: Chain, first_m: float, last_m: float) -> Path:
    """Reference line of a chain's road, in the middle of its carriageway."""
    street = chain.street
    outer = 0.5 * (sum(street.lanes) - 1) * street.lane_m
    whole = shapely.LineString(chain.line)
    line = shapely.get_coordinates(shapely.ops.substring(whole, first_m, max(last_m, first_m + 1.0)))
    for more in (1.0, 1.1, 1.25, 1.5, 2.0, 3.0):
        path = fit(line, more * (LEAST_RADIUS_M + 0.2 + outer)).settled()
        if max(curvatures(path)) <= 1.0 / (LEAST_RADIUS_M + outer):
            break
    return path


def _whiten(section: SectionPlan) -> None:
    section.centre = replace(section.centre, color="white")
    for _, lane in section.lanes():
        lane.marks = [replace(m, color="white" if m.color == "yellow" else m.color) for m in lane.marks]


def _bulb_setback(end: End, chain: Chain, solid: shapely.STRtree, streets: shapely.STRtree) -> float:
    """How far before its end a street gets its turning bulb: where it meets the fewest houses and streets."""
    best: tuple[float, float] | None = None
    for back in np.arange(0.0, max(min(0.6 * chain.length_m, chain.length_m - 12.0, 60.0), 0.1), 4.0):
        x, y, h = end.at(float(back))
        inward = Pose(x, y, h + math.pi)
        try:
            path = _bulb_path(inward, end.street)
        except PlanError:
            return float(back)
        outline = shapely.buffer(shapely.LineString(sampled(path, 2.0)).convex_hull, end.half_m)
        near = solid.geometries.take(solid.query(outline, predicate="intersects"))
        area = shapely.area(shapely.intersection(near, outline)).sum()
        wide = shapely.buffer(outline, STREET_M)
        others = [
            streets.geometries[k] for k in streets.query(wide, predicate="intersects") if k != end.chain
        ]
        area += STREET_M * shapely.length(shapely.intersection(others, wide)).sum()
        meets = round(float(area), 1)
        if best is None or meets < best[0] - 1.0:
            best = (meets, float(back))
        if meets < 1.0:
            break
    return best[1] if best else 0.0


def _bulb_path(start: Pose, street: Street) -> Path:
    lanes = max(street.lanes)
    # Where lanes are narrow, the tail of a car comes near the kerb.
    middle = LEAST_RADIUS_M + 0.3 + 2.5 * max(0.0, 3.0 - street.lane_m)
    radius = middle - 0.5 * street.lane_m
    flare = middle + (lanes - 0.5) * street.lane_m
    return turning_bulb(start, radius, max(flare, 10.0), 3.0)


def _junction(
    cluster: Cluster,
    chains: Sequence[Chain],
    network: RoadNetwork,
    banned: Mapping[tuple[int, int], frozenset[int]],
    memo: Memo,
    needed: Container[Turn],
) -> None:
    numbers = network.numbers
    legs = [leg_of(network.of_chain[e.chain], "start" if e.side == 0 else "end") for e in cluster.ends]
    name = " / ".join(sorted({end.street.name for end in cluster.ends})[:2])
    part = JunctionPart(numbers.next(JUNCTION), name)
    network.parts.append(part)
    for leg in legs:
        link = Link("junction", part.id)
        if leg.end == "end":
            leg.road.successor = link
        else:
            leg.road.predecessor = link
    plane = network.heights.of_cluster(cluster)
    allowed = _allowed(cluster, chains, banned)
    marks = [end.street.turns[1 - end.side] for end in cluster.ends]
    movements = find_movements(legs, allowed, marks)
    lines: list[tuple[Path, float]] = []
    for movement in movements:
        ends = (cluster.ends[movement.source], cluster.ends[movement.target])
        poses = (legs[movement.source].pose, legs[movement.target].pose)
        tilts = legs[movement.source].tilt(), legs[movement.target].tilt()
        key = (movement.lanes, poses, tilts, tuple((e.chain, e.side) for e in ends), *cluster.inner)
        if key not in memo[1]:
            memo[1][key] = _path(movement, legs, cluster, chains)
        lines.append(memo[1][key])
    wide = [movement for movement, line in zip(movements, lines, strict=True) if line[1] >= LEAST_RADIUS_M]
    sources, targets = {(m.source, a) for m in wide for a, _ in m.lanes}, {m.target for m in wide}
    built = []
    for movement, (line, least_m) in zip(movements, lines, strict=True):
        if least_m < LEAST_RADIUS_M:
            tight = Tight(cluster.ends[movement.source], cluster.ends[movement.target], least_m)
            network.tight.append(tight)
            lanes = {(movement.source, a) for a, _ in movement.lanes}
            tight.spare = lanes <= sources and movement.target in targets
            tight.sharp = abs(turn_angle(legs[movement.source], legs[movement.target])) > SHARP_RAD
            tight.built = least_m > TIGHTEST_M and (not tight.spare or tight.turn in needed)
            if not tight.built:
                continue
        network.roads.append(_connect(movement, part, legs, line, numbers, plane))
        built.append(movement)
    network.junctions.append(Junction(cluster, part, legs, built))


def _allowed(
    cluster: Cluster, chains: Sequence[Chain], banned: Mapping[tuple[int, int], frozenset[int]]
) -> set[tuple[int, int]]:
    index = {(end.chain, end.side): k for k, end in enumerate(cluster.ends)}
    leads, pairs = set(), set()
    for a, b in reachable(cluster, chains):
        pair = index[a.chain, a.side], index[b.chain, b.side]
        source, target = (chains[e.chain].pieces[0 if e.side == 0 else -1].way for e in (a, b))
        leads.add(pair)
        if not any(target in banned.get((source, node), ()) for node in cluster.nodes):
            pairs.add(pair)
    # Where the box cuts off the street into which one must turn, one turns into any.
    lost = [{pair[k] for pair in leads} - {pair[k] for pair in pairs} for k in (0, 1)]
    return pairs | {(a, b) for a, b in leads if a in lost[0] or b in lost[1]}


def _path(
    movement: Movement, legs: Sequence[Leg], cluster: Cluster, chains: Sequence[Chain]
) -> tuple[Path, float]:
    """Reference line of a movement, direct or along the streets inside, and its lanes' least radius [m]."""
    source, target = legs[movement.source], legs[movement.target]
    ins = [source.incoming[a] for a, _ in movement.lanes]
    outs = [target.outgoing[b] for _, b in movement.lanes]
    start = source.border(source.pose, ins[0].right_m)
    if movement.source == movement.target:
        return _bulb_path(start, cluster.ends[movement.source].street), LEAST_RADIUS_M
    end = target.border(target.out_axis, outs[0].right_m)
    direct = between(start, end)
    a, b = cluster.ends[movement.source], cluster.ends[movement.target]
    route = _shifted(_route(cluster, chains, a, b), ins[0].right_m, outs[0].right_m)
    options = [direct]
    if len(route) > 2:
        line = shapely.LineString(sampled(direct, 2.0))
        off = shapely.distance(shapely.points(route), line).max()
        ring = any(chains[k].street.ring for k in cluster.inner)
        if ring or off > ROUTE_M:
            options.insert(0, between(start, end, route[1:-1]))
    paths = [(path, lane_radius(path, ins, outs)) for path in options]
    return next((pair for pair in paths if pair[1] >= LEAST_RADIUS_M), max(paths, key=lambda pair: pair[1]))


def _route(cluster: Cluster, chains: Sequence[Chain], a: End, b: End) -> Array:
    lines = []
    for end in (a, b):
        line = shapely.LineString(end.line)
        part = shapely.ops.substring(line, 0.0, min(end.setback_m, line.length))
        lines.append(shapely.get_coordinates(part))
    return np.concatenate([lines[0][::-1], route_inside(cluster, chains, a, b)[1:], lines[1][1:]])


def _shifted(line: Array, first_m: float, last_m: float) -> Array:
    """The line moved to the right by a distance that goes from the first to the last."""
    if len(line) < 2:
        return line
    step = np.gradient(line, axis=0)
    normal = np.column_stack([step[:, 1], -step[:, 0]])
    normal /= np.maximum(np.hypot(*normal.T), 1e-9)[:, None]
    share = np.linspace(0.0, 1.0, len(line))[:, None]
    moved: Array = line + normal * (first_m + (last_m - first_m) * share)
    return moved


def lane_radius(path: Path, ins: Sequence[Border], outs: Sequence[Border]) -> float:
    """Least radius of the middles of the lanes right of a reference line [m]."""
    left, right = curvatures(path)
    widths = [max(a.width_m, b.width_m) for a, b in zip(ins, outs, strict=True)]
    radius = 1e9
    if right > 1e-9:
        radius = min(radius, 1.0 / right - sum(widths) + 0.5 * widths[-1])
    if left > 1e-9:
        radius = min(radius, 1.0 / left + 0.5 * widths[0])
    return radius


def _connect(
    movement: Movement, part: JunctionPart, legs: Sequence[Leg], path: Path, numbers: Numbers, plane: Plane
) -> RoadPart:
    source, target = legs[movement.source], legs[movement.target]
    # A street that only leads in counts, too: no sidewalk goes across its mouth.
    angles = {j: turn_angle(source, other) for j, other in enumerate(legs) if j != movement.source}
    outermost = movement.target == (min(angles, key=lambda j: angles[j]) if angles else movement.source)
    road = connect(
        part, source, target, movement.lanes, numbers, plane,
        outer=outermost, path=path, inner=len(legs) == 2 and not source.outgoing,
    )  # fmt: skip
    road.name = f"{part.name}: {movement.turn} from {source.road.name}"
    return road
