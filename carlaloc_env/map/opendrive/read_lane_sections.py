"""Reads lane sections: lanes with widths, borders, heights, marks and speeds."""

import math
from dataclasses import replace
from typing import TypeVar

from carlaloc_env.map.opendrive.read_plan_view import read_cubics
from carlaloc_env.map.opendrive.records import (
    LaneHeight,
    LaneMaterial,
    LaneRecord,
    LaneSection,
    MarkLine,
    RoadMark,
    SpeedRecord,
)
from carlaloc_env.map.opendrive.xml_document import Document, Element

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
    elements = [
        lane for side in element if side.tag in ("left", "center", "right") for lane in side.findall("lane")
    ]
    if len(elements) > LANES_PER_SECTION_LIMIT:
        document.fail(element, f"has {len(elements)} lanes", f"keep to {LANES_PER_SECTION_LIMIT}")
    seen: set[int] = set()

    def read(source: Element) -> LaneRecord:
        lane = _lane(document, source, s)
        if lane.id in seen:
            document.fail(source, "repeats a lane id of its section", "give it another id")
        seen.add(lane.id)
        return lane

    lanes = sorted(document.each(elements, read), key=lambda lane: -lane.id)
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

    ids = document.each(element.findall(f"link/{name}"), read)
    return tuple(lane_id for lane_id in ids if lane_id is not None)


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
