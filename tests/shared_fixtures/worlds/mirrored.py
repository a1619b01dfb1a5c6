"""A map in a mirror: y and all that counts to the left change their sign, traffic keeps to the other side."""

import xml.etree.ElementTree as ET
from pathlib import Path

_NEGATED = {
    "geometry": ("y", "hdg"),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "laneOffset": tuple("abcd"),
    "superelevation": tuple("abcd"),
    "signal": ("t", "hOffset"),
    "signalReference": ("t",),
    "object": ("t", "hdg"),
    "cornerLocal": ("v",),
    "cornerRoad": ("t",),
}
_LANE_IDS = {"laneLink": ("from", "to"), "validity": ("fromLane", "toLane")}


def mirrored(source: Path) -> bytes:
    """An OpenDRIVE file of right-hand traffic as one of left-hand traffic, mirrored at the x axis."""
    root = ET.fromstring(source.read_bytes())
    for element in root.iter():
        for name in _NEGATED.get(element.tag, ()):
            if name in element.attrib:
                element.set(name, repr(-float(element.attrib[name])))
        for name in _LANE_IDS.get(element.tag, ()):
            element.set(name, str(-int(element.attrib[name])))
        if element.tag == "road":
            element.set("rule", "LHT")
        if element.tag == "laneSection":
            _swap(element)
    return ET.tostring(root)


def _swap(section: ET.Element) -> None:
    lanes = section.findall("./*/lane")
    for lane in lanes:
        lane.set("id", str(-int(lane.attrib["id"])))
        for link in lane.findall("./link/*"):
            link.set("id", str(-int(link.attrib["id"])))
    for side in list(section):
        section.remove(side)
    for name, sign in (("left", 1), ("center", 0), ("right", -1)):
        own = [n for n in lanes if (int(n.attrib["id"]) > 0) - (int(n.attrib["id"]) < 0) == sign]
        if own:
            side = ET.SubElement(section, name)
            side.extend(sorted(own, key=lambda lane: -int(lane.attrib["id"])))
