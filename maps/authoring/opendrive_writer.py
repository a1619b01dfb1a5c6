"""OpenDRIVE 1.7 text of a finished map, with the same bytes on every run."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from xml.sax.saxutils import escape, quoteattr

from maps.authoring.elements.cross_sections import Cubic, LanePlan, Mark, SectionPlan
from maps.authoring.elements.map_parts import (
    ControllerPart,
    JunctionPart,
    Link,
    ObjectPart,
    RoadPart,
    SignalPart,
)
from maps.authoring.geometry.plan_view_curves import Piece, Pose

DATE = "2025-01-01T00:00:00"
_DIGITS = {"length": 10, "curvature": 14, "angle": 12}

_SURFACES = {"concrete": (0.8, 0.012), "gravel": (0.55, 0.05), "dirt": (0.5, 0.06)}
"""Friction and roughness of lane materials other than asphalt, typical values."""


def number(value: float, digits: int = 10) -> str:
    """Shortest text of a number rounded so far that all platforms agree on it."""
    rounded = round(value, digits)
    return repr(rounded + 0.0)


@dataclass(slots=True)
class XmlText:
    """Lines of XML with indentation."""

    lines: list[str] = field(default_factory=lambda: ['<?xml version="1.0" encoding="UTF-8"?>'])
    depth: int = 0

    def open(self, tag: str, **attributes: object) -> None:
        """Start an element."""
        self._line(tag, attributes, ">")
        self.depth += 1

    def close(self, tag: str) -> None:
        """End an element."""
        self.depth -= 1
        self.lines.append("  " * self.depth + f"</{tag}>")

    def leaf(self, tag: str, **attributes: object) -> None:
        """An element without children."""
        self._line(tag, attributes, "/>")

    def _line(self, tag: str, attributes: dict[str, object], end: str) -> None:
        words = [tag]
        for name, value in attributes.items():
            text = number(value) if isinstance(value, float) else str(value)
            words.append(f"{name.rstrip('_')}={quoteattr(text)}")
        self.lines.append("  " * self.depth + "<" + " ".join(words) + end)


def opendrive_text(
    name: str,
    projection: str,
    roads: Iterable[RoadPart],
    junctions: Iterable[JunctionPart],
    controllers: Iterable[ControllerPart],
) -> str:
    """Whole file as text."""
    roads = list(roads)
    xml = XmlText()
    xml.open("OpenDRIVE")
    box = _box(roads)
    xml.open(
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
    xml.lines.append(f"    <geoReference><![CDATA[{escape(projection)}]]></geoReference>")
    xml.close("header")
    for road in roads:
        _road(xml, road)
    for controller in controllers:
        xml.open("controller", id=controller.id, name=controller.name, sequence=controller.sequence)
        for signal in controller.signals:
            xml.leaf("control", signalId=signal, type=0)
        xml.close("controller")
    for junction in junctions:
        _junction(xml, junction)
    xml.close("OpenDRIVE")
    return "\n".join(xml.lines) + "\n"


def _box(roads: Iterable[RoadPart]) -> tuple[float, float, float, float]:
    points = [road.path.at(road.length * k / 8) for road in roads for k in range(9)]
    xs, ys = [p.x for p in points], [p.y for p in points]
    return round(min(xs), 2), round(min(ys), 2), round(max(xs), 2), round(max(ys), 2)


def _road(xml: XmlText, road: RoadPart) -> None:
    lengths = [round(piece.length, 10) for piece in road.path.pieces]
    total = math.fsum(lengths)
    xml.open("road", name=road.name, length=total, id=road.id, junction=road.junction, rule="RHT")
    xml.open("link")
    _link(xml, "predecessor", road.predecessor)
    _link(xml, "successor", road.successor)
    xml.close("link")
    xml.open("type", s=0.0, type=road.kind)
    xml.leaf("speed", max=f"{road.speed_kmh:.0f}", unit="km/h")
    xml.close("type")
    xml.open("planView")
    s = 0.0
    for pose, piece, length in zip(road.path.starts(), road.path.pieces, lengths, strict=False):
        _geometry(xml, s, pose, piece, length)
        s += length
    xml.close("planView")
    xml.open("elevationProfile")
    for at, *abcd in road.elevation:
        xml.leaf("elevation", s=at, **_cubic(abcd))
    xml.close("elevationProfile")
    if road.tilt:
        xml.open("lateralProfile")
        for at, *abcd in road.tilt:
            xml.leaf("superelevation", s=at, **_cubic(abcd))
        xml.close("lateralProfile")
    _lanes(xml, road.sections)
    if road.objects or road.tunnels or road.bridges:
        xml.open("objects")
        for part in road.objects:
            _object(xml, part)
        for tunnel in road.tunnels:
            words = {"id": tunnel.id, "name": tunnel.name, "type": "underpass"}
            xml.leaf("tunnel", s=tunnel.s, length=tunnel.length_m, **words, lighting=0.5, daylight=0.5)
        for bridge in road.bridges:
            words = {"id": bridge.id, "name": bridge.name, "type": "concrete"}
            xml.leaf("bridge", s=bridge.s, length=bridge.length_m, **words)
        xml.close("objects")
    if road.signals:
        xml.open("signals")
        for signal in road.signals:
            _signal(xml, signal)
        xml.close("signals")
    xml.close("road")


def _link(xml: XmlText, tag: str, link: Link | None) -> None:
    if link is None:
        return
    contact = {} if link.contact is None else {"contactPoint": link.contact}
    xml.leaf(tag, elementType=link.kind, elementId=link.id, **contact)


def _geometry(xml: XmlText, s: float, pose: Pose, piece: Piece, length: float) -> None:
    hdg = number(pose.h, _DIGITS["angle"])
    xml.open("geometry", s=s, x=pose.x, y=pose.y, hdg=hdg, length=length)
    if piece.kind == "line":
        xml.leaf("line")
    elif piece.kind == "arc":
        xml.leaf("arc", curvature=number(piece.k0, _DIGITS["curvature"]))
    elif piece.kind == "spiral":
        ends = [number(k, _DIGITS["curvature"]) for k in (piece.k0, piece.k1)]
        xml.leaf("spiral", curvStart=ends[0], curvEnd=ends[1])
    else:
        assert piece.cubic is not None
        bu, cu, du, bv, cv, dv = piece.cubic
        u, v = {"aU": 0.0, "bU": bu, "cU": cu, "dU": du}, {"aV": 0.0, "bV": bv, "cV": cv, "dV": dv}
        xml.leaf("paramPoly3", **u, **v, pRange="normalized")
    xml.close("geometry")


def _cubic(values: Iterable[float]) -> dict[str, str]:
    return {name: number(v, 16) for name, v in zip("abcd", values, strict=True)}


def _lanes(xml: XmlText, sections: list[SectionPlan]) -> None:
    xml.open("lanes")
    written: tuple[float, Cubic] | None = None
    for section in sections:
        for ds, record in section.offset:
            s = section.s + ds
            if written is None or not _goes_on(written, s, record):
                xml.leaf("laneOffset", s=s, **_cubic(record))
                written = (s, record)
    for section in sections:
        xml.open("laneSection", s=section.s)
        if section.left:
            xml.open("left")
            for k in range(len(section.left), 0, -1):
                _lane(xml, k, section.left[k - 1])
            xml.close("left")
        xml.open("center")
        xml.open("lane", id=0, type="none", level="false")
        _mark(xml, section.centre)
        xml.close("lane")
        xml.close("center")
        if section.right:
            xml.open("right")
            for k, lane in enumerate(section.right):
                _lane(xml, -k - 1, lane)
            xml.close("right")
        xml.close("laneSection")
    xml.close("lanes")


def _goes_on(written: tuple[float, Cubic], s: float, record: Cubic) -> bool:
    """Whether a record says no more than the one before it does at its place."""
    u, (a, b, c, d) = s - written[0], written[1]
    same = (a + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * d * u), c + 3 * d * u, d)
    return all(abs(x - y) < 1e-12 for x, y in zip(same, record, strict=True))


def _lane(xml: XmlText, lane_id: int, lane: LanePlan) -> None:
    xml.open("lane", id=lane_id, type=lane.kind, level="false")
    if lane.predecessor is not None or lane.successor is not None:
        xml.open("link")
        for tag, value in (("predecessor", lane.predecessor), ("successor", lane.successor)):
            if value is not None:
                xml.leaf(tag, id=value)
        xml.close("link")
    for ds, record in lane.width:
        xml.leaf("width", sOffset=ds, **_cubic(record))
    for mark in lane.marks:
        _mark(xml, mark)
    if lane.surface != "asphalt":
        friction, roughness = _SURFACES[lane.surface]
        xml.leaf("material", sOffset=0.0, surface=lane.surface, friction=friction, roughness=roughness)
    if lane.height_m:
        xml.leaf("height", sOffset=0.0, inner=lane.height_m, outer=lane.height_m)
    xml.close("lane")


def _mark(xml: XmlText, mark: Mark) -> None:
    head: dict[str, object] = {"sOffset": mark.s, "type": mark.kind, "weight": "standard"}
    head |= {"color": mark.color, "width": mark.width, "laneChange": mark.change}
    if mark.dash is None:
        xml.leaf("roadMark", **head)
        return
    xml.open("roadMark", **head)
    xml.open("type", name=mark.kind, width=mark.width)
    xml.leaf("line", length=mark.dash[0], space=mark.dash[1], tOffset=0.0, sOffset=0.0, width=mark.width)
    xml.close("type")
    xml.close("roadMark")


def _object(xml: XmlText, part: ObjectPart) -> None:
    xml.open(
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
    xml.open("outline")
    for u, v in part.outline:
        xml.leaf("cornerLocal", u=u, v=v, z=0.0, height=0.0)
    xml.close("outline")
    xml.close("object")


def _signal(xml: XmlText, part: SignalPart) -> None:
    along = part.direction > 0
    unit = {} if part.value is None else {"value": part.value, "unit": "km/h"}
    xml.open(
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
    xml.leaf("validity", fromLane=part.lanes[0], toLane=part.lanes[1])
    xml.close("signal")


def _junction(xml: XmlText, part: JunctionPart) -> None:
    xml.open("junction", id=part.id, name=part.name)
    for k, connection in enumerate(part.connections):
        ends = {"incomingRoad": connection.incoming, "connectingRoad": connection.connecting}
        xml.open("connection", id=k, **ends, contactPoint="start")
        for source, target in connection.lanes:
            xml.leaf("laneLink", from_=source, to=target)
        xml.close("connection")
    for controller, sequence in part.controllers:
        xml.leaf("controller", id=controller, type=0, sequence=sequence)
    xml.close("junction")
