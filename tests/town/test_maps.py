"""Our own towns against the rules of a drivable map, read here from the XML by independent formulas."""

import itertools
import math
import pathlib
import xml.etree.ElementTree as ElementTree
from collections import defaultdict

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shared_fixtures.worlds.plain_maps import PlainMap, PlainRoad, active, poly

ROOT = pathlib.Path(__file__).parents[2]


MAPS = sorted((ROOT / "maps").glob("*/town.xodr"))


@pytest.fixture(scope="module", params=MAPS, ids=[path.parent.name for path in MAPS])
def path(request: pytest.FixtureRequest) -> pathlib.Path:
    found: pathlib.Path = request.param
    return found


@pytest.fixture(scope="module")
def plain(path: pathlib.Path) -> PlainMap:
    root = ElementTree.parse(path).getroot()
    return PlainMap(root, {road.get("id", ""): PlainRoad(road) for road in root.findall("road")})


def test_numbers_are_disjoint_and_never_zero(plain: PlainMap) -> None:
    """carla.Map confuses a junction with a road of the same number, and 0 with a missing link."""
    roads, junctions = set(plain.roads), {j.get("id") for j in plain.root.findall("junction")}
    assert not roads & junctions
    assert "0" not in roads | junctions
    assert len(roads) == len(plain.root.findall("road"))
    signals = [s.get("id") for s in plain.root.iter("signal")]
    assert len(signals) == len(set(signals))


def test_reference_lines_have_no_gap_or_kink(plain: PlainMap) -> None:
    for road_id, road in plain.roads.items():
        pieces = road.xml.findall("planView/geometry")
        assert sum(float(g.get("length", "nan")) for g in pieces) == pytest.approx(road.length, abs=1e-9)
        for before, after in itertools.pairwise(pieces):
            s = float(after.get("s", "nan"))
            single = ElementTree.Element("road", road.xml.attrib)
            ElementTree.SubElement(single, "planView").append(before)
            x, y, h, k = PlainRoad(single).line(s)
            _, _, h1, k1 = road.line(s)
            gap = math.hypot(x - float(after.get("x", "nan")), y - float(after.get("y", "nan")))
            assert gap < 1e-6, road_id
            assert abs(math.remainder(h - h1, math.tau)) < 1e-6, road_id
            assert abs(k - k1) < 1e-6, road_id


def test_records_start_at_zero_and_ascend(plain: PlainMap) -> None:
    for road_id, road in plain.roads.items():
        for where in ("planView/geometry", "elevationProfile/elevation", "lanes/laneSection"):
            stations = [float(r.get("s", "nan")) for r in road.xml.findall(where)]
            assert stations[0] == 0.0
            assert all(a < b for a, b in itertools.pairwise(stations)), (road_id, where)
            assert stations[-1] < road.length
        for k, section in enumerate(road.sections):
            start, end = road.section_span(k)
            for lane in section.iter("lane"):
                if lane.get("id") != "0":
                    widths = lane.findall("width")
                    assert float(widths[0].get("sOffset", "nan")) == 0.0
                    for ds in np.linspace(0.0, end - start, 20):
                        record = active(widths, float(ds), "sOffset")
                        assert record is not None
                        assert poly(*record)[0] > -1e-9, road_id


def test_lanes_meet_in_place_heading_height_and_width(plain: PlainMap) -> None:
    for key, following in plain.successors().items():
        a = plain.lane_end(key, last=True)
        for other in following:
            b = plain.lane_end(other, last=False)
            assert np.hypot(*(a.position - b.position)[:2]) < 1e-3, (key, other)
            assert abs(a.position[2] - b.position[2]) < 1e-3, (key, other)
            assert abs(math.remainder(a.heading - b.heading, math.tau)) < 1e-3, (key, other)
            assert abs(a.width - b.width) < 1e-3, (key, other)
            assert abs(a.slope - b.slope) < 0.01, (key, other)
            assert abs(a.curvature - b.curvature) < 0.01, (key, other)


def test_links_are_mutual(plain: PlainMap) -> None:
    """Whoever a connecting road names as its neighbour leads into it or is led into by it."""
    following = plain.successors()
    for key in following:
        road = plain.roads[key[0]]
        if road.junction == "-1":
            continue
        lane = road.sections[0].find(f".//lane[@id='{key[2]}']")
        end, link = road.xml.find("link/predecessor"), lane.find("link/predecessor")  # type: ignore[union-attr]
        assert end is not None
        assert link is not None
        source = plain.roads[end.get("elementId", "")]
        at = len(source.sections) - 1 if end.get("contactPoint") == "end" else 0
        assert key in following[end.get("elementId", ""), at, int(link.get("id", "0"))]


def test_every_lane_leads_on_and_all_reach_all(plain: PlainMap) -> None:
    """Closed network; pockets are reached, and lanes that taper to nothing are left, by a change only."""
    scipy_graph = pytest.importorskip("scipy.sparse.csgraph")
    sparse = pytest.importorskip("scipy.sparse")
    following = plain.successors()
    number = {key: n for n, key in enumerate(following)}
    edges = [(number[a], number[b]) for a, bs in following.items() for b in bs]
    for key, after in following.items():
        assert after or plain.lane_end(key, last=True).width < 1e-6, key
    for road_id, k, lane_id in following:
        for beside in (lane_id - 1, lane_id + 1):
            if beside * lane_id > 0 and (road_id, k, beside) in number:
                edges.append((number[road_id, k, lane_id], number[road_id, k, beside]))
    rows, columns = zip(*edges, strict=True)
    graph = sparse.coo_matrix((np.ones(len(edges)), (rows, columns)), shape=(len(number), len(number)))
    count, _ = scipy_graph.connected_components(graph, connection="strong")
    assert count == 1


def test_slopes_and_vertical_curves_are_drivable(plain: PlainMap) -> None:
    """Grade at most 8 %, vertical acceleration below 0.3 m/s².

    That is at the speed limit, or in bends at the speed that asks 3 m/s² sideways: a road that turns on a
    sloping plane has a vertical curve, too.
    """
    for road_id, road in plain.roads.items():
        limit = float(road.xml.find("type/speed").get("max", "nan")) / 3.6  # type: ignore[union-attr]
        for s in np.arange(0.0, road.length, 1.0):
            record = active(road.xml.findall("elevationProfile/elevation"), float(s))
            assert record is not None
            _, slope, bend = poly(*record)
            turn = abs(road.line(float(s))[3]) if abs(bend) * limit**2 > 0.3 else 0.0
            assert abs(slope) < 0.0801, road_id
            assert abs(bend) * min(limit**2, 3.0 / max(turn, 1e-9)) < 0.3, road_id


def test_lanes_are_wide_enough_to_turn(plain: PlainMap) -> None:
    """No lane centre bends tighter than 6 m."""
    for road_id, k, lane_id in plain.driving():
        road = plain.roads[road_id]
        start, end = road.section_span(k)
        for s in np.linspace(start, end - 1e-6, 9):
            assert abs(road.lane(k, lane_id, float(s)).curvature) < 1 / 6.0, (road_id, lane_id)


@pytest.mark.long
def test_roads_cross_only_with_headroom(plain: PlainMap) -> None:
    """Lane centres of plain roads closer than 4 m in the plan are 4.5 m apart in height."""
    points, owner = [], []
    for road_id, k, lane_id in plain.driving():
        road = plain.roads[road_id]
        if road.junction != "-1":
            continue
        start, end = road.section_span(k)
        for s in np.arange(start + 0.5, end - 0.5, 2.0):
            points.append(road.lane(k, lane_id, float(s)).position)
            owner.append(road_id)
    found = np.array(points)
    for i, j in cKDTree(found[:, :2]).query_pairs(4.0):
        if owner[i] != owner[j]:
            assert abs(found[i, 2] - found[j, 2]) > 4.5, (owner[i], owner[j], found[i])


def test_every_lane_at_lights_belongs_to_one_group(plain: PlainMap) -> None:
    """Conflicting movements never share a phase, permissive left turns apart."""
    group_of = {
        control.get("signalId"): controller.get("id")
        for controller in plain.root.findall("controller")
        for control in controller.findall("control")
    }
    heads: dict[tuple[str, int], list[str]] = defaultdict(list)
    for road_id, road in plain.roads.items():
        for signal in road.xml.findall("signals/signal[@dynamic='yes']"):
            for valid in signal.findall("validity"):
                ids = range(int(valid.get("fromLane", "0")), int(valid.get("toLane", "0")) + 1)
                for lane_id in ids:
                    heads[road_id, lane_id].append(signal.get("id", ""))
    seen = 0
    for junction in plain.root.findall("junction"):
        phase = {c.get("id"): c.get("sequence") for c in junction.findall("controller")}
        if not phase:
            continue
        paths = []
        for connection in junction.findall("connection"):
            for pair in connection.findall("laneLink"):
                key = (connection.get("incomingRoad", ""), int(pair.get("from", "0")))
                assert len(heads[key]) == 1, key
                road = plain.roads[connection.get("connectingRoad", "")]
                centre = [road.lane(0, int(pair.get("to", "0")), s) for s in np.linspace(0, road.length, 30)]
                turn = math.remainder(centre[-1].heading - centre[0].heading, math.tau)
                line = np.array([end.position[:2] for end in centre])
                paths.append((key[0], phase[group_of[heads[key][0]]], turn, line))
        for a, b in itertools.combinations(paths, 2):
            seen += a[0] != b[0]
            if a[0] != b[0] and a[1] == b[1]:
                near = cKDTree(a[3]).query(b[3])[0].min() < 1.5
                assert not near or max(a[2], b[2]) > 0.7, (junction.get("name"), a[0], b[0])
    assert seen > 0 or not heads


@pytest.mark.long
def test_carla_reads_the_same_map(path: pathlib.Path, plain: PlainMap) -> None:
    """carla.Map: no NaN, as many lanes, and its waypoints on our lane centres."""
    carla = pytest.importorskip("carla")
    town = carla.Map(path.parent.name, path.read_text(encoding="utf-8"))
    waypoints = town.generate_waypoints(1.0)
    assert {(str(w.road_id), w.section_id, w.lane_id) for w in waypoints} == set(plain.driving())
    for w in waypoints[::71]:
        key = (str(w.road_id), w.section_id, w.lane_id)
        here = plain.roads[key[0]].lane(key[1], key[2], w.s).position
        at = w.transform.location
        assert np.allclose([at.x, -at.y, at.z], here, atol=1e-3), key
    following = plain.successors()
    ends = [(str(b.road_id), b.section_id, b.lane_id) for _, b in town.get_topology()]
    # A lane without successor leads, for CARLA, to whatever bears its id in the next section: a shoulder.
    assert sum(end in following for end in ends) == sum(len(v) for v in following.values())
    outlines = plain.root.findall(".//object[@type='crosswalk']/outline")
    assert len(town.get_crosswalks()) == sum(len(o) for o in outlines)
