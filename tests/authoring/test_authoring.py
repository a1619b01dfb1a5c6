"""The map writer: curves against numerical integration, plans of odd shapes, same bytes."""

import math
import pathlib
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from carlaloc_env.core.files.array_files import arrays_hash
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.network_arrays import to_arrays
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.opendrive.records import LaneRecord
from carlaloc_env.map.opendrive.reference_line import clothoid

ROOT = pathlib.Path(__file__).parents[2]
TOWNS = sorted(p.parent.name for p in (ROOT / "maps").glob("*/town.xodr"))


def tool(name: str) -> ModuleType:
    """A module that writes maps."""
    import importlib

    return importlib.import_module(f"carlaloc_env.{name}")


def walked(path: Any) -> tuple[float, float, float]:
    """End of a path by adaptive quadrature of its curvature."""
    x, y, h = path.start.x, path.start.y, path.start.h
    for piece in path.pieces:
        rate = (piece.k1 - piece.k0) / piece.length

        def theta(s: float, h: float = h, k: float = piece.k0, rate: float = rate) -> float:
            return h + s * (k + 0.5 * rate * s)

        x += quad(lambda s: math.cos(theta(s)), 0, piece.length, epsabs=1e-12)[0]
        y += quad(lambda s: math.sin(theta(s)), 0, piece.length, epsabs=1e-12)[0]
        h = theta(piece.length)
    return x, y, h


def assert_continuous(path: Any) -> None:
    """Curvature has no jump between the pieces."""
    for before, after in zip(path.pieces, path.pieces[1:], strict=False):
        assert before.k1 == pytest.approx(after.k0, abs=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    turn=st.floats(0.1, 2.6),
    first=st.floats(5, 60),
    second=st.floats(5, 60),
    left=st.booleans(),
    h=st.floats(-3, 3),
)
def test_a_corner_joins_two_straights(turn: float, first: float, second: float, left: bool, h: float) -> None:
    curves = tool("authoring.geometry.plan_view_curves")
    delta = turn if left else -turn
    start = curves.Pose(3.0, -7.0, h)
    bend = start.ahead(first)
    end = curves.Pose(bend.x, bend.y, h + delta).ahead(second)
    path = curves.curve_between(start, end)
    assert_continuous(path)
    assert path.pieces[0].k0 == path.pieces[-1].k1 == 0.0
    assert walked(path) == pytest.approx((end.x, end.y, end.h), abs=1e-8)


@settings(max_examples=30, deadline=None)
@given(ahead=st.floats(15, 80), aside=st.floats(-3.5, 3.5).filter(lambda v: abs(v) > 1e-3))
def test_a_shift_ends_beside_its_start(ahead: float, aside: float) -> None:
    curves = tool("authoring.geometry.plan_view_curves")
    path = curves.curve_between(curves.Pose(0.0, 0.0, 0.0), curves.Pose(ahead, aside, 0.0))
    assert_continuous(path)
    assert walked(path) == pytest.approx((ahead, aside, 0.0), abs=1e-8)


@settings(max_examples=40, deadline=None)
@given(k0=st.floats(-0.2, 0.2), k1=st.floats(-0.2, 0.2), length=st.floats(1.0, 90.0))
def test_clothoids_are_written_as_they_are_read(k0: float, k1: float, length: float) -> None:
    """The writer's curve and the reader's end at the same point; their sums run in another order."""
    curves = tool("authoring.geometry.plan_view_curves")
    tip = curves.Piece(length, k0, k1).end(curves.Pose(0.0, 0.0, 0.0))
    rate = np.array([(k1 - k0) / length])
    u, v, turn = clothoid(np.array([k0]), rate, np.array([length]))
    assert (tip.x, tip.y, tip.h) == pytest.approx((u[0], v[0], turn[0]), abs=1e-12 * length)


def test_names_are_escaped_as_xml_asks() -> None:
    """A name of odd characters comes back from the file."""
    town = odd_town()
    town.name, town.projection = 'Bäcker & "Söhne" <1>', "+proj=tmerc & <x>"
    root = ElementTree.fromstring(tool("maps.plans.authoring.builder").Builder(town).build())
    header = root.find("header")
    assert header is not None
    assert header.attrib["name"] == town.name
    assert header.findtext("geoReference") == town.projection


def test_a_bend_that_no_clothoid_fits_becomes_a_cubic_of_true_length() -> None:
    curves = tool("authoring.geometry.plan_view_curves")
    path = curves.curve_between(curves.Pose(0.0, 0.0, 0.0), curves.Pose(10.0, 20.0, -0.6))
    (piece,) = path.pieces
    bu, cu, du, bv, cv, dv = piece.cubic

    def speed(p: float) -> float:
        return math.hypot(bu + 2 * cu * p + 3 * du * p * p, bv + 2 * cv * p + 3 * dv * p * p)

    assert piece.length == pytest.approx(quad(speed, 0, 1)[0], abs=1e-9)
    end = path.end
    assert (end.x, end.y, end.h) == pytest.approx((10.0, 20.0, -0.6), abs=1e-9)


def test_entry_and_exit_of_a_roundabout_meet_the_ring() -> None:
    curves, shapes = tool("authoring.geometry.plan_view_curves"), tool("maps.plans.authoring.roundabouts")
    shape = shapes.RoundaboutShape()
    angle, k = math.pi + shape.half_angle_rad, 1 / shape.island_m
    ring = curves.Pose(
        shape.island_m * math.cos(angle), shape.island_m * math.sin(angle), angle + math.pi / 2
    )
    start = curves.Pose(-shape.arm_m, -1.5, 0.0)
    plans = tool("maps.plans.authoring.curves")
    entry = plans.ring_entry(start, ring, k, shape.first_spiral_m, shape.last_spiral_m)
    assert_continuous(entry)
    assert entry.pieces[-1].k1 == pytest.approx(k)
    x, y, h = walked(entry)
    assert (x, y) == pytest.approx((ring.x, ring.y), abs=1e-8)
    assert math.remainder(h - ring.h, math.tau) == pytest.approx(0.0, abs=1e-8)
    leaving = plans.mirrored(entry, curves.Pose(0.0, 0.0, math.pi))
    x, y, h = walked(leaving)
    assert (x, y) == pytest.approx((-shape.arm_m, 1.5), abs=1e-8)
    assert math.remainder(h - math.pi, math.tau) == pytest.approx(0.0, abs=1e-8)
    assert (leaving.start.x, leaving.start.y) == pytest.approx((ring.x, -ring.y), abs=1e-8)


def test_a_bulb_returns_beside_its_start() -> None:
    curves = tool("authoring.geometry.plan_view_curves")
    path = curves.turning_bulb(curves.Pose(2.0, 1.0, 0.5), 8.5, 16.0, 4.0)
    assert_continuous(path)
    x, y, h = walked(path)
    assert (x, y) == pytest.approx((2.0, 1.0), abs=1e-8)
    assert h - 0.5 == pytest.approx(math.pi, abs=1e-8)


def test_vertical_curves_are_smooth_and_pass_the_grades() -> None:
    """A dip to −6 m: level ends, both grades, the lowest point where it was asked for."""
    profiles = tool("maps.plans.authoring.profiles")
    spec = profiles.Dip(bottom_m=-6.0, grade=0.078, k_m=4.2, x=0.0, y=0.0)
    records = profiles.dip(0.0, 0.0, 230.0, spec, 113.0)

    def at(s: float) -> np.ndarray:
        start, a, b, c, d = max((r for r in records if r[0] <= s), key=lambda r: r[0])
        u = s - start
        return np.array([a + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * u * d), 2 * c + 6 * u * d])

    for start, *_ in records[1:]:
        assert at(start - 1e-9)[:2] == pytest.approx(at(start)[:2], abs=1e-7)
    slopes = np.array([at(s)[1] for s in np.arange(0.0, 230.0, 0.5)])
    assert slopes.min() == pytest.approx(-0.078)
    assert slopes.max() == pytest.approx(0.078)
    assert at(113.0)[:2] == pytest.approx([-6.0, 0.0], abs=1e-9)
    assert at(0.0)[:2] == pytest.approx([0.0, 0.0])
    assert at(230.0)[:2] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_width_change_has_no_curvature_jump() -> None:
    sections = tool("authoring.elements.cross_sections")
    records = sections.blend(3.5, 4.6, 22.0)
    ds = np.linspace(0.0, 22.0, 4401)
    w = np.array([sections.value_at(records, float(v)) for v in ds])
    bend = np.gradient(np.gradient(w, ds), ds)
    assert w[0] == pytest.approx(3.5)
    assert w[-1] == pytest.approx(4.6)
    assert np.abs(np.diff(bend[2:-2])).max() < 1e-4
    assert abs(bend[3]) < 1e-4
    assert abs(bend[-4]) < 1e-4


def odd_town() -> Any:
    """Five roads at uneven angles, a skew T, a lane drop and a roundabout of three arms."""
    plan, cross = tool("maps.plans.authoring.plan"), tool("authoring.elements.cross_sections").CrossSection
    wide, narrow = cross(lanes=2, median_m=3.0), cross(lanes=1, lane_m=3.2, sidewalk_m=2.0)
    town = plan.TownPlan(name="odd", projection="+proj=tmerc +lat_0=0 +lon_0=0")
    town.node("star", 0.0, 0.0, corner_m=12.0)
    town.node(
        "ring", 220.0, 0.0, roundabout=tool("maps.plans.authoring.roundabouts").RoundaboutShape(arm_m=46.0)
    )
    town.node("skew", 40.0, 170.0, control="stop")
    for name, x, y in (("a", -120.0, 60.0), ("b", -120.0, -70.0), ("c", 60.0, -120.0), ("d", 30.0, 290.0)):
        town.node(name, x, y, control="bulb")
    town.node("e", 220.0, -150.0, control="bulb")
    town.road("to ring", "star", "ring", wide, 50, ends=("pocket", "plain"))
    town.road("to skew", "star", "skew", narrow, 30)
    town.road("to d", "skew", "d", narrow, 30)
    town.road("over", "skew", "ring", wide, 40, bends=((220.0, 130.0, 30.0, 12.0),))
    town.road("to e", "ring", "e", narrow, 30)
    town.road("to a", "star", "a", narrow, 30)
    town.road("to b", "star", "b", narrow, 30)
    town.road("to c", "star", "c", narrow, 30)
    return town


@pytest.mark.long
def test_an_odd_town_is_a_whole_network() -> None:
    """carla.Map finds every driving lane of a town with uneven junctions connected at both ends."""
    carla = pytest.importorskip("carla")
    text = tool("maps.plans.authoring.builder").Builder(odd_town()).build()
    root = ElementTree.fromstring(text)
    assert root.find("header") is not None
    town = carla.Map("odd", text)
    locations = [w.transform.location for w in town.generate_waypoints(2.0)]
    assert all(math.isfinite(p.x) and math.isfinite(p.y) for p in locations)
    edges = {((a.road_id, a.lane_id), (b.road_id, b.lane_id)) for a, b in town.get_topology()}
    starts, ends = {a for a, _ in edges}, {b for _, b in edges}
    ring_roads = {(w.road_id, w.lane_id) for w in town.generate_waypoints(5.0)}
    assert ring_roads <= starts
    assert len(ring_roads - ends) <= 2
    for a, b in town.get_topology():
        end = a.next_until_lane_end(0.25)
        if end and a.road_id != b.road_id:
            gap = end[-1].transform.location.distance(b.transform.location)
            assert gap < 0.3, (a, b)


def test_impossible_plans_say_what_does_not_fit() -> None:
    plan, cross = tool("maps.plans.authoring.plan"), tool("authoring.elements.cross_sections").CrossSection
    error = tool("authoring.geometry.newton").PlanError
    town = plan.TownPlan(name="x", projection="")
    town.node("a", 0.0, 0.0)
    town.node("b", 60.0, 0.0)
    town.road("r", "a", "c", cross(lanes=1), 50)
    with pytest.raises(error, match="'c'"):
        tool("maps.plans.authoring.builder").Builder(town).build()
    town.roads[0].b = "b"
    town.roads[0].ends = ("pocket", "pocket")
    with pytest.raises(error, match="no room for its pockets"):
        tool("maps.plans.authoring.builder").Builder(town).build()
    town.roads[0].ends = ("plain", "plain")
    town.roads[0].bends = ((30.0, 2.0, 500.0, 10.0),)
    with pytest.raises(error, match="overlap"):
        tool("maps.plans.authoring.builder").Builder(town).build()


@pytest.mark.parametrize("name", TOWNS)
def test_the_file_is_what_the_plan_writes(name: str) -> None:
    """The same bytes again, in a fresh process with another hash seed."""
    code = f"import sys; from maps.plans.build import town_text; sys.stdout.write(town_text({name!r}))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, check=True, env={"PYTHONHASHSEED": "7"}
    )
    assert done.stdout == (ROOT / "maps" / name / "town.xodr").read_bytes()


@pytest.mark.parametrize("name", TOWNS)
def test_lines_beside_lanes_that_open_or_close_are_broken(name: str) -> None:
    """Cars enter and leave a lane there; the line is solid where the lane is whole and a junction is near."""

    def opens(lane: LaneRecord) -> bool:
        return any(record.b or record.c or record.d for record in lane.widths)

    xodr = read_opendrive(ROOT / "maps" / name / "town.xodr")
    for road in xodr.roads:
        for section in road.sections if road.junction_id is None else ():
            for lane in section.lanes:
                outer = section.lane(lane.id + (1 if lane.id > 0 else -1)) if lane.id else None
                if outer is None or not lane.type == outer.type == "driving":
                    continue
                solid = [mark for mark in lane.road_marks if mark.lane_change != "both"]
                assert not solid or not (opens(lane) or opens(outer)), (road.id, lane.id, section.s_m)


def test_marks_bear_on_no_drive() -> None:
    """Without any mark, Town03's lanes, signals and routes are the same to the last bit."""
    text = (ROOT / "maps" / "Town03" / "town.xodr").read_text(encoding="utf-8")
    bare = re.sub(r"<roadMark\b[^>]*?(/>|>.*?</roadMark>)", "", text, flags=re.DOTALL)
    assert bare != text
    hashes = {arrays_hash(to_arrays(build_network(read_opendrive(t.encode())))) for t in (text, bare)}
    assert len(hashes) == 1
