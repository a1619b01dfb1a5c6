"""Widths below 0 count as 0, and no car drives where a lane is narrower than it is."""

import numpy as np
import pytest
from shared_fixtures.worlds.ring_maps import LANE, lane, ring_map

from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.map.checks.report import report
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.routing.default_route import choose_route
from carlaloc_env.scenery.kerbs.tight_turns import fit_turns

POLY = '<{} sOffset="{}" a="{}" b="{}" c="{}" d="{}"/>'
WAIST = LANE + POLY.format("width", 20, 3.5, -0.35, 0.35 / 60.0, 0) + POLY.format("width", 80, 3.5, 0, 0, 0)
"""3.5 m but between 20 m and 80 m, where a parabola falls to 3.5 - 0.35 · 30 / 2 = -1.75 m at 50 m."""

VANISHING = LANE + POLY.format("width", 288.5, 3.5, -0.035, 0, 0)
"""3.5 m that fall to nothing over the last 100 m of the ring."""


def network_of(right: str) -> LaneNetwork:
    return build_network(ring_map(right=right).encode())


def lane_number(network: LaneNetwork, lane_id: int) -> int:
    return next(n.index for n in network.lanes if n.lane_id == lane_id)


def messages(network: LaneNetwork, label: str) -> list[str]:
    return [p.message for p in report(network.xodr, network).problems if p.id == label]


def test_a_width_that_falls_below_zero_is_zero() -> None:
    """Where the parabola is negative, the sidewalk beside the lane touches the lane inside of it."""
    network = network_of(lane(-1) + lane(-2, WAIST) + lane(-3, type="sidewalk"))
    s = np.arange(0.0, 100.0, 0.5)
    expected = np.where((s > 20) & (s < 80), 3.5 - 0.35 * (s - 20) + 0.35 / 60 * (s - 20) ** 2, 3.5)
    edges, number = network.surface.edges, {n: np.full(len(s), lane_number(network, n)) for n in (-2, -3)}
    assert edges.width(number[-2], s) == pytest.approx(np.maximum(expected, 0.0), abs=1e-9)
    assert edges.outer(number[-2], s).t_m == pytest.approx(-3.5 - np.maximum(expected, 0.0), abs=1e-9)
    assert edges.inner(number[-3], s).t_m == pytest.approx(-3.5 - np.maximum(expected, 0.0), abs=1e-9)
    centre = edges.centre(number[-2], s)
    assert centre.t_m == pytest.approx(-3.5 - 0.5 * np.maximum(expected, 0.0), abs=1e-9)
    assert not centre.slope[expected < -0.01].any()
    assert network.tables.width_m.min() == 0.0
    assert edges.stated_width(number[-2], s) == pytest.approx(expected, abs=1e-9)
    assert any("falls to -1.75 m" in m for m in messages(network, "-2 of road 1"))


def test_borders_that_cross_leave_no_width() -> None:
    """The outer border runs from 5 m to 1 m within 100 m; the inner one stays at 3.5 m, met at 37.5 m."""
    right = lane(-1, POLY.format("border", 0, -3.5, 0, 0, 0))
    right += lane(-2, POLY.format("border", 0, -5, 0.04, 0, 0)) + lane(-3, LANE, type="sidewalk")
    network = network_of(right)
    s = np.array([0.0, 20.0, 37.0, 38.0, 90.0])
    at = {n: np.full(len(s), lane_number(network, n)) for n in (-2, -3)}
    outer = -np.maximum(5.0 - 0.04 * s, 3.5)
    edges = network.surface.edges
    assert edges.outer(at[-2], s).t_m == pytest.approx(outer)
    assert edges.outer(at[-3], s).t_m == pytest.approx(outer - 3.5)
    assert edges.width(at[-2], s) == pytest.approx(-outer - 3.5)
    assert edges.stated_width(at[-2], s) == pytest.approx(1.5 - 0.04 * s)


@pytest.mark.parametrize(
    ("body", "open_to_cars"),
    [
        (WAIST, False),
        (LANE, True),
        (POLY.format("width", 0, EGO_SIZE_M[1] - 0.05, 0, 0, 0), False),
        (POLY.format("width", 0, EGO_SIZE_M[1] + 0.05, 0, 0, 0), True),
        (POLY.format("width", 0, 0, 0.05, 0, 0) + POLY.format("width", 70, 3.5, 0, 0, 0), True),
    ],
    ids=["a waist", "wide", "narrow", "just wide enough", "a taper at its beginning"],
)
def test_which_lanes_cars_drive_on(body: str, open_to_cars: bool) -> None:
    network = network_of(lane(-1) + lane(-2, body))
    inner, outer = (network.lanes[lane_number(network, n)] for n in (-1, -2))
    assert (outer.type == "driving") == open_to_cars
    # Lane -1 has its neighbour to the right only where cars may change over to it.
    assert (inner.right == outer.index, outer.left == inner.index) == (open_to_cars, open_to_cars)
    assert any("none drives on it" in m for m in messages(network, "-2 of road 1")) != open_to_cars


@pytest.mark.parametrize("narrow", [-1, -2])
@pytest.mark.parametrize("body", [WAIST, VANISHING], ids=["a waist", "no width at its end"])
def test_routes_keep_off_narrow_lanes(narrow: int, body: str) -> None:
    """Of two lanes one is narrow somewhere: the route runs on the other one, whichever it is."""
    right = "".join(lane(n, body if n == narrow else LANE) for n in (-1, -2))
    network = build_network(ring_map(right=right, left=lane(1, type="shoulder")).encode())
    route = choose_route(network, fit_turns=fit_turns)
    assert route is not None
    assert {network.lanes[n].lane_id for n in np.unique(route.lane)} == {-3 - narrow}
    width = network.width_m(route.lane, route.lane_station_m)
    assert width.min() >= EGO_SIZE_M[1]


def test_a_waist_at_a_joint_of_sections_is_one() -> None:
    """The lane ends with no width in one section and begins with none in the next: no car passes there."""
    falling, growing = POLY.format("width", 0, 3.5, -0.07, 0, 0), POLY.format("width", 0, 0, 0.05, 0, 0)
    text = ring_map(right=lane(-1) + lane(-2, falling))
    first_section = text[text.index("<laneSection") : text.index("</lanes>")]
    text = text.replace(
        "</lanes>", first_section.replace("s='0'", "s='50'").replace(falling, growing) + "</lanes>"
    )
    network = build_network(text.encode())
    first, last = (n for n in network.lanes if n.lane_id == -2)
    assert last.index not in first.successors
    assert first.index not in last.predecessors
    assert all(n.successors for n in network.lanes if n.lane_id in (1, -1))


def test_a_map_of_narrow_lanes_alone_keeps_them() -> None:
    body = POLY.format("width", 0, 1.5, 0, 0, 0)
    text = ring_map(right=lane(-1, body), left=lane(1, body))
    assert {n.type for n in build_network(read_opendrive(text.encode())).lanes} == {"driving"}
