"""OpenDRIVE 1.7 text of a finished map, with the same bytes on every run."""

import math
from collections.abc import Iterable

from lxml import etree

from carlaloc_env.authoring.elements.cross_sections import LanePlan, Mark, SectionPlan
from carlaloc_env.authoring.elements.map_parts import (
    ControllerPart,
    JunctionPart,
    Link,
    ObjectPart,
    RoadPart,
    SignalPart,
)
from carlaloc_env.authoring.geometry.elevation import Cubic, moved_cubic
from carlaloc_env.authoring.geometry.plan_view_curves import Piece, Pose

DATE = "2025-01-01T00:00:00"
"""Date in every header, so that a file says nothing of when it was written."""
_DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>\n'
_DIGITS = {"length": 10, "curvature": 14, "angle": 12}

_SURFACES = {"concrete": (0.8, 0.012), "gravel": (0.55, 0.05), "dirt": (0.5, 0.06)}
"""Friction and roughness of lane materials other than asphalt, typical values."""


def number(value: float, digits: int = 10) -> str:
    """Shortest text of a number rounded so far that all platforms agree on it."""
    rounded = round(value, digits)
    return repr(rounded + 0.0)


def _add(parent: etree._Element, tag: str, **attributes: object) -> etree._Element:
    """A child with attributes in the order given; floats are written by `number`."""
    child = etree.SubElement(parent, tag)
    for name, value in attributes.items():
        child.set(name.rstrip("_"), number(value) if isinstance(value, float) else str(value))
    return child


def opendrive_text(
    name: str,
    projection: str,
    roads: Iterable[RoadPart],
    junctions: Iterable[JunctionPart],
    controllers: Iterable[ControllerPart],
    *,
    rule: str = "RHT",
) -> str:
    """Whole file as text; `rule` is `LHT` where lanes of positive id run along s."""
    roads = list(roads)
    root = etree.Element("OpenDRIVE")
    box = _box(roads)
    header = _add(
        root,
        "header",
        revMajor=1,
        revMinor=7,
        name=name,
        version="1.00",
        date=DATE,
        north=box[3],
        south=box[1],
        east=box[2],
        west=box[0],
        vendor="CarlaLoc",
    )
    _add(header, "geoReference").text = etree.CDATA(projection)
    for road in roads:
        _road(root, road, rule)
    for controller in controllers:
        words = {"id": controller.id, "name": controller.name, "sequence": controller.sequence}
        element = _add(root, "controller", **words)
        for signal in controller.signals:
            _add(element, "control", signalId=signal, type=0)
    for junction in junctions:
        _junction(root, junction)
    etree.indent(root)
    text: str = etree.tostring(root, encoding="unicode")
    return f"{_DECLARATION}{text}\n"


def _box(roads: Iterable[RoadPart]) -> tuple[float, float, float, float]:
    points = [road.path.at(road.length * k / 8) for road in roads for k in range(9)]
    xs, ys = [p.x for p in points], [p.y for p in points]
    return round(min(xs), 2), round(min(ys), 2), round(max(xs), 2), round(max(ys), 2)


def _road(root: etree._Element, road: RoadPart, rule: str) -> None:
    lengths = [round(piece.length, 10) for piece in road.path.pieces]
    total = math.fsum(lengths)
    element = _add(root, "road", name=road.name, length=total, id=road.id, junction=road.junction, rule=rule)
    links = _add(element, "link")
    _link(links, "predecessor", road.predecessor)
    _link(links, "successor", road.successor)
    kind = _add(element, "type", s=0.0, type=road.kind)
    _add(kind, "speed", max=f"{road.speed_kmh:.0f}", unit="km/h")
    plan_view, s = _add(element, "planView"), 0.0
    for pose, piece, length in zip(road.path.starts(), road.path.pieces, lengths, strict=False):
        _geometry(plan_view, s, pose, piece, length)
        s += length
    profile = _add(element, "elevationProfile")
    for at, *abcd in road.elevation:
        _add(profile, "elevation", s=at, **_cubic(abcd))
    if road.tilt:
        lateral = _add(element, "lateralProfile")
        for at, *abcd in road.tilt:
            _add(lateral, "superelevation", s=at, **_cubic(abcd))
    _lanes(element, road.sections)
    if road.objects or road.tunnels or road.bridges:
        _objects(element, road)
    if road.signals:
        signals = _add(element, "signals")
        for signal in road.signals:
            _signal(signals, signal)


def _link(links: etree._Element, tag: str, link: Link | None) -> None:
    if link is None:
        return
    contact = {} if link.contact is None else {"contactPoint": link.contact}
    _add(links, tag, elementType=link.kind, elementId=link.id, **contact)


def _geometry(plan_view: etree._Element, s: float, pose: Pose, piece: Piece, length: float) -> None:
    hdg = number(pose.h, _DIGITS["angle"])
    element = _add(plan_view, "geometry", s=s, x=pose.x, y=pose.y, hdg=hdg, length=length)
    if piece.kind == "line":
        _add(element, "line")
    elif piece.kind == "arc":
        _add(element, "arc", curvature=number(piece.k0, _DIGITS["curvature"]))
    elif piece.kind == "spiral":
        ends = [number(k, _DIGITS["curvature"]) for k in (piece.k0, piece.k1)]
        _add(element, "spiral", curvStart=ends[0], curvEnd=ends[1])
    else:
        assert piece.cubic is not None
        bu, cu, du, bv, cv, dv = piece.cubic
        u, v = {"aU": 0.0, "bU": bu, "cU": cu, "dU": du}, {"aV": 0.0, "bV": bv, "cV": cv, "dV": dv}
        _add(element, "paramPoly3", **u, **v, pRange="normalized")


def _cubic(values: Iterable[float]) -> dict[str, str]:
    return {name: number(v, 16) for name, v in zip("abcd", values, strict=True)}


def _lanes(road: etree._Element, sections: list[SectionPlan]) -> None:
    lanes = _add(road, "lanes")
    written: tuple[float, Cubic] | None = None
    for section in sections:
        for ds, record in section.offset:
            s = section.s + ds
            if written is None or not _goes_on(written, s, record):
                _add(lanes, "laneOffset", s=s, **_cubic(record))
                written = (s, record)
    for section in sections:
        element = _add(lanes, "laneSection", s=section.s)
        if section.left:
            left = _add(element, "left")
            for k in range(len(section.left), 0, -1):
                _lane(left, k, section.left[k - 1])
        _mark(_add(_add(element, "center"), "lane", id=0, type="none", level="false"), section.centre)
        if section.right:
            right = _add(element, "right")
            for k, lane in enumerate(section.right):
                _lane(right, -k - 1, lane)


def _goes_on(written: tuple[float, Cubic], s: float, record: Cubic) -> bool:
    """Whether a record says no more than the one before it does at its place."""
    same = moved_cubic(written[1], s - written[0])
    return all(abs(x - y) < 1e-12 for x, y in zip(same, record, strict=True))


def _lane(side: etree._Element, lane_id: int, lane: LanePlan) -> None:
    element = _add(side, "lane", id=lane_id, type=lane.kind, level="false")
    if lane.predecessor is not None or lane.successor is not None:
        link = _add(element, "link")
        for tag, value in (("predecessor", lane.predecessor), ("successor", lane.successor)):
            if value is not None:
                _add(link, tag, id=value)
    for ds, record in lane.width:
        _add(element, "width", sOffset=ds, **_cubic(record))
    for mark in lane.marks:
        _mark(element, mark)
    if lane.surface != "asphalt":
        friction, roughness = _SURFACES[lane.surface]
        _add(element, "material", sOffset=0.0, surface=lane.surface, friction=friction, roughness=roughness)
    if lane.height_m:
        _add(element, "height", sOffset=0.0, inner=lane.height_m, outer=lane.height_m)


def _mark(lane: etree._Element, mark: Mark) -> None:
    words: dict[str, object] = {"sOffset": mark.s, "type": mark.kind, "weight": "standard"}
    words |= {"color": mark.color, "width": mark.width, "laneChange": mark.change}
    element = _add(lane, "roadMark", **words)
    if mark.dash is not None:
        length, space = mark.dash
        kind = _add(element, "type", name=mark.kind, width=mark.width)
        _add(kind, "line", length=length, space=space, tOffset=0.0, sOffset=0.0, width=mark.width)


def _objects(road: etree._Element, part: RoadPart) -> None:
    objects = _add(road, "objects")
    for item in part.objects:
        _object(objects, item)
    for tag, stretches, kind, light in (
        ("tunnel", part.tunnels, "underpass", {"lighting": 0.5, "daylight": 0.5}),
        ("bridge", part.bridges, "concrete", {}),
    ):
        for stretch in stretches:
            words = {"id": stretch.id, "name": stretch.name, "type": kind}
            _add(objects, tag, s=stretch.s, length=stretch.length_m, **words, **light)


def _object(objects: etree._Element, part: ObjectPart) -> None:
    element = _add(
        objects,
        "object",
        type=part.kind,
        id=part.id,
        name=part.name,
        s=part.s,
        t=part.t,
        zOffset=0.0,
        orientation="none",
        hdg=part.hdg,
        pitch=0.0,
        roll=0.0,
        length=part.length_m,
        width=part.width_m,
        height=0.0,
    )
    outline = _add(element, "outline")
    for u, v in part.outline:
        _add(outline, "cornerLocal", u=u, v=v, z=0.0, height=0.0)


def _signal(signals: etree._Element, part: SignalPart) -> None:
    along = part.direction > 0
    unit = {} if part.value is None else {"value": part.value, "unit": "km/h"}
    element = _add(
        signals,
        "signal",
        name=part.name,
        id=part.id,
        s=part.s,
        t=part.t,
        zOffset=part.z_m,
        # Measured from +s, as CARLA's maps have it.
        hOffset=0.0 if along else math.pi,
        pitch=0.0,
        roll=0.0,
        orientation="+" if along else "-",
        dynamic="yes" if part.dynamic else "no",
        country="OpenDRIVE",
        type=part.code,
        subtype="-1",
        height=part.height_m,
        width=part.width_m,
        **unit,
    )
    _add(element, "validity", fromLane=part.lanes[0], toLane=part.lanes[1])


def _junction(root: etree._Element, part: JunctionPart) -> None:
    element = _add(root, "junction", id=part.id, name=part.name)
    for k, connection in enumerate(part.connections):
        ends = {"incomingRoad": connection.incoming, "connectingRoad": connection.connecting}
        link = _add(element, "connection", id=k, **ends, contactPoint="start")
        for source, target in connection.lanes:
            _add(link, "laneLink", from_=source, to=target)
    for controller, sequence in part.controllers:
        _add(element, "controller", id=controller, type=0, sequence=sequence)
