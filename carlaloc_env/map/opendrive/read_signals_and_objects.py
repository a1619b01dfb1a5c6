"""Reads signals, objects, tunnels and bridges of roads."""

from carlaloc_env.map.opendrive.records import (
    CornerLocal,
    CornerRoad,
    Outline,
    Passage,
    RoadObject,
    SignalRecord,
    SignalReference,
    Validity,
)
from carlaloc_env.map.opendrive.xml_document import Document, Element

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
