"""Odd but legal roads, and malformed parts: the rest of the map loads, and each place is told."""

import math

import numpy as np
import pytest
from shared_fixtures.worlds.ring_maps import LANE, RING_M, joined_map, lane, ring_map

from carlaloc_env.core.errors import MapError
from carlaloc_env.map.checks.report import report
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive

POLY = '<{} sOffset="{}" a="{}" b="{}" c="{}" d="{}"/>'
OBJECT = '<object type="{}" id="7" s="{}" t="{}" zOffset="0" hdg="0" length="4" width="3">{}</object>'


def told(network: LaneNetwork, element: str) -> list[tuple[str, str]]:
    found = report(network.xodr, network).problems
    return [(p.severity, p.message) for p in found if p.element == element]


def widths(network: LaneNetwork, lane_id: int, s_m: list[float]) -> list[float]:
    number = next(n.index for n in network.lanes if n.lane_id == lane_id)
    return network.width_m([number] * len(s_m), network.station_m([number] * len(s_m), s_m)).tolist()


def test_lanes_of_borders() -> None:
    """Lane -1 to 3.5 m, the shoulder on to 5 m: 3.5 and 1.5 m wide."""
    right = lane(-1, POLY.format("border", 0, -3.5, 0, 0, 0))
    right += lane(-2, POLY.format("border", 0, -5, 0, 0, 0), type="shoulder")
    network = build_network(ring_map(right=right).encode())
    assert widths(network, -1, [10.0, 300.0]) == pytest.approx([3.5, 3.5])
    assert widths(network, -2, [10.0, 300.0]) == pytest.approx([1.5, 1.5])


def test_several_widths() -> None:
    """3.5 m up to 50 m, then 3.5 − 0.0012 ds² + 0.000016 ds³, which is 2.5 m 50 m on, then 2.5 m."""
    records = (
        LANE + POLY.format("width", 50, 3.5, 0, -0.0012, 0.000016) + POLY.format("width", 100, 2.5, 0, 0, 0)
    )
    network = build_network(ring_map(right=lane(-1, records)).encode())
    middle = 3.5 - 0.0012 * 25.0**2 + 0.000016 * 25.0**3
    assert widths(network, -1, [50.0, 75.0, 100.0, 200.0]) == pytest.approx([3.5, middle, 2.5, 2.5], abs=1e-3)


def test_a_shoulder_without_width() -> None:
    network = build_network(ring_map(right=lane(-1) + lane(-2, "", type="shoulder")).encode())
    assert ("error", "has no width") in told(network, "lane")
    assert widths(network, -2, [10.0]) == [0.0]


@pytest.mark.parametrize("stated", [RING_M + 40.0, RING_M - 40.0, 0.0])
def test_a_length_unlike_the_geometry(stated: float) -> None:
    """The reference line counts: no spur runs on beyond its end, and none is missing."""
    network = build_network(ring_map(length=stated).encode())
    assert network.xodr.roads[0].length_m == pytest.approx(RING_M)
    inner = next(n for n in network.lanes if n.lane_id == 1)
    assert inner.length_m == pytest.approx(200.0 + 2.0 * math.pi * (30.0 - 1.75), abs=0.02)
    ((severity, text),) = [row for row in told(network, "road") if "length is" in row[1]]
    assert severity == "error"
    assert f"{stated:g}" in text
    assert f"{RING_M:.6f}"[:7] in text


def test_pieces_of_no_length() -> None:
    pieces = '<geometry s="0" x="100" y="0" hdg="0" length="0"><line/></geometry>'
    pieces += '<geometry s="0" x="100" y="0" hdg="0" length="20"><line/></geometry>'
    pieces += '<geometry s="20" x="120" y="0" hdg="0" length="0"><arc curvature="0.1"/></geometry>'
    network = build_network(joined_map(through=pieces).encode())
    rows = network.waypoints(2.0)
    assert all(np.isfinite(rows[name]).all() for name in ("s", "x", "y", "z", "heading"))
    assert ("warning", "2 of its 3 <geometry> have length 0") in told(network, "road")
    assert next(n for n in network.lanes if n.road_id == "3").length_m == pytest.approx(20.0)


def test_marks_and_sections_beyond_the_end() -> None:
    mark = f'<roadMark sOffset="{RING_M + 2e-4}" type="broken" color="white"/>'
    network = build_network(ring_map(right=lane(-1, LANE + mark)).encode())
    assert [row[0] for row in told(network, "roadMark")] == ["warning"]
    late = "</laneSection><laneSection s='500'><center><lane id=\"0\"/></center></laneSection>"
    network = build_network(ring_map().replace("</laneSection>", late).encode())
    assert len(network.xodr.roads[0].sections) == 1
    assert [row[0] for row in told(network, "laneSection")] == ["error"]


def test_objects_beyond_the_end_and_at_absurd_places() -> None:
    corners = "".join(
        f'<cornerRoad s="{s}" t="{t}" dz="0"/>' for s, t in ((385, 3), (385, -3), (395, -3), (395, 3))
    )
    items = OBJECT.format("crosswalk", 388, 0, f"<outlines><outline>{corners}</outline></outlines>")
    items += OBJECT.format("pole", 388.6, 5, "") + OBJECT.format("pole", 10, 5e5, "")
    items += OBJECT.format("crosswalk", 9e5, 0, "") + OBJECT.format("pole", "NaN", 0, "")
    network = build_network(ring_map(more=f"<objects>{items}</objects>").encode())
    (crosswalk,) = network.crosswalks
    assert np.isfinite(crosswalk.polygon_m).all()
    assert len(network.xodr.roads[0].objects) == 2
    found = told(network, "object")
    assert [severity for severity, _ in found].count("error") == 3
    warnings = sorted(message for severity, message in found if severity == "warning")
    assert warnings == ["of type pole is not built", "s=388.6 lies beyond road 1"]


def test_tunnels_and_bridges_are_told() -> None:
    more = '<objects><tunnel s="10" length="50" id="1"/><bridge s="70" length="20" id="2"/></objects>'
    network = build_network(ring_map(more=more).encode())
    for kind, part in (("tunnel", "over it"), ("bridge", "under it")):
        ((severity, text),) = told(network, kind)
        assert severity == "warning"
        assert part in text


def test_empty_links() -> None:
    """Nothing is linked there; the other lane keeps its links."""
    empty = "<link><predecessor/><successor id=''/></link>"
    network = build_network(ring_map(right=lane(-1, link=empty)).encode())
    ours = {n.lane_id: n for n in network.lanes}
    assert ours[-1].successors == ()
    assert ours[1].successors == (ours[1].index,)
    assert len(told(network, "predecessor")) == len(told(network, "successor")) == 1
    road = '<predecessor elementType="road" elementId=""/><successor elementType="road" elementId=""/>'
    network = build_network(ring_map(link=road).encode())
    assert all(n.successors == () for n in network.lanes)
    assert [row[0] for row in told(network, "predecessor") + told(network, "successor")] == ["warning"] * 2
    assert report(network.xodr, network).errors == ()


@pytest.mark.parametrize(
    "bad",
    [
        '<connection id="1" connectingRoad="3"><laneLink from="-1" to="-1"/></connection>',
        '<connection id="1" incomingRoad="1"><laneLink from="-1" to="-1"/></connection>',
        '<connection id="1" incomingRoad="1" connectingRoad="77"><laneLink from="-1" to="-1"/></connection>',
        '<connection id="1" incomingRoad="1" connectingRoad="3"><laneLink from="a" to="-1"/></connection>',
    ],
)
def test_one_malformed_connection(bad: str) -> None:
    good = '<connection id="0" incomingRoad="1" connectingRoad="3" contactPoint="start">'
    good += '<laneLink from="-1" to="-1"/></connection>'
    network = build_network(joined_map(connection=good + bad).encode())
    one = next(n for n in network.lanes if n.road_id == "1")
    assert [network.lanes[n].road_id for n in one.successors] == ["3"]
    # A road that is not there is what a map cut out of a larger one names.
    severity = "warning" if "77" in bad else "error"
    assert [row[0] for row in told(network, "connection") + told(network, "laneLink")] == [severity]


def test_one_malformed_road_among_three() -> None:
    text = joined_map().replace('hdg="0" length="20"', 'hdg="north" length="20"')
    xodr = read_opendrive(text.encode())
    assert [road.id for road in xodr.roads] == ["1", "2"]
    (note,) = [n for n in xodr.notes if n.severity == "error"]
    assert '<road id="3"> is left out' in note.message
    with pytest.raises(MapError, match="no road can be used"):
        read_opendrive(ring_map(length=1.0).replace("<line/>", "<bend/>").encode())


def test_a_road_at_the_other_end_of_the_world_is_left_out() -> None:
    xodr = read_opendrive(joined_map().replace('x="120" y="0"', 'x="900000" y="0"').encode())
    assert [road.id for road in xodr.roads] == ["1", "3"]


@pytest.mark.parametrize("text", [joined_map(lanes=lane(-1, link="")), joined_map(connection=" ")])
def test_lanes_that_only_meet_are_joined(text: str) -> None:
    """No lane of the connecting road names one of the next road: the only one that it meets is taken."""
    network = build_network(text.encode())
    first, last, through = (next(n for n in network.lanes if n.road_id == k) for k in "123")
    assert (first.successors, through.successors) == ((through.index,), (last.index,))
    assert (last.predecessors, through.predecessors) == ((through.index,), (first.index,))
    taken = [row for row in told(network, "lane") if "which is taken" in row[1]]
    assert taken == [] if "<connection" not in text else taken[0][0] == "warning"


def test_lanes_are_not_joined_where_links_part_them() -> None:
    """Two lanes side by side of which one is linked: the other ends on purpose."""
    own = lane(-1) + lane(-2, link="")
    text = joined_map(lanes=own).replace("<center><lane", "<center><lane", 1)
    text = text.replace(lane(-1, link=""), lane(-1, link="") + lane(-2, link=""))
    network = build_network(text.encode())
    outer = next(n for n in network.lanes if (n.road_id, n.lane_id) == ("3", -2))
    assert outer.successors == ()


def test_a_junction_may_share_its_id_with_a_road() -> None:
    network = build_network(joined_map(junction_id="2").encode())
    found = report(network.xodr, network)
    assert found.errors == ()
    assert any("shares its id" in p.message for p in found.problems)
