"""Reads roads: plan view, profiles, lane sections, signals and objects.

Reads lane sections: lanes with widths, borders, heights, marks and speeds.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

from carlaloc_env.map.opendrive.records import (
    GEOMETRY_KINDS,
    CornerLocal,
    CornerRoad,
    Cubic,
    Geometry,
    LaneHeight,
    LaneMaterial,
    LaneRecord,
    LaneSection,
    MarkLine,
    Outline,
    Passage,
    RoadMark,
    RoadObject,
    ShapeRecord,
    SignalRecord,
    SignalReference,
    SpeedRecord,
    Validity,
)
from carlaloc_env.map.opendrive.xml_document import Document, Element

PROJECTED_LIMIT = 1.0e8
"""Coordinates beyond this are those of no projection of the Earth [m]."""
COEFFICIENT_LIMIT = 1.0e12
"""Polynomial coefficients beyond this are refused; real files reach 1e9 on pieces of 1e-7 m."""
CURVATURE_LIMIT_RADPM = 1.0e4
"""Curvatures beyond this can only come from broken files [1/m]."""
SPIRAL_TURN_LIMIT_RAD = 30.0
"""A spiral that may turn further is refused: it would cost unbounded time to integrate."""


def read_plan_view(document: Document, road: Element) -> tuple[Geometry, ...]:
    """All ``<geometry>`` of a road in ascending s, without pieces of no length."""
    elements = road.findall("planView/geometry")
    if not elements:
        document.fail(road, "has no <planView> with a <geometry>", "add its reference line")
    pieces = sorted((_geometry(document, e) for e in elements), key=lambda g: g.s_m)
    long = tuple(g for g in pieces if g.length_m > 0.0)
    if len(long) < len(pieces):
        document.note(road, f"{len(pieces) - len(long)} of its {len(pieces)} <geometry> have length 0")
    return long or tuple(pieces[:1])


def read_cubics(
    document: Document, elements: Iterable[Element], s_name: str = "s", *, start_m: float = 0.0
) -> tuple[Cubic, ...]:
    """Records a, b, c, d in ascending s, with `start_m` added to s; without repeats of one s."""

    def read(element: Element) -> Cubic:
        s = document.number(element, s_name, 0.0 if s_name == "sOffset" else None) + start_m
        return Cubic(s, *(document.number(element, k, 0.0, limit=COEFFICIENT_LIMIT) for k in "abcd"))

    return tuple(sorted(document.each(elements, read), key=lambda record: record.s_m))


def read_shapes(document: Document, road: Element) -> tuple[ShapeRecord, ...]:
    """Lateral shapes of a road, ascending in s, then t."""

    def read(element: Element) -> ShapeRecord:
        return ShapeRecord(
            document.number(element, "s"),
            document.number(element, "t"),
            *(document.number(element, k, 0.0, limit=COEFFICIENT_LIMIT) for k in "abcd"),
        )

    records = document.each(road.findall("lateralProfile/shape"), read)
    return tuple(sorted(records, key=lambda record: (record.s_m, record.t_m)))


def _geometry(document: Document, element: Element) -> Geometry:
    shape = next((child for child in element if child.tag in GEOMETRY_KINDS), None)
    if shape is None:
        document.fail(element, "holds no line, arc, spiral, poly3 or paramPoly3", "add one")
    place = Geometry(
        s_m=document.number(element, "s"),
        # Coordinates of a map projection, which the reader moves near the origin, are large.
        x_m=document.number(element, "x", limit=PROJECTED_LIMIT),
        y_m=document.number(element, "y", limit=PROJECTED_LIMIT),
        heading_rad=document.number(element, "hdg"),
        length_m=document.length(element, "length"),
        kind="line",
        line=document.line(element),
    )
    if shape.tag == "line":
        return place
    if shape.tag == "arc":
        k = document.number(shape, "curvature", limit=CURVATURE_LIMIT_RADPM)
        return replace(place, kind="arc", curvature_start_radpm=k, curvature_end_radpm=k)
    if shape.tag == "spiral":
        k0 = document.number(shape, "curvStart", limit=CURVATURE_LIMIT_RADPM)
        k1 = document.number(shape, "curvEnd", limit=CURVATURE_LIMIT_RADPM)
        if max(abs(k0), abs(k1)) * place.length_m > SPIRAL_TURN_LIMIT_RAD:
            document.fail(shape, "turns more than 30 rad", "split it or correct its curvature")
        return replace(place, kind="spiral", curvature_start_radpm=k0, curvature_end_radpm=k1)
    return _polynomial(document, shape, place)


def _polynomial(document: Document, shape: Element, place: Geometry) -> Geometry:
    def coefficients(names: tuple[str, ...]) -> tuple[float, float, float, float]:
        a, b, c, d = (document.number(shape, n, 0.0, limit=COEFFICIENT_LIMIT) for n in names)
        return a, b, c, d

    if shape.tag == "poly3":
        v = coefficients(("a", "b", "c", "d"))
        return replace(place, kind="poly3", v_poly=v, p_max=place.length_m)
    span = shape.get("pRange", "normalized")
    if span not in ("normalized", "arcLength"):
        document.fail(shape, f"has pRange='{span[:40]}'", "write normalized or arcLength")
    return replace(
        place,
        kind="paramPoly3",
        u_poly=coefficients(("aU", "bU", "cU", "dU")),
        v_poly=coefficients(("aV", "bV", "cV", "dV")),
        p_max=1.0 if span == "normalized" else place.length_m,
    )


LANES_PER_SECTION_LIMIT = 256
"""Sections with more lanes are refused."""
Record = TypeVar("Record", SpeedRecord, LaneHeight, LaneMaterial)
"""Records from a station on."""
MPS_PER_UNIT = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
"""Metres per second of each unit of speed that OpenDRIVE knows."""
FASTEST_KMH = {
    "pedestrian": 30.0,
    "bicycle": 50.0,
    "townPlayStreet": 30.0,
    "lowSpeed": 60.0,
    "townLocal": 80.0,
    "townPrivate": 80.0,
    "town": 100.0,
    "townCollector": 100.0,
    "townArterial": 110.0,
}
"""Limits in m/s above these are doubted, by type of road [km/h]; numbers of our choice."""
FASTEST_ROAD_KMH = 150.0
"""The same of all other types [km/h]."""


def read_sections(document: Document, road: Element, length_m: float) -> tuple[LaneSection, ...]:
    """All lane sections of a road in ascending s."""
    elements = road.findall("lanes/laneSection")
    if not elements:
        document.fail(road, "has no <laneSection>", "add its lanes")
    starts = sorted(((document.number(e, "s"), k) for k, e in enumerate(elements)))
    while len(starts) > 1 and starts[-1][0] >= length_m > 0.0:
        s, k = starts.pop()
        document.note(elements[k], f"s={s:g} lies beyond the road, so it is left out", "error")
    sections = []
    for n, (s, k) in enumerate(starts):
        end = starts[n + 1][0] if n + 1 < len(starts) else max(length_m, s)
        sections.append(_section(document, elements[k], s, end))
    # What begins late holds from the road's start.
    sections[0] = replace(sections[0], s_m=0.0)
    return tuple(sections)


def read_speed(document: Document, element: Element) -> float:
    """Limit [m/s] of a ``<speed>``; infinite for "no limit" and "undefined"."""
    raw = document.text(element, "max").strip()
    if raw in ("no limit", "undefined"):
        return math.inf
    unit = element.get("unit", "m/s") or "m/s"
    if unit not in MPS_PER_UNIT:
        document.fail(element, f"has unit='{unit[:40]}'", "write m/s, km/h or mph")
    value = document.number(element, "max", limit=10_000.0)
    types = [*element.iterancestors("type"), *element.xpath("ancestor::road/type")]
    road_type = types[0].get("type", "unknown") if types else "unknown"
    if unit == "m/s" and 3.6 * value > FASTEST_KMH.get(road_type, FASTEST_ROAD_KMH):
        stated = "in m/s" if element.get("unit") else "without a unit, so in m/s as the standard has it,"
        speed = f"{3.6 * value:g} km/h on a road of type {road_type[:40]}"
        document.note(element, f'max={value:g} {stated} is {speed}; add unit="km/h" if that is meant')
    # Some writers mean "no limit" by a number that no car may drive.
    return value * MPS_PER_UNIT[unit] if value > 0.0 else math.inf


def _section(document: Document, element: Element, s: float, end: float) -> LaneSection:
    found = [
        lane for side in element if side.tag in ("left", "center", "right") for lane in side.findall("lane")
    ]
    if len(found) > LANES_PER_SECTION_LIMIT:
        document.fail(element, f"has {len(found)} lanes", f"keep to {LANES_PER_SECTION_LIMIT}")
    seen: set[int] = set()

    def read(source: Element) -> LaneRecord:
        lane = _lane(document, source, s)
        if lane.id in seen:
            document.fail(source, "repeats a lane id of its section", "give it another id")
        seen.add(lane.id)
        return lane

    lanes = sorted(document.each(found, read), key=lambda lane: -lane.id)
    return LaneSection(s_m=s, end_m=end, lanes=tuple(lanes), line=document.line(element))


def _lane(document: Document, element: Element, start_m: float) -> LaneRecord:
    def at(e: Element) -> float:
        return document.number(e, "sOffset", 0.0) + start_m

    def speed(e: Element) -> SpeedRecord:
        return SpeedRecord(at(e), read_speed(document, e))

    def height(e: Element) -> LaneHeight:
        return LaneHeight(at(e), document.number(e, "inner", 0.0), document.number(e, "outer", 0.0))

    def material(e: Element) -> LaneMaterial:
        return LaneMaterial(at(e), " ".join(e.get("surface", "").lower().split()))

    marks = document.each(element.findall("roadMark"), lambda e: _mark(document, e))
    return LaneRecord(
        id=document.integer(element, "id", limit=10_000),
        type=element.get("type", "none") or "none",
        level=element.get("level") in ("true", "1"),
        predecessors=_links(document, element, "predecessor"),
        successors=_links(document, element, "successor"),
        widths=read_cubics(document, element.findall("width"), "sOffset", start_m=start_m),
        borders=read_cubics(document, element.findall("border"), "sOffset", start_m=start_m),
        road_marks=tuple(sorted(marks, key=lambda m: m.s_offset_m)),
        speeds=_by_s(document.each(element.findall("speed"), speed)),
        heights=_by_s(document.each(element.findall("height"), height)),
        materials=_by_s(document.each(element.findall("material"), material)),
        line=document.line(element),
    )


def _by_s(records: list[Record]) -> tuple[Record, ...]:
    return tuple(sorted(records, key=lambda record: record.s_m))


def _links(document: Document, element: Element, name: str) -> tuple[int, ...]:
    def read(e: Element) -> int | None:
        if not e.get("id"):
            document.note(e, "has no id, so no lane is linked there")
            return None
        return document.integer(e, "id", limit=10_000)

    found = document.each(element.findall(f"link/{name}"), read)
    return tuple(lane_id for lane_id in found if lane_id is not None)


def _mark(document: Document, element: Element) -> RoadMark:
    lines = tuple(
        MarkLine(
            length_m=document.length(e, "length", 0.0),
            space_m=document.length(e, "space", 0.0),
            t_offset_m=document.number(e, "tOffset", 0.0),
            s_offset_m=document.number(e, "sOffset", 0.0),
            width_m=document.number(e, "width") if e.get("width") else None,
        )
        for e in element.findall("type/line")
    )
    return RoadMark(
        s_offset_m=document.number(element, "sOffset", 0.0),
        type=" ".join(element.get("type", "none").split()),
        weight=element.get("weight", "standard"),
        colour=element.get("color", "standard"),
        width_m=document.number(element, "width") if element.get("width") else None,
        lane_change=element.get("laneChange", "both"),
        lines=lines,
    )


REACH_M = 1000.0
"""Objects and signals farther beside a road or beyond its ends are left out [m]."""


def read_signals(document: Document, road: Element, length_m: float) -> tuple[SignalRecord, ...]:
    """All ``<signal>`` of a road in file order."""
    return tuple(document.each(road.findall("signals/signal"), lambda e: _signal(document, e, length_m)))


def read_signal_references(document: Document, road: Element) -> tuple[SignalReference, ...]:
    """All ``<signalReference>`` of a road in file order."""

    def read(e: Element) -> SignalReference:
        return SignalReference(
            id=document.text(e, "id"),
            s_m=document.number(e, "s"),
            orientation=e.get("orientation", "none"),
            validity=_validity(document, e),
            line=document.line(e),
        )

    return tuple(document.each(road.findall("signals/signalReference"), read))


def read_objects(document: Document, road: Element, length_m: float) -> tuple[RoadObject, ...]:
    """All ``<object>`` of a road in file order."""
    return tuple(document.each(road.findall("objects/object"), lambda e: _object(document, e, length_m)))


def read_passages(document: Document, road: Element) -> tuple[Passage, ...]:
    """All ``<tunnel>`` and ``<bridge>`` of a road."""

    def read(e: Element) -> Passage:
        return Passage(
            kind="tunnel" if e.tag == "tunnel" else "bridge",
            id=e.get("id", ""),
            s_m=document.number(e, "s", 0.0),
            length_m=document.length(e, "length", 0.0),
            line=document.line(e),
        )

    elements = [*road.findall("objects/tunnel"), *road.findall("objects/bridge")]
    return tuple(document.each(elements, read))


def _near(document: Document, element: Element, s_m: float, t_m: float, length_m: float) -> None:
    """Refuses places that no road's furniture has: scenery would have to reach there."""
    if abs(t_m) > REACH_M or not -REACH_M <= s_m <= length_m + REACH_M:
        document.fail(element, f"lies at s={s_m:g}, t={t_m:g} of a road of {length_m:g} m", "correct them")


def _validity(document: Document, element: Element) -> tuple[Validity, ...]:
    return tuple(
        Validity(
            from_lane=document.integer(e, "fromLane", limit=10_000),
            to_lane=document.integer(e, "toLane", limit=10_000),
        )
        for e in element.findall("validity")
    )


def _signal(document: Document, element: Element, length_m: float) -> SignalRecord:
    s, t = document.number(element, "s"), document.number(element, "t")
    _near(document, element, s, t, length_m)
    return SignalRecord(
        id=document.text(element, "id"),
        name=element.get("name", ""),
        s_m=s,
        t_m=t,
        z_offset_m=document.number(element, "zOffset", 0.0, limit=REACH_M),
        h_offset_rad=document.number(element, "hOffset", 0.0),
        orientation=element.get("orientation", "none"),
        dynamic=element.get("dynamic", "no") in ("yes", "true", "1"),
        type=element.get("type", "-1"),
        value=document.number(element, "value", limit=1e12) if element.get("value") else None,
        unit=element.get("unit", ""),
        width_m=document.number(element, "width", 0.0, limit=REACH_M),
        height_m=document.number(element, "height", 0.0, limit=REACH_M),
        validity=_validity(document, element),
        line=document.line(element),
    )


def _object(document: Document, element: Element, length_m: float) -> RoadObject:
    s, t = document.number(element, "s"), document.number(element, "t")
    _near(document, element, s, t, length_m)
    outlines = [*element.findall("outline"), *element.findall("outlines/outline")]
    return RoadObject(
        id=element.get("id", ""),
        name=element.get("name", ""),
        type=element.get("type", "none"),
        s_m=s,
        t_m=t,
        z_offset_m=document.number(element, "zOffset", 0.0, limit=REACH_M),
        heading_rad=document.number(element, "hdg", 0.0),
        length_m=document.number(element, "length", 0.0, limit=REACH_M),
        width_m=document.number(element, "width", 0.0, limit=REACH_M),
        height_m=document.number(element, "height", 0.0, limit=REACH_M),
        outlines=tuple(document.each(outlines, lambda e: _outline(document, e, length_m))),
        line=document.line(element),
    )


def _outline(document: Document, element: Element, length_m: float) -> Outline:
    corners: list[CornerRoad | CornerLocal] = []
    for e in element:
        if e.tag == "cornerRoad":
            s, t = document.number(e, "s"), document.number(e, "t")
            _near(document, e, s, t, length_m)
            corners.append(CornerRoad(s, t, document.number(e, "dz", 0.0, limit=REACH_M)))
        elif e.tag == "cornerLocal":
            u = document.number(e, "u", limit=REACH_M)
            v = document.number(e, "v", limit=REACH_M)
            corners.append(CornerLocal(u, v, document.number(e, "z", 0.0, limit=REACH_M)))
    return Outline(corners=tuple(corners))
