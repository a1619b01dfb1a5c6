"""Notes on records that stand out of order or begin too late; such files are read all the same."""

from carlaloc_env.map.opendrive.xml_document import Document, Element, ElementError

ROAD_RECORDS = (
    ("planView/geometry", True),
    ("elevationProfile/elevation", True),
    ("lateralProfile/superelevation", False),
    ("lanes/laneOffset", True),
    ("lanes/laneSection", True),
)
"""Path of the records and whether the first must begin at s = 0."""


def note_order(document: Document, road: Element) -> None:
    """Notes descending s in one road's records, and first records that leave the road's start open."""
    for path, from_zero in ROAD_RECORDS:
        _sequence(document, road.findall(path), "s", from_zero)
    for section in road.findall("lanes/laneSection"):
        for lane in section.iter("lane"):
            _sequence(document, lane.findall("width"), "sOffset", True)


def _sequence(document: Document, elements: list[Element], name: str, from_zero: bool) -> None:
    last = None
    for element in elements:
        try:
            s = document.number(element, name, 0.0)
        except ElementError:
            continue
        if last is None and from_zero and abs(s) > 1e-9:
            document.note(element, f"first record begins at {name}={s:g}; begin at 0")
        elif last is not None and s < last:
            document.note(element, f"{name}={s:g} after {last:g}; write records in ascending order")
        last = s
