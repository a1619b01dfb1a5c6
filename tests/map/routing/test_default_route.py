"""Routes that are chosen for towns whose owner has given none."""

import math
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.worlds.maps import CROSSING, MAPS
from shared_fixtures.worlds.towns import network_at, town_network

from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.default_route import choose_loop, choose_route, lanes_that_go_on
from carlaloc_env.scenery.kerbs.tight_turns import fit_turns

ROAD = (
    '<road id="{}" length="{}" junction="-1"><link>{}</link><planView>'
    '<geometry s="0" x="{}" y="{}" hdg="{}" length="{}">{}</geometry></planView>'
    '<lanes><laneOffset s="0" a="1.6" b="0" c="0" d="0"/><laneSection s="0"><center>'
    '<lane id="0" type="none"/></center><right><lane id="-1" type="driving"><link>{}</link>'
    '<width sOffset="0" a="3.2" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road>'
)
LANE = (
    '<center><lane id="0" type="none"/></center><right><lane id="-1" type="driving"><link>{}</link>'
    '<width sOffset="0" a="3.2" b="0" c="0" d="0"/></lane></right>'
)


@pytest.mark.long
@pytest.mark.parametrize("path", MAPS)
def test_chosen_routes_follow_lanes(path: Path) -> None:
    """A chosen route has the length asked for and runs on driving lanes without a jump."""
    network = network_at(path)
    route = choose_route(network, 800.0, fit_turns=fit_turns)
    assert route is not None
    assert route.length_m == pytest.approx(800.0, rel=0.03)
    steps = np.linalg.norm(np.diff(route.position_m, axis=0), axis=1)
    assert steps.max() < 1.2 * route.step_m + 0.1
    near = network.nearest(route.position_m)
    assert np.percentile(near.distance_m, 95) < 0.3
    assert all(network.lanes[lane].type == "driving" for lane in np.unique(route.lane))


@pytest.mark.long
@pytest.mark.parametrize("path", MAPS)
def test_chosen_loops_close(path: Path) -> None:
    """A loop is about as long as asked, ends where it begins, and avoids the lanes that it should."""
    network = network_at(path)
    loop = choose_loop(network, 2000.0, fit_turns=fit_turns)
    assert loop is not None
    assert loop.closed
    assert loop.length_m == pytest.approx(2000.0, rel=0.5)
    around = np.vstack([loop.position_m, loop.position_m[:1]])
    assert np.linalg.norm(np.diff(around, axis=0), axis=1).max() < 1.2 * loop.step_m + 0.1
    assert all(network.lanes[lane].type == "driving" for lane in np.unique(loop.lane))


def test_a_loop_avoids_lanes_where_another_leads_round() -> None:
    network = town_network("Town03")
    first = choose_loop(network, fit_turns=fit_turns)
    assert first is not None
    avoided = np.zeros(len(network.lanes), dtype=bool)
    avoided[np.bincount(first.lane).argmax()] = True
    other = choose_loop(network, avoided=avoided, fit_turns=fit_turns)
    assert other is not None
    assert not avoided[other.lane].any()


def test_dead_ends_are_known() -> None:
    """On a lone crossing no lane goes on for ever; a route is found all the same."""
    network = build_network(CROSSING)
    assert not lanes_that_go_on(network).any()
    route = choose_route(network, fit_turns=fit_turns)
    assert route is not None
    assert route.length_m > 50.0


def hairpin(radius_m: float, kink_deg: float) -> LaneNetwork:
    """Two roads of 300 m side by side, and a turn from one into the other that begins and ends askew."""
    kink = math.radians(kink_deg)
    turned = math.pi - 2.0 * kink
    # The arc's chord lies across both roads, whatever its kinks.
    across = 2.0 * radius_m * math.sin(0.5 * turned)
    roads = (
        (1, -300.0, 0.0, 0.0, 300.0, "<line/>"),
        (2, 0.0, 0.0, kink, turned * radius_m, f'<arc curvature="{1 / radius_m}"/>'),
        (3, 0.0, across, math.pi, 300.0, "<line/>"),
    )
    text = '<OpenDRIVE><header revMajor="1" revMinor="4"/>'
    for number, x, y, heading, length, shape in roads:
        ends = {"predecessor": number - 1, "successor": number + 1}
        known = {end: n for end, n in ends.items() if 1 <= n <= 3}
        link = "".join(
            f'<{end} elementType="road" elementId="{n}" '
            f'contactPoint="{"end" if end == "predecessor" else "start"}"/>'
            for end, n in known.items()
        )
        lanes = "".join(f'<{end} id="-1"/>' for end in known)
        text += ROAD.format(number, length, link, x, y, heading, length, shape, lanes)
    return build_network(f"{text}</OpenDRIVE>".encode())


@pytest.mark.parametrize(
    ("radius_m", "kink_deg", "passed"),
    [(6.0, 0.0, True), (2.5, 0.0, False), (2.5, 27.0, False), (6.0, 27.0, True)],
)
def test_turns_on_the_spot_are_left_out(radius_m: float, kink_deg: float, passed: bool) -> None:
    """A half turn of 2.5 m is not driven, not even where it is curved by 126° and the rest are kinks."""
    network = hairpin(radius_m, kink_deg)
    route = choose_route(network, 500.0, fit_turns=fit_turns)
    assert route is not None
    roads = {network.lanes[lane].road_id for lane in np.unique(route.lane)}
    assert ("2" in roads) == passed


def straight(*lengths_m: float) -> LaneNetwork:
    """A straight road of some lane sections."""
    lane = LANE.format("".join(f'<{end} id="-1"/>' for end in ("predecessor", "successor")))
    starts = np.cumsum([0.0, *lengths_m])
    sections = "".join(f'<laneSection s="{s}">{lane}</laneSection>' for s in starts[:-1])
    return build_network(
        f'<OpenDRIVE><header revMajor="1" revMinor="4"/><road id="1" length="{starts[-1]}" junction="-1">'
        f'<planView><geometry s="0" x="0" y="0" hdg="0" length="{starts[-1]}"><line/></geometry></planView>'
        f"<lanes>{sections}</lanes></road></OpenDRIVE>".encode()
    )


@pytest.mark.parametrize("lengths_m", [(30.0,), (10.0, 10.0, 10.0), (12.0,)])
def test_short_roads_are_driven_almost_whole(lengths_m: tuple[float, ...]) -> None:
    """From at most 5 m after the beginning to as much before the end."""
    route = choose_route(straight(*lengths_m), fit_turns=fit_turns)
    assert route is not None
    assert not route.closed
    assert 0.5 * sum(lengths_m) <= route.length_m <= sum(lengths_m)
