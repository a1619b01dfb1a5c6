"""What a map says and nobody reads is reported: what it is, where it stands and what is missing for it."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from shared_fixtures.worlds.maps import CROSSING, MAPS
from shared_fixtures.worlds.ring_maps import LANE, lane, ring_map

from carlaloc_env.map.checks.report import grouped
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.opendrive.records import Note
from carlaloc_env.map.opendrive.unread_elements import element_table

TEXT = CROSSING.read_text(encoding="utf-8")
ROAD = "<planView>"
SURFACE = '<surface><CRG file="a.crg" sStart="0" sEnd="9" orientation="same" mode="attached"/></surface>'


def notes(text: str, element: str) -> list[Note]:
    return [note for note in read_opendrive(text.encode()).notes if note.element == element]


def in_road(text: str) -> str:
    """The crossing with this in front of road 1's reference line."""
    return TEXT.replace(ROAD, text + ROAD, 1)


def in_junction(text: str) -> str:
    return TEXT.replace("</junction>", text + "</junction>")


@pytest.mark.parametrize(
    ("text", "element", "place", "part"),
    [
        (in_junction('<boundary><segment type="lane"/></boundary>'), "boundary", "junction 100", "outline"),
        (in_junction('<priority high="1" low="2"/>'), "priority", "junction 100", "right of way"),
        (in_junction(SURFACE), "surface", "junction 100", "OpenCRG"),
        (in_junction('<crossPath id="4" crossingRoad="9"/>'), "crossPath", "4 of junction 100", "walker"),
        (in_road(SURFACE), "surface", "road 1", "OpenCRG"),
        (in_road('<railroad><switch id="8"/></railroad>'), "railroad", "road 1", "rails"),
        (
            in_road('<lateralProfile><crossfall side="both" s="0" a="0.02"/></lateralProfile>'),
            "crossfall",
            "road 1",
            "fall to the sides",
        ),
        (
            TEXT.replace("<laneSection s", '<laneSection singleSide="true" s', 1),
            "laneSection",
            "road 1",
            "sides",
        ),
        (TEXT.replace("<road ", '<road layer="temporary" ', 1), "road", "1", "layers"),
        (TEXT.replace("<road ", "<include file='b.xodr'/><road ", 1), "include", "", "file"),
        (TEXT.replace("<road ", '<station id="5"/><road ', 1), "station", "5", "stop"),
        (TEXT.replace("<junction ", '<junction mainRoad="1" ', 1), "junction", "100", "virtual"),
    ],
)
def test_elements_and_attributes_that_are_not_read(text: str, element: str, place: str, part: str) -> None:
    assert text != TEXT
    found = [note for note in notes(text, element) if "not read" in note.message]
    assert [note.id for note in found] == [place]
    assert part in found[0].message
    line = next(n for n, row in enumerate(text.splitlines(), start=1) if f"<{element}" in row)
    assert found[0].line >= line


@pytest.mark.parametrize(
    ("attribute", "value", "usual", "part"),
    [
        ("direction", "reversed", "standard", "sign"),
        ("advisory", "both", "none", "own traffic"),
        ("level", "true", "false", "tilts"),
        ("roadWorks", "true", "false", "drive"),
        ("dynamicLaneDirection", "true", "false", "never changes"),
    ],
)
def test_attributes_of_lanes(attribute: str, value: str, usual: str, part: str) -> None:
    """Reported where they change anything, with lane and road."""

    def ring(stated: str) -> str:
        own = lane(-1).replace(' level="false"', "").replace('id="-1"', f'id="-1" {attribute}="{stated}"', 1)
        return ring_map(right=own)

    (found,) = (n for n in notes(ring(value), "lane") if "not read" in n.message)
    assert found.id == "-1 of road 1"
    assert f"'{attribute}'" in found.message
    assert part in found.message
    assert not [n for n in notes(ring(usual), "lane") if "not read" in n.message]


@pytest.mark.parametrize(
    "body", ['<access sOffset="0" rule="deny"/>', '<rule sOffset="0" value="no stopping"/>']
)
def test_rules_of_lanes(body: str) -> None:
    element = re.findall(r"<(\w+)", body)[0]
    assert [n.id for n in notes(ring_map(right=lane(-1, LANE + body)), element)] == ["lane -1 of road 1"]


def test_unknown_names_are_reported_once() -> None:
    """But none of those that the standard leaves to others."""
    text = TEXT.replace(ROAD, f'<camber side="left"/>{ROAD}').replace("<planView", '<planView shade="dark"')
    assert len(notes(text, "camber")) == 1
    assert [n.message for n in notes(text, "planView") if "'shade'" in n.message] != []
    assert len(notes(text, "planView")) == 1
    free = '<userData><camber layer="x"/></userData><v:camber xmlns:v="urn:vendor"/>'
    assert read_opendrive(in_road(free).encode()).notes == read_opendrive(TEXT.encode()).notes


def test_unknown_values_are_reported() -> None:
    found = notes(ring_map(right=lane(-1, type="Driving")), "lane")
    assert [(n.id, "type='Driving'" in n.message) for n in found] == [("-1 of road 1", True)]


def test_empty_elements_say_nothing() -> None:
    assert not notes(in_road("<surface>\n</surface>"), "surface")


def test_elements_in_a_wrong_place_are_reported() -> None:
    found = notes(in_road('<width sOffset="0" a="9" b="0" c="0" d="0"/>'), "width")
    assert [(n.id, "no element of <road>" in n.message) for n in found] == [("road 1", True)]


def test_an_element_that_occurs_often_is_one_row() -> None:
    """One note for each road, which the report shows as one row with a count."""
    own = '<access sOffset="0" rule="deny"/>'
    text = re.sub(r'(<lane id="-1"[^>]*>)(?=<link)', rf"\1{own}", TEXT)
    roads = ElementTree.fromstring(text).findall("road")
    holders = sum(road.find(".//access") is not None for road in roads)
    assert holders > 2
    found = notes(text, "access")
    assert len(found) == holders
    assert [count for _, count in grouped(found)] == [holders]


@pytest.mark.parametrize("path", MAPS)
def test_whole_towns_hold_nothing_unread(path: Path) -> None:
    """But for signals of CARLA's Town07 that lean."""
    unread = {n.message for n in read_opendrive(path).notes if "not read" in n.message}
    assert unread <= {f"attribute '{name}' is not read: it stands upright" for name in ("pitch", "roll")}


def test_the_table_gives_each_attribute_one_meaning() -> None:
    table = element_table()
    for name, entry in table.items():
        places = [*entry.get("read", "").split(), *entry.get("other", "").split(), *entry.get("unread", {})]
        assert len(places) == len(set(places)), name
        assert set(entry.get("values", {})) <= set(entry.get("read", "").split()), name
        holders = entry.get("in", "").split()
        assert all(h in table or h in ("OpenDRIVE", "*") for h in holders), name
        assert "missing" not in entry or len(entry) == 2, name


@pytest.mark.parametrize(
    ("kind", "speed", "doubted"),
    [
        ("town", 'max="50"', "180 km/h"),
        ("town", 'max="50" unit=""', "180 km/h"),
        ("town", 'max="50" unit="m/s"', "180 km/h"),
        ("town", 'max="13.9"', None),
        ("town", 'max="50" unit="km/h"', None),
        ("town", 'max="30" unit="mph"', None),
        ("lowSpeed", 'max="30"', "108 km/h"),
        ("motorway", 'max="36.1"', None),
        ("motorway", 'max="120"', "432 km/h"),
        ("rural", 'max="no limit"', None),
    ],
)
@pytest.mark.parametrize("of_lane", [False, True])
def test_limits_that_no_such_road_has(kind: str, speed: str, doubted: str | None, of_lane: bool) -> None:
    """They are read in m/s, as the standard has it; a word on the unit says how fast that is."""
    head = f'<type s="0" type="{kind}">{"" if of_lane else f"<speed {speed}/>"}</type>'
    own = lane(-1, LANE + f'<speed sOffset="0" {speed}/>') if of_lane else lane(-1)
    text = ring_map(right=own).replace(ROAD, head + ROAD, 1)
    found = [n for n in notes(text, "speed") if "km/h on a road of type" in n.message]
    assert [f"{doubted} on a road of type {kind}" in n.message for n in found] == [True] * (
        doubted is not None
    )
