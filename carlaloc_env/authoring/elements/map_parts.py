"""The parts of a finished map, ready to be written."""

import math
from dataclasses import dataclass, field

from carlaloc_env.authoring.elements.cross_sections import LanePlan, SectionPlan
from carlaloc_env.authoring.geometry.elevation import Record, height_at
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Pose

_OUTER = ("shoulder", "sidewalk", "biking", "parking")


@dataclass(slots=True)
class Link:
    """The neighbour that a road is joined to at one end."""

    kind: str
    """`road` or `junction`."""
    id: int
    contact: str | None = None


@dataclass(slots=True)
class SignalPart:
    """A traffic light or a sign on a road."""

    id: int
    name: str
    s: float
    t: float
    direction: int
    """+1 for traffic along s, −1 against."""
    code: str
    lanes: tuple[int, int]
    dynamic: bool = False
    value: float | None = None
    z_m: float = 0.0
    height_m: float = 0.8
    width_m: float = 0.8


@dataclass(slots=True)
class ObjectPart:
    """A painted area or another thing on a road, with its outline in its own frame."""

    id: int
    kind: str
    name: str
    s: float
    t: float
    hdg: float
    length_m: float
    width_m: float
    outline: list[tuple[float, float]]


@dataclass(slots=True)
class StretchPart:
    """A stretch of road under a cover, or on a bridge."""

    id: int
    name: str
    s: float
    length_m: float


@dataclass(slots=True)
class RoadPart:
    """One road or connecting road."""

    id: int
    name: str
    path: Path
    elevation: list[Record]
    sections: list[SectionPlan]
    speed_kmh: float
    tilt: list[Record] = field(default_factory=list)
    """Superelevation [rad]; empty: level across."""
    street: str = ""
    """Name of the plan's road that this is a part of."""
    kind: str = "town"
    """Road type of OpenDRIVE."""
    junction: int = -1
    predecessor: Link | None = None
    successor: Link | None = None
    signals: list[SignalPart] = field(default_factory=list)
    objects: list[ObjectPart] = field(default_factory=list)
    tunnels: list[StretchPart] = field(default_factory=list)
    bridges: list[StretchPart] = field(default_factory=list)

    @property
    def length(self) -> float:
        """Length [m]."""
        return self.path.length


@dataclass(slots=True)
class ConnectionPart:
    """One movement through a junction."""

    incoming: int
    connecting: int
    lanes: list[tuple[int, int]]


@dataclass(slots=True)
class JunctionPart:
    """A junction: its movements and the order of its signal groups."""

    id: int
    name: str
    connections: list[ConnectionPart] = field(default_factory=list)
    controllers: list[tuple[int, int]] = field(default_factory=list)
    """(controller id, sequence)."""


@dataclass(slots=True)
class ControllerPart:
    """One signal group."""

    id: int
    name: str
    sequence: int
    signals: list[int]


@dataclass(frozen=True, slots=True)
class Border:
    """A lane at the end of a leg, seen in its travel direction."""

    lane_id: int
    lane: LanePlan
    right_m: float
    """From the road's axis to the lane's left border, positive to the right of travel [m]."""
    width_m: float


@dataclass(slots=True)
class Leg:
    """One road's end at a junction."""

    road: RoadPart
    end: str
    """`start` or `end` of the road."""
    pose: Pose
    """Pose of the axis at the end of the leg, heading into the junction."""
    incoming: list[Border]
    outgoing: list[Border]
    out_axis: Pose
    incoming_outer: list[Border]
    outgoing_outer: list[Border]
    incoming_inner: list[Border]
    """Lanes on the left of the incoming driving lanes, from there outwards: a median, or one side of a
    one-way road."""
    outgoing_inner: list[Border]

    @property
    def pocket(self) -> bool:
        """Whether the leftmost incoming lane is a left-turn pocket."""
        return bool(self.incoming) and self.incoming[0].lane.key.endswith(":pocket")

    @property
    def sign(self) -> int:
        """+1 where incoming traffic runs along s."""
        return 1 if self.end == "end" else -1

    def height(self) -> tuple[float, float]:
        """Height of the leg's end [m], and its grade in the direction of incoming traffic."""
        z, grade = height_at(self.road.elevation, self.s(0.0))
        return round(z, 9), round(self.sign * grade, 11)

    def tilt(self) -> float:
        """Superelevation at the leg's end [rad], the left side of incoming traffic up positive."""
        if not self.road.tilt:
            return 0.0
        return round(self.sign * height_at(self.road.tilt, self.s(0.0))[0], 11)

    def border(self, pose: Pose, right_m: float) -> Pose:
        """Point beside the axis by a distance across the road, which a tilted road shortens in the plan."""
        return pose.ahead(0.0, -right_m * math.cos(self.tilt()))

    def s(self, back_m: float) -> float:
        """Station of the point `back_m` before the end of the leg."""
        return self.road.length - back_m if self.end == "end" else back_m


def leg_of(road: RoadPart, end: str) -> Leg:
    """Cut a road's end into the lanes that enter and leave a junction."""
    section = road.sections[-1] if end == "end" else road.sections[0]
    ds = section.length if end == "end" else 0.0
    pose = road.path.end if end == "end" else road.path.start
    inward = pose if end == "end" else Pose(pose.x, pose.y, pose.h + math.pi)
    outward = Pose(pose.x, pose.y, inward.h + math.pi)
    driving: dict[bool, list[Border]] = {True: [], False: []}
    inner: dict[bool, list[Border]] = {True: [], False: []}
    outer: dict[bool, list[Border]] = {True: [], False: []}
    for lane_id, lane in sorted(section.lanes(), key=lambda item: abs(item[0])):
        width = lane.width_at(ds)
        if width < 1e-6:
            continue
        enters = (lane_id < 0) == (end == "end")
        t = section.inner_border(lane_id, ds)
        right = -t if lane_id < 0 else t
        border = Border(lane_id, lane, right, width)
        if lane.kind == "driving":
            driving[enters].append(border)
        elif not driving[enters] and section_has(section, lane_id, "driving"):
            inner[enters].insert(0, border)
        elif lane.kind in _OUTER:
            outer[enters].append(border)
    for enters in (True, False):
        if not driving[not enters]:
            inner[enters] += outer[not enters]
    return Leg(
        road, end, inward, driving[True], driving[False], outward,
        outer[True], outer[False], inner[True], inner[False],
    )  # fmt: skip


def section_has(section: SectionPlan, lane_id: int, kind: str) -> bool:
    """Whether the side of a lane has lanes of a kind."""
    side = section.left if lane_id > 0 else section.right
    return any(lane.kind == kind for lane in side)
