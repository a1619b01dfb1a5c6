"""Reads an OpenDRIVE file into `OpenDrive`; every fault is one MapError naming element, id and line."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from carlaloc_env.town.opendrive.ordering_notes import record_notes
from carlaloc_env.town.opendrive.read_geometry import read_cubics, read_plan_view, read_shapes
from carlaloc_env.town.opendrive.read_lanes import read_sections, read_speed
from carlaloc_env.town.opendrive.read_objects import read_objects, read_signal_references, read_signals
from carlaloc_env.town.opendrive.records import (
    Connection,
    Controller,
    Junction,
    JunctionController,
    Note,
    OpenDrive,
    Road,
    RoadLink,
    SpeedRecord,
)
from carlaloc_env.town.opendrive.xml_document import Document, Element

ROAD_LIMIT = 100_000
"""Maps with more roads are refused."""


def read_opendrive(source: Path | bytes) -> OpenDrive:
    """Reads OpenDRIVE 1.4 to 1.7; unknown elements are skipped.

    Args:
        source: The file, or its bytes.

    Raises:
        MapError: The file is not readable as a map; the line says where and what to do.
    """
    document = Document(source)
    root = document.root
    header = root.find("header")
    elements = root.findall("road")
    if not elements:
        document.fail(root, "has no <road>", "export a map that holds roads")
    if len(elements) > ROAD_LIMIT:
        document.fail(root, f"has {len(elements)} roads", f"split the map; {ROAD_LIMIT} are allowed")
    _refuse_repeats(document, elements)
    junctions = root.findall("junction")
    _refuse_repeats(document, junctions)
    junction_ids = {e.get("id") for e in junctions}
    road_ids = {e.get("id") for e in elements}
    roads = tuple(_road(document, e, road_ids, junction_ids) for e in elements)
    notes = [note for e in elements for note in record_notes(document, e)]
    return OpenDrive(
        source=document.name,
        revision=_revision(document, header, notes),
        name=header.get("name", "") if header is not None else "",
        vendor=header.get("vendor", "") if header is not None else "",
        geo_reference=_geo_reference(header),
        offset=_offset(document, header),
        roads=roads,
        junctions=tuple(_junction(document, e) for e in junctions),
        controllers=tuple(_controller(document, e) for e in root.findall("controller")),
        notes=tuple(notes),
    )


def _refuse_repeats(document: Document, elements: list[Element]) -> None:
    seen: set[str] = set()
    for element in elements:
        label = document.text(element, "id")
        if label in seen:
            document.fail(element, "repeats an id", "give it another id")
        seen.add(label)


def _revision(document: Document, header: Element | None, notes: list[Note]) -> tuple[int, int]:
    if header is None:
        notes.append(Note(severity="warning", element="header", id="", line=1, message="no <header>"))
        return (1, 4)
    major = document.integer(header, "revMajor", 1)
    if major != 1:
        document.fail(header, f"has revMajor={major}", "export OpenDRIVE 1.4 to 1.7")
    return (major, document.integer(header, "revMinor", 4))


def _geo_reference(header: Element | None) -> str | None:
    element = header.find("geoReference") if header is not None else None
    text = (element.text or "").strip() if element is not None else ""
    return text or None


def _offset(document: Document, header: Element | None) -> tuple[float, float, float, float]:
    element = header.find("offset") if header is not None else None
    if element is None:
        return (0.0, 0.0, 0.0, 0.0)
    # Offsets are map-projection coordinates and may be far larger than any map.
    x, y, z, hdg = (document.number(element, k, 0.0, limit=1e9) for k in ("x", "y", "z", "hdg"))
    return (x, y, z, hdg)


def _road(
    document: Document, element: Element, road_ids: set[str | None], junction_ids: set[str | None]
) -> Road:
    length = document.length(element, "length")
    junction = element.get("junction", "-1")
    types = element.findall("type")
    speeds = [
        SpeedRecord(document.number(t, "s", 0.0), read_speed(document, e))
        for t in types
        for e in t.findall("speed")
    ]
    return Road(
        id=document.text(element, "id"),
        name=element.get("name", ""),
        length_m=length,
        junction_id=None if junction in ("-1", "") else junction,
        left_hand_traffic=element.get("rule", "RHT") == "LHT",
        predecessor=_link(document, element.find("link/predecessor"), road_ids, junction_ids),
        successor=_link(document, element.find("link/successor"), road_ids, junction_ids),
        type=types[0].get("type", "unknown") if types else "unknown",
        speeds=tuple(sorted(speeds, key=lambda r: r.s_m)),
        geometry=read_plan_view(document, element),
        elevation=read_cubics(document, element.findall("elevationProfile/elevation")),
        superelevation=read_cubics(document, element.findall("lateralProfile/superelevation")),
        shape=read_shapes(document, element),
        lane_offset=read_cubics(document, element.findall("lanes/laneOffset")),
        sections=read_sections(document, element, length),
        objects=read_objects(document, element),
        signals=read_signals(document, element),
        signal_references=read_signal_references(document, element),
        line=document.line(element),
    )


def _contact(document: Document, element: Element) -> Literal["start", "end"] | None:
    value = element.get("contactPoint")
    if value is None or value == "":
        return None
    if value == "start":
        return "start"
    if value == "end":
        return "end"
    document.fail(element, f"has contactPoint='{value[:40]}'", "write start or end")


def _link(
    document: Document, element: Element | None, road_ids: set[str | None], junction_ids: set[str | None]
) -> RoadLink | None:
    if element is None:
        return None
    label = document.text(element, "elementId")
    kind = element.get("elementType")
    if kind not in ("road", "junction"):
        kind = "junction" if label in junction_ids and label not in road_ids else "road"
    return RoadLink(
        element_type="junction" if kind == "junction" else "road",
        element_id=label,
        contact=_contact(document, element),
    )


def _junction(document: Document, element: Element) -> Junction:
    connections = []
    for e in element.findall("connection"):
        # Virtual junctions have connections without roads, direct junctions name the linked road.
        connecting = e.get("connectingRoad") or e.get("linkedRoad")
        incoming = e.get("incomingRoad")
        if not connecting or not incoming:
            if element.get("type") == "virtual":
                continue
            missing = "incomingRoad" if not incoming else "connectingRoad"
            document.fail(e, f"has no attribute '{missing}'", "name the road")
        links = tuple(
            (document.integer(k, "from", limit=10_000), document.integer(k, "to", limit=10_000))
            for k in e.findall("laneLink")
        )
        connections.append(
            Connection(
                id=e.get("id", ""),
                incoming_road=incoming,
                connecting_road=connecting,
                contact=_contact(document, e),
                lane_links=links,
                line=document.line(e),
            )
        )
    controllers = tuple(
        JunctionController(id=document.text(e, "id"), sequence=document.integer(e, "sequence", 0))
        for e in element.findall("controller")
    )
    return Junction(
        id=document.text(element, "id"),
        name=element.get("name", ""),
        type=element.get("type", "default"),
        connections=tuple(connections),
        controllers=controllers,
        line=document.line(element),
    )


def _controller(document: Document, element: Element) -> Controller:
    # RoadRunner lists each signal several times: keep the first of each.
    ids = dict.fromkeys(document.text(e, "signalId") for e in element.findall("control"))
    return Controller(
        id=document.text(element, "id"),
        name=element.get("name", ""),
        sequence=document.integer(element, "sequence", 0),
        signal_ids=tuple(ids),
        line=document.line(element),
    )
