"""Where one lane leaves a road for a ramp, or a ramp joins it.

    town.road("Main Rd", "A", "B", WIDE, 80, gores=(Exit(name="X", at_m=180), Merge(name="Y", at_m=420)))
    town.road("Slip", "X", "Y", RAMP, 40, bends=(OnRay(60, 45, 25), OnRay(60, 45, 25)))

An exit is an auxiliary lane on the right and a small junction of `length_m`, in which the through lanes go on
as they were while the ramp's lane leaves along a clothoid; the hard shoulders of both fill the wedge between
them. A merge is its mirror image. Ramps are one-way roads (`CrossSection(lanes=1, back=0)`) that name the
gore as their node; they start or end with the road's height and grade. On a two-way road `side="L"` serves
the traffic against s. `at_m` counts along the road's axis from its node a to the middle of the junction.
"""

from dataclasses import dataclass
from typing import ClassVar

from carlaloc_env.authoring.elements.cross_sections import CrossSection, Mark
from carlaloc_env.authoring.elements.ids import Numbers
from carlaloc_env.authoring.elements.junctions import connect
from carlaloc_env.authoring.elements.map_parts import JunctionPart, Leg, RoadPart
from carlaloc_env.authoring.geometry.junction_planes import Plane
from carlaloc_env.authoring.geometry.newton import PlanError
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Piece, Pose, curvature

from .auxiliary_lanes import ExtraLane
from .curves import backwards, cut, shifted

NOSE_GAP_M = 0.1
"""Clear distance between the shoulders of road and ramp where they part [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gore:
    """Fields that exits and merges have in common."""

    name: str
    at_m: float
    """Middle of the junction along the road's axis [m]."""
    side: str = "R"
    """`R`: traffic along s; `L`: traffic against s."""
    length_m: float = 60.0
    """Length of the junction, over which ramp and road part [m]."""
    aux_m: float | None = 90.0
    """Auxiliary lane at its whole width [m]; None: it runs from or to the next junction."""
    taper_m: float = 60.0
    """Its taper [m]."""
    lead_m: float = 40.0
    """Clothoid on the ramp between the junction and its first straight [m]."""
    merges: ClassVar[bool] = False

    @property
    def low_m(self) -> float:
        """Where the junction begins along the axis [m]."""
        return self.at_m - 0.5 * self.length_m

    @property
    def high_m(self) -> float:
        """Where it ends [m]."""
        return self.at_m + 0.5 * self.length_m

    @property
    def ramp_m(self) -> float:
        """Where along the axis the ramp begins or ends [m]."""
        return self.low_m if (self.side == "R") == self.merges else self.high_m

    @property
    def opens_before(self) -> bool:
        """Whether the auxiliary lane lies on the part with lower stations."""
        return (self.side == "R") != self.merges


@dataclass(frozen=True, slots=True, kw_only=True)
class Exit(Gore):
    """A gore at which a ramp leaves the road."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Merge(Gore):
    """A gore at which a ramp joins the road."""

    merges: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class OnRay:
    """A bend on the straight that a gore gives: `distance_m` from where the ramp has become straight.

    Without a distance it lies where the straights of both ends of the ramp meet.
    """

    distance_m: float | None
    radius_m: float
    clothoid_m: float


@dataclass(frozen=True, slots=True)
class RampEnd:
    """Line of a ramp at its gore."""

    inside: Path
    """Left border of its lane within the junction, in travel direction."""
    lead: Piece
    """Its first or last piece outside."""

    def straight(self, merges: bool) -> Pose:
        """Where the ramp becomes straight after an exit, or begins to bend before a merge."""
        if not merges:
            return self.lead.end(self.inside.end)
        back = Piece(self.lead.length, -self.lead.k1, -self.lead.k0)
        return back.end(self.inside.start.turned()).turned()


def ramp_end(
    gore: Gore,
    axis: Path,
    closed: bool,
    cross: CrossSection,
    ramp: CrossSection,
) -> RampEnd:
    """Where and how a ramp meets a road whose axis and cross-section are given."""
    if not ramp.oneway or ramp.lanes != 1:
        raise PlanError(f"the ramp at '{gore.name}' must be a one-way road of one lane: lanes=1, back=0")
    line = through_line(gore, axis, closed, cross)
    beside = cross.count(gore.side) * cross.lane_m
    length = line.length * (1 + 0.5 * (curvature(line, 0.0) + curvature(line, line.length)) * beside)
    k0, k1 = (curvature(line, s) for s in (0.0, line.length))
    k0, k1 = k0 / (1 + k0 * beside), k1 / (1 + k1 * beside)
    start, end = (pose.ahead(0.0, -beside) for pose in (line.start, line.end))
    gap = cross.beyond_m(gore.side) + ramp.beyond_m("L") + NOSE_GAP_M
    sharper = 6 * gap / length**2
    if not gore.merges:
        inside = Path(start, (Piece(length, k0, k0 - sharper),))
        return RampEnd(inside, Piece(gore.lead_m, k0 - sharper, 0.0))
    turned = Path(end.turned(), (Piece(length, -k1, -(k1 - sharper)),))
    return RampEnd(backwards(turned), Piece(gore.lead_m, 0.0, k1 - sharper))


def through_line(gore: Gore, axis: Path, closed: bool, cross: CrossSection) -> Path:
    """Left border of the through lanes in the junction, in their travel direction."""
    return _line(gore, axis, closed, cross, gore.side)


def gore_lines(gore: Gore, axis: Path, closed: bool, cross: CrossSection) -> tuple[Path, Path | None]:
    """Left borders of the lanes along and against s within the junction."""
    against = None if cross.oneway else _line(gore, axis, closed, cross, "L")
    return _line(gore, axis, closed, cross, "R"), against


def _line(gore: Gore, axis: Path, closed: bool, cross: CrossSection, side: str) -> Path:
    piece = cut(axis, gore.low_m, gore.high_m, closed=closed)
    return shifted(piece if side == "R" else backwards(piece), cross.inner_m(side))


def auxiliary_lanes(
    before: Gore | None, after: Gore | None, cross: CrossSection, length: float
) -> list[ExtraLane]:
    """Auxiliary lanes of the part of a road between two gores; one through lane where they would overlap."""
    wanted = []
    if before is not None and not before.opens_before:
        wanted.append((before, False))
    if after is not None and after.opens_before:
        wanted.append((after, True))
    need = sum(length if gore.aux_m is None else gore.aux_m + gore.taper_m for gore, _ in wanted)
    if len(wanted) == 2 and wanted[0][0].side == wanted[1][0].side and need > length:
        return [ExtraLane(side=wanted[0][0].side, width_m=cross.lane_m, name="aux")]
    lanes = []
    for gore, at_end in wanted:
        name = f"aux {gore.name}"
        if gore.aux_m is None:
            lanes.append(ExtraLane(side=gore.side, width_m=cross.lane_m, name=name))
            continue
        reach = gore.aux_m + gore.taper_m
        if reach > length:
            raise PlanError(
                f"the auxiliary lane of '{gore.name}' needs {reach:.0f} m, its road has {length:.0f} m: "
                "move the gore or shorten aux_m and taper_m"
            )
        span = {"first_m": -reach} if at_end else {"last_m": reach}
        lanes.append(
            ExtraLane(side=gore.side, taper_m=gore.taper_m, width_m=cross.lane_m, name=name, **span)  # type: ignore[arg-type]
        )
    return lanes


def build_gore(
    gore: Gore,
    part: JunctionPart,
    legs: tuple[Leg, Leg],
    ramp: Leg,
    inside: Path,
    lines: tuple[Path, Path | None],
    numbers: Numbers,
) -> list[RoadPart]:
    """Connecting roads of a gore.

    Args:
        gore: The exit or merge.
        part: Its junction.
        legs: Legs of the road before and after, for traffic along s: one incoming, one outgoing.
        ramp: End of the ramp.
        inside: Left border of the ramp's lane within the junction.
        lines: Left borders of the lanes along and against s within the junction.
        numbers: Counter of identifiers.
    """
    roads = []
    plane = Plane(ramp.pose.x, ramp.pose.y, round(ramp.height()[0], 9))
    for side, line in zip("RL", lines, strict=True):
        if line is None:
            continue
        source, target = legs if side == "R" else legs[::-1]
        own = side == gore.side
        count = min(len(source.incoming), len(target.outgoing))
        pairs = [(i, i) for i in range(count)]
        road = connect(part, source, target, pairs, numbers, plane, outer=not own, path=line, inner=True)
        road.name, road.kind = f"{part.name} through", source.road.kind
        _paint(road, source)
        roads.append(road)
        if own:
            _wedge(road, source if gore.merges else target, gore, -1)
            ends = (ramp, target) if gore.merges else (source, ramp)
            pairs = [(0, count)] if gore.merges else [(count, 0)]
            road = connect(part, *ends, pairs, numbers, plane, outer=True, path=inside)
            road.name, road.kind = f"{part.name} ramp", ramp.road.kind
            _paint(road, ramp)
            roads.append(road)
            road.sections[0].centre = Mark(0.0, "solid")
            _wedge(road, ramp, gore, 1)
    return roads


def _wedge(road: RoadPart, whole: Leg, gore: Gore, side: int) -> None:
    """Shoulder lanes that grow from nothing to those of the leg where road and ramp have parted."""
    if side < 0:
        borders = whole.outgoing_outer if not gore.merges else whole.incoming_outer
    else:
        borders = whole.outgoing_inner if not gore.merges else whole.incoming_inner
    section = road.sections[0]
    lanes = section.right if side < 0 else section.left
    length = road.length
    for border in borders:
        # The ramp's outermost strip also covers what is left clear where both have parted.
        spare = NOSE_GAP_M if side > 0 and border is borders[-1] else 0.0
        width = border.width_m + spare
        cubic = (0.0, 0.0, 0.0, width / length**3)
        if gore.merges:
            cubic = (width, -3 * width / length, 3 * width / length**2, -width / length**3)
        lane = type(border.lane)(
            f"wedge:{border.lane.key}", border.lane.kind, ((0.0, cubic),), height_m=border.lane.height_m
        )
        if gore.merges:
            lane.predecessor = border.lane_id
        else:
            lane.successor = border.lane_id
        lane.marks = [Mark(0.0, "none", "standard", 0.0)]
        lanes.append(lane)


def _paint(road: RoadPart, leg: Leg) -> None:
    """Lane and edge lines; a kerb at the median needs none."""
    section = road.sections[0]
    driving = [lane for lane in section.right if lane.kind == "driving"]
    for lane in driving[:-1]:
        lane.marks = [Mark(0.0, "broken", change="both", dash=(3.0, 6.0))]
    driving[-1].marks = [Mark(0.0, "solid")]
    if leg.road.sections[0].right[0].kind == "driving":
        section.centre = Mark(0.0, "solid", "yellow")
