"""Notes on records that stand out of order or begin too late; such files are read all the same."""

from __future__ import annotations

from collections.abc import Iterator

from carlaloc_env.town.opendrive.records import Note
from carlaloc_env.town.opendrive.xml_document import Document, Element

ROAD_RECORDS = (
    ("planView/geometry", True),
    ("elevationProfile/elevation", True),
    ("lateralProfile/superelevation", False),
    ("lanes/laneOffset", True),
    ("lanes/laneSection", True),
)
"""Path of the records and whether the first must begin at s = 0."""


def record_notes(document: Document, road: Element) -> Iterator[Note]:
    """Notes for one road: descending s, and first records that leave the road's start open."""
    label = road.get("id", "")
    for path, from_zero in ROAD_RECORDS:
        yield from _sequence(document, road.findall(path), "s", from_zero, f"road {label}")
    for section in road.findall("lanes/laneSection"):
        for lane in section.iter("lane"):
            place = f"lane {lane.get('id', '')} of road {label}"
            yield from _sequence(document, lane.findall("width"), "sOffset", True, place)


def _sequence(
    document: Document, elements: list[Element], name: str, from_zero: bool, place: str
) -> Iterator[Note]:
    last = None
    for element in elements:
        s = document.number(element, name, 0.0)
        problem = None
        if last is None and from_zero and abs(s) > 1e-9:
            problem = f"first record begins at {name}={s:g}; begin at 0"
        elif last is not None and s < last:
            problem = f"{name}={s:g} after {last:g}; write records in ascending order"
        if problem is not None:
            line = document.line(element)
            yield Note(severity="error", element=str(element.tag), id=place, line=line, message=problem)
        last = s
