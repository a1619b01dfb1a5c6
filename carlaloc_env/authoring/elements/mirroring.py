"""Maps for left-hand traffic: built for the right in a mirrored world, then mirrored about the x axis."""

from collections.abc import Iterable
from dataclasses import replace

from carlaloc_env.authoring.elements.cross_sections import LanePlan, Records, SectionPlan
from carlaloc_env.authoring.elements.map_parts import JunctionPart, RoadPart
from carlaloc_env.authoring.geometry.elevation import Record
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Piece, Pose


def mirror(roads: Iterable[RoadPart], junctions: Iterable[JunctionPart]) -> None:
    """Mirror finished parts in place; what lay on the right lies on the left."""
    for road in roads:
        road.path = _path(road.path)
        road.tilt = [_negative(record) for record in road.tilt]
        road.sections = [_section(section) for section in road.sections]
        for signal in road.signals:
            signal.t = -signal.t
            signal.lanes = (-signal.lanes[1], -signal.lanes[0])
        for item in road.objects:
            item.t, item.hdg = -item.t, -item.hdg
            item.outline = [(u, -v) for u, v in reversed(item.outline)]
    for junction in junctions:
        for connection in junction.connections:
            connection.lanes = [(-source, -target) for source, target in connection.lanes]


def _path(path: Path) -> Path:
    pieces = []
    for piece in path.pieces:
        cubic = piece.cubic and (*piece.cubic[:3], *(-v for v in piece.cubic[3:]))
        pieces.append(Piece(piece.length, -piece.k0, -piece.k1, cubic))  # type: ignore[arg-type]
    return Path(Pose(path.start.x, -path.start.y, -path.start.h), tuple(pieces))


def _negative(record: Record) -> Record:
    s, a, b, c, d = record
    return s, -a, -b, -c, -d


def _section(section: SectionPlan) -> SectionPlan:
    offset: Records = tuple((ds, (-a, -b, -c, -d)) for ds, (a, b, c, d) in section.offset)
    left, right = ([_lane(lane) for lane in side] for side in (section.right, section.left))
    return replace(section, offset=offset, left=left, right=right)


def _lane(lane: LanePlan) -> LanePlan:
    before, after = (None if value is None else -value for value in (lane.predecessor, lane.successor))
    return replace(lane, predecessor=before, successor=after)
