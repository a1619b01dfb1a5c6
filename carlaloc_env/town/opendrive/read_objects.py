"""Reads signals, signal references and objects of a road."""

from __future__ import annotations

from carlaloc_env.town.opendrive.records import (
    CornerLocal,
    CornerRoad,
    Outline,
    RoadObject,
    SignalRecord,
    SignalReference,
    Validity,
)
from carlaloc_env.town.opendrive.xml_document import Document, Element


def read_signals(document: Document, road: Element) -> tuple[SignalRecord, ...]:
    """All ``<signal>`` of a road in file order."""
    return tuple(_signal(document, e) for e in road.findall("signals/signal"))


def read_signal_references(document: Document, road: Element) -> tuple[SignalReference, ...]:
    """All ``<signalReference>`` of a road in file order."""
    return tuple(
        SignalReference(
            id=document.text(e, "id"),
            s_m=document.number(e, "s"),
            orientation=e.get("orientation", "none"),
            validity=_validity(document, e),
            line=document.line(e),
        )
        for e in road.findall("signals/signalReference")
    )


def read_objects(document: Document, road: Element) -> tuple[RoadObject, ...]:
    """All ``<object>`` of a road in file order."""
    return tuple(_object(document, e) for e in road.findall("objects/object"))


def _validity(document: Document, element: Element) -> tuple[Validity, ...]:
    return tuple(
        Validity(
            from_lane=document.integer(e, "fromLane", limit=10_000),
            to_lane=document.integer(e, "toLane", limit=10_000),
        )
        for e in element.findall("validity")
    )


def _signal(document: Document, element: Element) -> SignalRecord:
    return SignalRecord(
        id=document.text(element, "id"),
        name=element.get("name", ""),
        s_m=document.number(element, "s"),
        t_m=document.number(element, "t"),
        z_offset_m=document.number(element, "zOffset", 0.0),
        h_offset_rad=document.number(element, "hOffset", 0.0),
        orientation=element.get("orientation", "none"),
        dynamic=element.get("dynamic", "no") in ("yes", "true", "1"),
        type=element.get("type", "-1"),
        value=document.number(element, "value", limit=1e12) if element.get("value") else None,
        unit=element.get("unit", ""),
        width_m=document.number(element, "width", 0.0),
        height_m=document.number(element, "height", 0.0),
        validity=_validity(document, element),
        line=document.line(element),
    )


def _object(document: Document, element: Element) -> RoadObject:
    outlines = [*element.findall("outline"), *element.findall("outlines/outline")]
    return RoadObject(
        id=element.get("id", ""),
        name=element.get("name", ""),
        type=element.get("type", "none"),
        s_m=document.number(element, "s"),
        t_m=document.number(element, "t"),
        z_offset_m=document.number(element, "zOffset", 0.0),
        heading_rad=document.number(element, "hdg", 0.0),
        length_m=document.number(element, "length", 0.0),
        width_m=document.number(element, "width", 0.0),
        height_m=document.number(element, "height", 0.0),
        outlines=tuple(_outline(document, e) for e in outlines),
        line=document.line(element),
    )


def _outline(document: Document, element: Element) -> Outline:
    corners: list[CornerRoad | CornerLocal] = []
    for e in element:
        if e.tag == "cornerRoad":
            s, t = document.number(e, "s"), document.number(e, "t")
            corners.append(CornerRoad(s, t, document.number(e, "dz", 0.0)))
        elif e.tag == "cornerLocal":
            u, v = document.number(e, "u"), document.number(e, "v")
            corners.append(CornerLocal(u, v, document.number(e, "z", 0.0)))
    return Outline(corners=tuple(corners))
