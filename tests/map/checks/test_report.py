"""Faults put into a sound map are found, at their line."""

import csv
import math
import pathlib
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from scipy.integrate import quad
from shared_fixtures.worlds.maps import CROSSING, VILLAGE, carla_map
from shared_fixtures.worlds.plain_maps import PlainMap, PlainRoad

from carlaloc_env.map.checks.report import MapReport, check_map, grouped, write_waypoints_csv
from carlaloc_env.map.checks.roads import Problem
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.sources import known_towns

TEXT = CROSSING.read_text(encoding="utf-8")


def check(tmp_path: pathlib.Path, text: str) -> MapReport:
    path = tmp_path / "map.xodr"
    path.write_text(text, encoding="utf-8")
    return check_map(path)


def test_sound_parts_are_not_accused() -> None:
    """Roads that simply end are no errors."""
    found = check_map(CROSSING)
    assert found.errors == ()
    assert "is a dead end: no lane follows" in {p.message for p in found.problems}
    assert (found.roads, found.junctions, found.signals, found.crosswalks) == (16, 1, 4, 4)


@pytest.mark.parametrize(
    ("old", "new", "element", "part"),
    [
        ('<geometry s="20.0" x="32.0"', '<geometry s="20.0" x="32.5"', "geometry", "starts 0.5 m"),
        ('<geometry s="20.0" x="32.0"', '<geometry s="21.0" x="32.0"', "geometry", "the piece before ends"),
        ('length="70.0" id="1"', 'length="71.0" id="1"', "road", "adds up to 70"),
        ('<laneLink from="1" to="-1"/>', '<laneLink from="1" to="-2"/>', "connection", "does not lead onto"),
        ('<link><predecessor id="1"/></link>', "", "lane", "does not link back"),
        ('<predecessor id="1"/><successor id="-1"/>', "", "connection", "does not link back"),
        (
            'elementType="junction" elementId="100"',
            'elementType="junction" elementId="7"',
            "road",
            "junction 7",
        ),
        ('connectingRoad="1012"', 'connectingRoad="9"', "connection", "road 9, which does not exist"),
        ('<width sOffset="0" a="3.5"', '<width sOffset="0" a="-1"', "lane", "width falls to -1"),
        ('<width sOffset="0" a="3.5"', '<width sOffset="2" a="3.5"', "width", "begin at 0"),
        ('signalId="103"', 'signalId="999"', "controller", "signal 999"),
        ('<signalReference id="101"', '<signalReference id="77"', "signalReference", "does not exist"),
        ('<signal id="102"', '<signal id="101"', "signal", "share this id"),
        ('curvature="0.02"', 'curvature="0"', "arc", "NaN"),
        ('curvEnd="0.02"', 'curvEnd="0.0"', "spiral", "NaN"),
        ('<object id="31"', '<object id="31" s="900" name2="', "object", "lies beyond road 1"),
        ('a="0" b="0" c="0.001" d="0"/>', 'a="0" b="0.3" c="0.001" d="0"/>', "lane", "grade reaches"),
    ],
)
def test_fault_is_found(tmp_path: pathlib.Path, old: str, new: str, element: str, part: str) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    if 'name2="' in new:
        text = TEXT.replace('type="crosswalk" s="3"', 'type="crosswalk" s="900"', 1)
        old = 'type="crosswalk" s="3"'
    line = TEXT.count("\n", 0, TEXT.index(old)) + 1
    found = [p for p in check(tmp_path, text).problems if p.element == element and part in p.message]
    assert found
    # A connection is told at its own line, wherever the lane stands that does not answer.
    assert element == "connection" or min(abs(p.line - line) for p in found) <= 12
    assert "\n" not in str(found[0])


@pytest.mark.parametrize("town", known_towns())
def test_our_towns_have_no_problems(town: str) -> None:
    """Not even warnings, but for bridges over water, and marks over which cars change lanes all the same."""
    assert {problem.element for problem in check_map(known_towns()[town]).problems} <= {"bridge", "roadMark"}


def test_no_driving_lane_is_an_error(tmp_path: pathlib.Path) -> None:
    found = check(tmp_path, TEXT.replace('type="driving"', 'type="restricted"'))
    assert any("no lane is of type driving" in p.message and "restricted" in p.message for p in found.errors)


def test_a_map_cut_out_of_a_larger_one_has_no_errors(tmp_path: pathlib.Path) -> None:
    """Its roads name others that are not there, and so do its signals and controllers."""
    text = TEXT.replace('signalId="103"', 'signalId="999"').replace(
        'connectingRoad="1012"', 'connectingRoad="9"'
    )
    text = text.replace('<signalReference id="101"', '<signalReference id="77"')
    found = check(tmp_path, text)
    assert sum("does not exist" in problem.message for problem in found.problems) >= 3
    assert found.errors == ()


def test_problems_of_one_kind_are_grouped() -> None:
    """Numbers and names apart; severities and elements stay apart."""
    rows = [("warning", "lane", 3, "step 0.1 m to road 7"), ("warning", "lane", 5, "step 2e-3 m to road 12b")]
    rows += [("error", "lane", 6, "step 3 m to road 7"), ("warning", "lane", 7, "is a dead end")]
    problems = [Problem(severity=s, element=e, id="", line=n, message=m) for s, e, n, m in rows]
    assert [(p.line, n) for p, n in grouped(problems)] == [(3, 2), (6, 1), (7, 1)]


def two_roads(rise_m: float) -> str:
    """A road east and a road north that cross at (50, 0), the second `rise_m` higher."""
    roads = ""
    for n, (x, y, hdg, z) in enumerate(((0, 0, 0, 0), (50, -50, np.pi / 2, rise_m)), start=1):
        roads += (
            f'<road id="{n}" length="100" junction="-1"><planView>'
            f'<geometry s="0" x="{x}" y="{y}" hdg="{hdg}" length="100"><line/></geometry></planView>'
            f'<elevationProfile><elevation s="0" a="{z}" b="0" c="0" d="0"/></elevationProfile>'
            '<lanes><laneSection s="0"><center><lane id="0"/></center><right><lane id="-1" type="driving">'
            '<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road>'
        )
    return f'<OpenDRIVE><header revMajor="1" revMinor="7"/>{roads}</OpenDRIVE>'


@pytest.mark.parametrize(("rise_m", "bad"), [(0.0, True), (3.0, True), (6.3, False)])
def test_crossing_roads_need_clearance(tmp_path: pathlib.Path, rise_m: float, bad: bool) -> None:
    found = [p for p in check(tmp_path, two_roads(rise_m)).problems if "crosses road" in p.message]
    assert bool(found) == bad


def test_curve_of_another_length_is_named(tmp_path: pathlib.Path) -> None:
    shape = '<paramPoly3 pRange="normalized" aU="0" bU="100" cU="0" dU="0" aV="0" bV="0" cV="9" dV="0"/>'
    length = quad(lambda p: math.hypot(100.0, 18.0 * p), 0.0, 1.0)[0]
    text = two_roads(6.3).replace("<line/>", shape, 1)
    assert any(f"its curve has {length:.6f}" in p.message for p in check(tmp_path, text).problems)


@pytest.mark.parametrize(
    ("path", "lane_km", "junction_lane_km", "junctions", "errors"),
    [carla_map("Town01", 4.96 + 1.44, 1.44, 12, 0), carla_map("Town07", 4.47 + 2.68, 2.68, 31, 1)],
)
def test_carla_maps(
    path: pathlib.Path, lane_km: float, junction_lane_km: float, junctions: int, errors: int
) -> None:
    """Lane kilometres and junctions as measured by others; the one broken link of Town07 is known."""
    found = check_map(path)
    assert found.lane_km == pytest.approx(lane_km, abs=0.02)
    assert found.junction_lane_km == pytest.approx(junction_lane_km, abs=0.02)
    assert found.junctions == junctions
    assert len(found.errors) == errors


def test_lengths_of_a_village() -> None:
    """Lane kilometres are the sums of chords between points that plain formulas give."""
    found = check_map(VILLAGE)
    root = ElementTree.parse(VILLAGE).getroot()
    plain = PlainMap(root, {road.get("id", ""): PlainRoad(road) for road in root.findall("road")})
    length_m: dict[bool, float] = {True: 0.0, False: 0.0}
    for name, section, lane in plain.driving():
        road = plain.roads[name]
        line = np.array([road.lane(section, lane, s).position for s in np.linspace(0.0, road.length, 400)])
        length_m[road.junction != "-1"] += np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert found.junction_lane_km == pytest.approx(length_m[True] / 1e3, rel=1e-4)
    assert found.lane_km == pytest.approx(sum(length_m.values()) / 1e3, rel=1e-4)
    assert (found.junctions, found.errors) == (2, ())


def test_waypoints_csv(tmp_path: pathlib.Path) -> None:
    """The columns that users rely on, and the values of the network."""
    network = build_network(CROSSING)
    path = tmp_path / "waypoints.csv"
    count = write_waypoints_csv(network, 2.0, path)
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == count
    assert list(rows[0]) == ["road_id", "section", "lane_id", "s", "x", "y", "z", "heading"]
    lane = next(n for n in network.lanes if (n.road_id, n.lane_id) == ("1", 1))
    row = next(
        r for r in rows if (r["road_id"], r["lane_id"]) == ("1", "1") and abs(float(r["s"]) - 40.0) < 1e-6
    )
    pose = network.exact_pose([lane.index], network.station_m([lane.index], [40.0]))
    assert [float(row[k]) for k in "xyz"] == pytest.approx(pose.position_m[0].tolist(), abs=1e-6)
    assert float(row["heading"]) == pytest.approx(pose.heading_rad[0], abs=1e-6)
    assert list(tmp_path.iterdir()) == [path]
