"""Roads at a junction that name another one, and lanes that no connection leads on."""

import pytest
from shared_fixtures.worlds.maps import CROSSING
from shared_fixtures.worlds.ring_maps import LANE, joined_map, lane, ring_map

from carlaloc_env.map.checks.report import report
from carlaloc_env.map.checks.roads import Problem
from carlaloc_env.map.lanes.build_network import build_network


def problems(text: str) -> list[Problem]:
    network = build_network(text.encode())
    return list(report(network.xodr, network).problems)


def road(label: int, x: float, links: str) -> str:
    return (
        f'<road length="100" id="{label}" junction="-1"><link>{links}</link><planView>'
        f'<geometry s="0" x="{x}" y="0" hdg="0" length="100"><line/></geometry></planView><lanes>'
        f'<laneSection s="0"><center><lane id="0"/></center><right>{lane(-1, link="")}</right></laneSection>'
        "</lanes></road>"
    )


def direct_map(linked_end: str, contact: str = 'contactPoint="start"') -> str:
    """Two roads in a line, joined by the direct junction 20; junction 21 stands by."""
    ahead = '<successor elementType="junction" elementId="20"/>'
    connection = f'<connection id="0" incomingRoad="1" linkedRoad="2" {contact}><laneLink from="-1" to="-1"/>'
    return (
        '<OpenDRIVE><header revMajor="1" revMinor="7"/>'
        f"{road(1, 0.0, ahead)}{road(2, 100.0, linked_end)}"
        f'<junction id="20" type="direct">{connection}</connection></junction>'
        '<junction id="21" type="direct"/></OpenDRIVE>'
    )


@pytest.mark.parametrize("contact", ['contactPoint="start"', ""])
@pytest.mark.parametrize(
    ("linked_end", "back"),
    [
        ('<predecessor elementType="junction" elementId="20"/>', None),
        ('<predecessor elementType="junction" elementId="21"/>', "junction 21"),
        ("", "no junction"),
        ('<predecessor elementType="road" elementId="1" contactPoint="end"/>', "no junction"),
    ],
)
def test_direct_junctions_are_linked_from_both_sides(linked_end: str, back: str | None, contact: str) -> None:
    """A row has both junctions; the lanes are joined all the same."""
    text = direct_map(linked_end, contact)
    found = [p for p in problems(text) if "points back" in p.message]
    assert [p.id for p in found] == (["0 of junction 20"] if back else [])
    assert all(f"road 2 points back to {back}, not to junction 20" in p.message for p in found)
    network = build_network(text.encode())
    assert network.lanes[0].successors == (network.lanes[1].index,)


def test_connecting_roads_belong_to_their_junction() -> None:
    usual = joined_map()
    assert not [p for p in problems(usual) if "belongs to" in p.message]
    other = usual.replace('id="3" junction="9"', 'id="3" junction="8"')
    (found,) = (p for p in problems(other) if "connecting road" in p.message)
    assert "road 3 belongs to junction 8, not to junction 9" in found.message


def test_a_lane_that_no_connection_leads_on_names_the_junction() -> None:
    """Road 4 ends at junction 9, which joins road 1 and road 2 alone."""
    into = '<successor elementType="junction" elementId="9"/>'
    text = joined_map().replace("<junction ", road(4, 300.0, into) + "<junction ")
    found = [p for p in problems(text) if p.id == "-1 of road 4" and "dead end" in p.message]
    assert ["junction 9" in p.message for p in found] == [True]
    out = '<predecessor elementType="junction" elementId="9"/>'
    text = joined_map().replace("<junction ", road(4, 300.0, out) + "<junction ")
    found = [p for p in problems(text) if p.id == "-1 of road 4" and "cannot be entered" in p.message]
    assert ["connection of junction 9" in p.message for p in found] == [True]


@pytest.mark.parametrize(("stated", "count"), [("none", 1), ("increase", 1), ("both", 0)])
def test_marks_that_bar_changes_between_lanes(stated: str, count: int) -> None:
    """That of lane -1 lies between two lanes of one direction, that of lane -2 at the road's edge."""
    mark = f'<roadMark sOffset="0" type="solid" laneChange="{stated}"/>'
    found = problems(ring_map(right=lane(-1, LANE + mark) + lane(-2, LANE + mark)))
    assert [p.id for p in found if "laneChange" in p.message] == ["of lane -1 of road 1"] * count


def test_objects_and_signs_without_effect() -> None:
    text = CROSSING.read_text(encoding="utf-8")
    pole = '<object type="barrier" id="77" name="wall" s="5" t="8" length="2" width="1" height="1"/>'
    found = problems(text.replace("<objects>", f"<objects>{pole}", 1).replace('type="206"', 'type="267"', 1))
    assert [p.message for p in found if p.id == "77 of road 1"] == ["of type barrier is not built"]
    assert [p.message for p in found if "heed" in p.message] == [
        "is a sign of type 267, which cars do not heed"
    ]
    assert not [p for p in found if p.element == "object" and "crosswalk" in p.message]
