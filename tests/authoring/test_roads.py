"""What plans make motorways of: cut and parallel paths, ramps' profiles, extra lanes, exits and merges."""

import importlib
import math
import xml.etree.ElementTree as ElementTree
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st


def tool(name: str) -> ModuleType:
    """A module that writes maps."""
    return importlib.import_module(f"carlaloc_env.{name}")


def bent_road() -> Any:
    """A road with a straight, a clothoid, an arc and a clothoid back, twice."""
    return tool("maps.plans.authoring.curves").fillet(
        [(0, 0), (200, 0), (260, 150), (400, 160)], [(60, 30), (80, 20)]
    )


@settings(max_examples=30, deadline=None)
@given(first=st.floats(0, 300), length=st.floats(0.5, 80), along=st.floats(0, 1))
def test_a_cut_runs_along_the_whole(first: float, length: float, along: float) -> None:
    paths, road = tool("maps.plans.authoring.curves"), bent_road()
    assume(first + length < road.length)
    part = paths.cut(road, first, first + length)
    assert part.length == pytest.approx(length, abs=1e-9)
    here, there = part.at(along * length), road.at(first + along * length)
    assert (here.x, here.y, here.h) == pytest.approx((there.x, there.y, there.h), abs=1e-9)
    curvature = tool("authoring.geometry.plan_view_curves").curvature
    assert curvature(part, along * length) == pytest.approx(curvature(road, first + along * length), abs=1e-9)


def test_a_loop_is_cut_across_its_start() -> None:
    paths = tool("maps.plans.authoring.curves")
    square = paths.fillet([(50, 0), (100, 0), (100, 100), (0, 100), (0, 0), (50, 0)], [(20, 10)] * 4)
    part = paths.cut(square, square.length - 10, square.length + 15, closed=True)
    assert len(part.pieces) == 1  # both ends of the loop lie on one straight
    assert (part.start.x, part.end.x) == pytest.approx((40, 65))


@settings(max_examples=20, deadline=None)
@given(right=st.floats(-15, 15).filter(lambda v: abs(v) > 1.0), at=st.floats(0, 1))
def test_parallels_keep_their_distance(right: float, at: float) -> None:
    curves, paths = tool("authoring.geometry.plan_view_curves"), tool("maps.plans.authoring.curves")
    path = curves.Path(
        curves.Pose(3, 4, 0.5), (curves.Piece(30), curves.Piece(50, 1 / 40, 1 / 40), curves.Piece(20))
    )
    beside = paths.shifted(path, right)
    for near, off in zip(path.starts(), beside.starts(), strict=True):
        there = near.ahead(0.0, -right)
        assert (off.x, off.y) == pytest.approx((there.x, there.y), abs=1e-9)
    pose = beside.at(at * beside.length)
    dense = [path.at(path.length * k / 4000) for k in range(4001)]
    gap = min(math.hypot(pose.x - p.x, pose.y - p.y) for p in dense)
    assert gap == pytest.approx(abs(right), abs=1e-3)


def test_parallels_of_clothoids_are_refused() -> None:
    curves, paths = tool("authoring.geometry.plan_view_curves"), tool("maps.plans.authoring.curves")
    with pytest.raises(tool("authoring.geometry.newton").PlanError, match="transition"):
        paths.shifted(curves.Path(curves.Pose(0, 0, 0), (curves.Piece(30, 0.0, 0.01),)), 2.0)


def test_backwards_and_u_turn() -> None:
    curves, paths, road = (
        tool("authoring.geometry.plan_view_curves"),
        tool("maps.plans.authoring.curves"),
        bent_road(),
    )
    back = paths.backwards(road)
    for s in (0.0, 120.0, 233.0):
        a, b = road.at(s), back.at(road.length - s)
        assert (a.x, a.y) == pytest.approx((b.x, b.y), abs=1e-8)
        assert math.cos(a.h - b.h) == pytest.approx(-1.0)
    turn = paths.u_turn(curves.Pose(5, 1, 0.3), 14.7)
    across = turn.start.ahead(0.0, 14.7)
    assert (turn.end.x, turn.end.y) == pytest.approx((across.x, across.y), abs=1e-9)
    assert turn.end.h - turn.start.h == pytest.approx(math.pi)


def slopes(records: Any, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights and grades every 0.1 m."""
    height = tool("authoring.geometry.elevation").height_at
    return tuple(np.array([height(records, s) for s in np.arange(0.0, length, 0.1)]).T)  # type: ignore[return-value]


@settings(max_examples=30, deadline=None)
@given(rise=st.floats(-6, 6), grade0=st.floats(-0.03, 0.03), grade1=st.floats(-0.03, 0.03), k=st.floats(2, 6))
def test_a_ramp_keeps_both_grades_and_bends_no_more_than_it_may(
    rise: float, grade0: float, grade1: float, k: float
) -> None:
    records = tool("maps.plans.authoring.profiles").ramp(1.0, grade0, 1.0 + rise, grade1, 160.0, k)
    z, grade = slopes(records, 160.0 + 0.05)
    assert z[0] == pytest.approx(1.0)
    assert z[-1] == pytest.approx(1.0 + rise, abs=1e-6)
    assert (grade[0], grade[-1]) == pytest.approx((grade0, grade1), abs=1e-6)
    assert np.abs(np.diff(z)).max() < 0.1 * (np.abs(grade).max() + 1e-3)
    # K metres of curve for each per cent: the grade changes by at most 0.01/K per metre.
    assert np.abs(np.diff(grade)).max() <= 0.1 * 0.01 / k * 1.001


def test_a_cut_profile_has_the_heights_of_the_whole() -> None:
    profiles, height_at = (
        tool("maps.plans.authoring.profiles"),
        tool("authoring.geometry.elevation").height_at,
    )
    whole = profiles.vertical_curves([(60, 3.0), (200, -2.0), (300, -2.0), (440, 3.0)], 500.0, 10.0)
    for first, last in ((0.0, 500.0), (33.0, 222.0), (210.0, 290.0)):
        part = profiles.cut_profile(whole, first, last, 500.0)
        assert part[0][0] == 0.0
        for s in np.linspace(0.0, last - first - 1e-6, 23):
            assert height_at(part, s) == pytest.approx(height_at(whole, first + s), abs=1e-9)
    around = profiles.cut_profile(whole, 480.0, 540.0, 500.0)
    for s in (0.0, 10.0, 30.0, 59.0):
        assert height_at(around, s)[0] == pytest.approx(height_at(whole, (480.0 + s) % 500)[0])


@pytest.mark.parametrize("ends", [("plain", "plain"), ("plain", "pocket"), ("pocket", "pocket")])
def test_an_extra_lane_widens_the_road_by_itself(ends: tuple[str, str]) -> None:
    """Whatever other sections there are, the road's edge moves out by the lane's width and nothing else."""
    sections, extra = tool("authoring.elements.cross_sections"), tool("maps.plans.authoring.auxiliary_lanes")
    cross = sections.CrossSection(lanes=2, median_m=4.0)
    plain = sections.road_sections(cross, 200.0, ends, 25.0, (30.0, 30.0))
    lane = extra.ExtraLane(side="R", first_m=20.0, last_m=-15.0, taper_m=40.0, width_m=3.2)
    wide = extra.add_extra_lanes(plain, cross, 200.0, [lane])

    def edge(parts: Any, s: float) -> float:
        part = next(p for p in reversed(parts) if p.s <= s)
        count = sum(1 for p in part.right if p.kind in ("median", "driving"))
        return float(part.inner_border(-count - 1, s - part.s))

    for s in np.arange(0.25, 200.0, 0.5):
        grown = edge(plain, s) - edge(wide, s)
        share = min(max((s - 20.0) / 40.0, 0.0), 1.0, max((185.0 - s) / 40.0, 0.0))
        # The taper's second derivative runs 0, +p, −p, 0 in straight lines: antisymmetric about its middle.
        below = 16 * share**3 / 3 if share < 0.25 else None
        assert -1e-9 <= grown <= 3.2 + 1e-9
        if share in (0.0, 1.0):
            assert grown == pytest.approx(3.2 * share, abs=1e-9)
        if below is not None and share > 0.0:
            assert grown == pytest.approx(3.2 * below, abs=1e-6)
    lanes = [[p.key for p in part.right] for part in wide]
    assert all(len(keys) == len(set(keys)) for keys in lanes)


def test_an_extra_lane_that_does_not_fit_is_refused() -> None:
    sections, extra = tool("authoring.elements.cross_sections"), tool("maps.plans.authoring.auxiliary_lanes")
    cross = sections.CrossSection(lanes=1)
    plain = sections.road_sections(cross, 60.0, ("plain", "plain"), 20.0, (0.0, 0.0))
    with pytest.raises(tool("authoring.geometry.newton").PlanError, match="does not fit"):
        extra.add_extra_lanes(plain, cross, 60.0, [extra.ExtraLane(side="R", first_m=10.0, last_m=-10.0)])


def motorway() -> Any:
    """A loop with an exit and a merge on a slope, joined by a street."""
    plan, cross = tool("maps.plans.authoring.plan"), tool("authoring.elements.cross_sections").CrossSection
    gores, profiles = tool("maps.plans.authoring.ramps"), tool("maps.plans.authoring.profiles")
    bare = {"gutter_m": 0.0, "sidewalk_m": 0.0}
    wide = cross(lanes=3, back=0, inner_shoulder_m=0.8, shoulder_m=2.5, **bare)
    ramp = cross(lanes=1, back=0, lane_m=4.0, inner_shoulder_m=0.5, shoulder_m=1.5, **bare)
    town = plan.TownPlan(name="loop", projection="+proj=tmerc +lat_0=0 +lon_0=0")
    corners = [(0, 300), (400, 300), (400, 700), (-400, 700), (-400, 300), (0, 300)]
    town.loop(
        "Ring",
        tool("maps.plans.authoring.curves").fillet(corners, [(80, 50)] * 4),
        wide,
        80,
        kind="motorway",
        climb=profiles.Profile(((30.0, 0.0), (150.0, 3.0), (1500.0, 3.0), (1700.0, 0.0)), 20.0),
        gores=(gores.Exit(name="X", at_m=100.0), gores.Merge(name="M", at_m=2120.0)),
    )  # fmt: skip
    town.node("S", 0.0, 120.0, control="stop")
    town.node("K", 0.0, 20.0, control="bulb")
    town.road("off", "X", "T", ramp, 40, bends=(gores.OnRay(60.0, 40.0, 20.0),))
    town.node("T", 200.0, 120.0, control="none", crosswalks=False)
    town.road("street", "T", "S", cross(lanes=1), 40)
    town.road("stub", "S", "K", cross(lanes=1), 30)
    town.road("on", "S", "M", ramp, 40, bends=((-340.0, 120.0, 40.0, 20.0), gores.OnRay(60.0, 40.0, 20.0)))
    return town


@pytest.mark.long
def test_a_loop_with_ramps_is_a_whole_network() -> None:
    """carla.Map leads from the motorway down the exit, along the street and back on to the motorway."""
    carla = pytest.importorskip("carla")
    text = tool("maps.plans.authoring.builder").Builder(motorway()).build()
    town = carla.Map("loop", text)
    names = {r.get("id"): r.get("name") for r in ElementTree.fromstring(text).findall("road")}
    after: dict[str, set[str]] = {}
    for a, b in town.get_topology():
        after.setdefault(names[str(a.road_id)], set()).add(names[str(b.road_id)])
    assert after["Ring 1"] >= {"X through", "X ramp"}
    assert after["X ramp"] == {"off"}
    assert after["on"] == {"M ramp"}
    assert after["M ramp"] == after["M through"] == {"Ring 1"}
    assert "M through" in after["Ring 2"]
    for w in town.generate_waypoints(5.0):
        assert math.isfinite(w.transform.location.x)


def test_shoulders_fill_the_wedge_between_road_and_ramp() -> None:
    """No gap and no overlap of more than some centimetres where a ramp parts from the road."""
    town = motorway()
    gores, layout = tool("maps.plans.authoring.ramps"), tool("maps.plans.authoring.layout")
    ring = next(line for line in layout.lay_out(town) if line.road.name == "Ring")
    ramps = {line.road.name: line for line in layout.lay_out(town)}
    for gore, ramp in zip(ring.road.gores, ("off", "on"), strict=True):
        inside = ramps[ramp].ends[gore.name].inside
        through = gores.through_line(gore, ring.axis, True, ring.road.cross)
        shoulders = 2.5 + 0.5
        for share in np.linspace(0.0, 1.0, 21):
            pose = inside.at(share * inside.length)
            line = through.at(share * through.length)
            aside = math.sin(line.h) * (pose.x - line.x) - math.cos(line.h) * (pose.y - line.y)
            parted = share**3 if not gore.merges else (1 - share) ** 3
            assert aside - 3 * 3.5 - parted * shoulders == pytest.approx(0.0, abs=0.12)


def test_an_exit_turned_round_is_a_merge() -> None:
    """Run backwards and mirrored, the ramp of an exit lies on that of a merge."""
    gores, curves, cross = (
        tool("maps.plans.authoring.ramps"),
        tool("authoring.geometry.plan_view_curves"),
        tool("authoring.elements.cross_sections").CrossSection,
    )
    road = cross(lanes=2, back=0, shoulder_m=2.0, gutter_m=0.0, sidewalk_m=0.0)
    ramp = cross(lanes=1, back=0, gutter_m=0.0, sidewalk_m=0.0)
    axis = curves.Path(curves.Pose(-200.0, 0.0, 0.0), (curves.Piece(400.0),))
    leave = gores.ramp_end(gores.Exit(name="x", at_m=200.0), axis, False, road, ramp).inside
    join = gores.ramp_end(gores.Merge(name="m", at_m=200.0), axis, False, road, ramp).inside
    for s in np.linspace(0.0, leave.length, 9):
        a, b = leave.at(s), join.at(join.length - s)
        assert (a.x, a.y) == pytest.approx((-b.x, b.y), abs=1e-9)


def test_gores_say_what_they_lack() -> None:
    town = motorway()
    error = tool("authoring.geometry.newton").PlanError
    town.roads = [road for road in town.roads if road.name != "off"]
    with pytest.raises(error, match="gore 'X' has 0 ramps"):
        tool("maps.plans.authoring.builder").Builder(town).build()
    town = motorway()
    next(road for road in town.roads if road.name == "off").cross = tool(
        "authoring.elements.cross_sections"
    ).CrossSection(lanes=1)
    with pytest.raises(error, match="one-way road of one lane"):
        tool("maps.plans.authoring.builder").Builder(town).build()
