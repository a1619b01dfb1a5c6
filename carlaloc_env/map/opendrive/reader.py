"""Reads an OpenDRIVE file into `OpenDrive`; what cannot be used is left out with a note on the place."""

from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

from carlaloc_env.core.errors import MapError
from carlaloc_env.map.opendrive.cross_section_surface import read_cross_section_surface
from carlaloc_env.map.opendrive.geo_reference import read_geo_reference
from carlaloc_env.map.opendrive.junction_grids import on_grids
from carlaloc_env.map.opendrive.near_origin import near_origin
from carlaloc_env.map.opendrive.read_lane_sections import read_sections, read_speed
from carlaloc_env.map.opendrive.read_plan_view import read_cubics, read_plan_view, read_shapes
from carlaloc_env.map.opendrive.read_signals_and_objects import (
    read_objects,
    read_passages,
    read_signal_references,
    read_signals,
)
from carlaloc_env.map.opendrive.record_order import note_order
from carlaloc_env.map.opendrive.records import (
    Connection,
    Controller,
    Geometry,
    Junction,
    JunctionController,
    OpenDrive,
    Road,
    RoadLink,
    SpeedRecord,
)
from carlaloc_env.map.opendrive.unread_elements import note_unread
from carlaloc_env.map.opendrive.xml_document import Document, Element, ElementError

ROAD_LIMIT = 100_000
"""Maps with more roads are refused."""
Numbered = TypeVar("Numbered", Road, Junction)
"""Records that have ids."""
LENGTH_TOLERANCE_M = 0.01
"""A stated length that is farther off the reference line's own is not believed [m]."""


def read_opendrive(source: Path | bytes) -> OpenDrive:
    """Reads OpenDRIVE 1.4 to 1.8; unknown elements are skipped, and malformed ones left out with a note.

    Args:
        source: The file, or its bytes.

    Raises:
        MapError: The file is not readable as a map, or none of its roads is; the line says what to do.
    """
    document = Document(source)
    root = document.root
    header = root.find("header")
    elements = root.findall("road")
    if not elements:
        document.fail(root, "has no <road>", "export a map that holds roads")
    if len(elements) > ROAD_LIMIT:
        document.fail(root, f"has {len(elements)} roads", f"split the map; {ROAD_LIMIT} are allowed")
    junctions = root.findall("junction")
    ids = _Ids({e.get("id") for e in elements}, {e.get("id") for e in junctions})
    seen: set[str] = set()
    roads = document.each(elements, lambda e: _new(document, e, seen, _road(document, e, ids)))
    roads, shift_m = near_origin(document, on_grids(document, junctions, roads))
    if not roads:
        raise MapError(f"{document.name}: no road can be used; {document.notes[-1].message}")
    for element in elements:
        note_order(document, element)
    note_unread(document)
    seen_junctions: set[str] = set()
    return OpenDrive(
        source=document.name,
        revision=_revision(document, header),
        name=header.get("name", "") if header is not None else "",
        vendor=header.get("vendor", "") if header is not None else "",
        geo=read_geo_reference(document, header, roads, shift_m),
        shift_m=shift_m,
        roads=tuple(roads),
        junctions=tuple(
            document.each(junctions, lambda e: _new(document, e, seen_junctions, _junction(document, e)))
        ),
        controllers=tuple(document.each(root.findall("controller"), lambda e: _controller(document, e))),
        notes=tuple(document.notes),
    )


class _Ids(NamedTuple):
    """Ids of all roads and junctions of a file."""

    roads: set[str | None]
    junctions: set[str | None]


def _new(document: Document, element: Element, seen: set[str], record: Numbered) -> Numbered:
    if record.id in seen:
        document.fail(element, "repeats an id", "give it another id")
    seen.add(record.id)
    return record


def _revision(document: Document, header: Element | None) -> tuple[int, int]:
    if header is None:
        document.note(document.root, "has no <header>")
        return (1, 4)
    try:
        revision = (document.integer(header, "revMajor", 1), document.integer(header, "revMinor", 4))
    except ElementError as error:
        document.note(header, f"{error.problem}; read as OpenDRIVE 1.4")
        return (1, 4)
    if revision[0] != 1:
        document.note(header, f"has revMajor={revision[0]}; read as OpenDRIVE 1.8")
    return revision


def _road(document: Document, element: Element, ids: _Ids) -> Road:
    geometry = read_plan_view(document, element)
    length = _length(document, element, geometry)
    junction = element.get("junction", "-1")
    types = element.findall("type")
    if len({e.get("type") for e in types}) > 1:
        document.note(element, "changes its type along its way; its scenery is that of the first")

    def speed(e: Element) -> SpeedRecord:
        return SpeedRecord(document.number(e.getparent(), "s", 0.0), read_speed(document, e))

    return Road(
        id=document.text(element, "id"),
        name=element.get("name", ""),
        length_m=length,
        junction_id=None if junction in ("-1", "") else junction,
        left_hand_traffic=element.get("rule", "RHT") == "LHT",
        predecessor=_link(document, element.find("link/predecessor"), ids),
        successor=_link(document, element.find("link/successor"), ids),
        type=types[0].get("type", "unknown") if types else "unknown",
        speeds=tuple(sorted(document.each(element.findall("type/speed"), speed), key=lambda r: r.s_m)),
        geometry=geometry,
        elevation=read_cubics(document, element.findall("elevationProfile/elevation")),
        superelevation=read_cubics(document, element.findall("lateralProfile/superelevation")),
        shape=read_cross_section_surface(document, element, length) or read_shapes(document, element),
        lane_offset=read_cubics(document, element.findall("lanes/laneOffset")),
        sections=read_sections(document, element, length),
        objects=read_objects(document, element, length),
        signals=read_signals(document, element, length),
        signal_references=read_signal_references(document, element),
        passages=read_passages(document, element),
        line=document.line(element),
    )


def _length(document: Document, element: Element, geometry: tuple[Geometry, ...]) -> float:
    """Length of a road [m]: the stated one, unless its reference line is of another length."""
    drawn = geometry[-1].s_m + geometry[-1].length_m
    try:
        stated = document.length(element, "length")
    except ElementError as error:
        document.note(element, f"{error.problem}; its geometry has {drawn:g} m, which is taken", "error")
        return drawn
    if drawn <= 0.0 or abs(stated - drawn) <= LENGTH_TOLERANCE_M:
        return stated
    message = f"length is {stated:g} m, its geometry adds up to {drawn:.9g} m, which is taken"
    document.note(element, message, "error")
    return drawn


def _contact(document: Document, element: Element) -> Literal["start", "end"] | None:
    value = element.get("contactPoint")
    if value == "start":
        return "start"
    if value == "end":
        return "end"
    if value:
        document.note(element, f"has contactPoint='{value[:40]}'; the nearer end is taken", "error")
    return None


def _link(document: Document, element: Element | None, ids: _Ids) -> RoadLink | None:
    if element is None:
        return None
    label = element.get("elementId")
    if not label:
        document.note(element, "has no elementId, so the link is left out")
        return None
    kind = element.get("elementType")
    if kind not in ("road", "junction"):
        kind = "junction" if label in ids.junctions and label not in ids.roads else "road"
    return RoadLink(
        element_type="junction" if kind == "junction" else "road",
        element_id=label,
        contact=_contact(document, element),
    )


def _junction(document: Document, element: Element) -> Junction:
    # Connections of virtual junctions may name no roads.
    virtual = element.get("type") == "virtual"
    connections = [
        e for e in element.findall("connection") if not virtual or (_connecting(e) and e.get("incomingRoad"))
    ]
    return Junction(
        id=document.text(element, "id"),
        name=element.get("name", ""),
        type=element.get("type", "default"),
        connections=tuple(document.each(connections, lambda e: _connection(document, e))),
        controllers=tuple(
            document.each(
                element.findall("controller"),
                lambda e: JunctionController(
                    id=document.text(e, "id"), sequence=document.integer(e, "sequence", 0)
                ),
            )
        ),
        line=document.line(element),
    )


def _connecting(element: Element) -> str | None:
    """The connecting road; direct junctions name the linked road."""
    label: str | None = element.get("connectingRoad") or element.get("linkedRoad")
    return label


def _connection(document: Document, element: Element) -> Connection:
    connecting = _connecting(element)
    if connecting is None:
        document.fail(element, "has no attribute 'connectingRoad'", "name the road")
    links = document.each(
        element.findall("laneLink"),
        lambda k: (document.integer(k, "from", limit=10_000), document.integer(k, "to", limit=10_000)),
    )
    return Connection(
        id=element.get("id", ""),
        incoming_road=document.text(element, "incomingRoad"),
        connecting_road=connecting,
        contact=_contact(document, element),
        lane_links=tuple(links),
        line=document.line(element),
    )


def _controller(document: Document, element: Element) -> Controller:
    # RoadRunner lists each signal several times: keep the first of each.
    ids = dict.fromkeys(document.each(element.findall("control"), lambda e: document.text(e, "signalId")))
    return Controller(
        id=document.text(element, "id"),
        name=element.get("name", ""),
        sequence=document.integer(element, "sequence", 0),
        signal_ids=tuple(ids),
        line=document.line(element),
    )
