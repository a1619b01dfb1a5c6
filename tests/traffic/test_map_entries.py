"""Roads that lead out of the map: who leaves comes in elsewhere, and is nowhere in between."""

import dataclasses

import numpy as np
import pytest

from benchmarks.traffic_audit import NOBODY, overlapping_boxes
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.default_route import choose_route
from carlaloc_env.scenery.kerbs.tight_turns import fit_turns
from carlaloc_env.timeline.actors import came_in_elsewhere
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.world import TrafficWorld

LANE = '<lane id="{}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
ROAD = (
    '<OpenDRIVE><header revMajor="1" revMinor="4"/><road id="0" length="600" junction="-1"><link/>'
    '<type s="0" type="town"><speed max="20" unit="m/s"/></type><planView>'
    '<geometry s="0" x="0" y="0" hdg="0" length="600"><line/></geometry></planView><lanes><laneSection s="0">'
    f'<left>{LANE.format(1)}</left><center><lane id="0" type="none"/></center>'
    f"<right>{LANE.format(-1)}{LANE.format(-2)}</right></laneSection></lanes></road></OpenDRIVE>"
)


@pytest.fixture(scope="module")
def road() -> LaneNetwork:
    """600 m of road that begins and ends nowhere, two lanes one way and one the other."""
    return build_network(ROAD.encode())


def test_a_road_that_ends_has_traffic(road: LaneNetwork) -> None:
    """Fifteen vehicles drive for two minutes, come in again at the three beginnings, and never collide."""
    world = TrafficWorld(road, TrafficConfig(vehicles=15, walkers=0, seed=3))
    frames = [world.reset()]
    frames += [world.step(NOBODY) for _ in range(2400)]
    place = np.array([frame.position_m for frame in frames])
    heading = np.array([frame.heading_rad for frame in frames])
    jumped = came_in_elsewhere(np.diff(place, axis=0), np.diff(heading, axis=0))
    assert jumped.sum() > 15
    after = place[1:][jumped]
    assert (np.minimum(np.abs(after[:, 0]), np.abs(after[:, 0] - 600.0)) < 8.0).all()
    assert set(np.round(after[:, 1] / 1.75).astype(int).tolist()) == {1, -1, -3}
    assert not any(len(overlapping_boxes(f, world.catalog, np.arange(15))) for f in frames[::20])
    assert np.mean([frame.speed_mps.mean() for frame in frames]) > 10.0


def test_nobody_is_between_two_places(road: LaneNetwork) -> None:
    """Between two steps a vehicle that has left the map stands where it was; others move on as ever."""
    world = TrafficWorld(road, TrafficConfig(vehicles=2, walkers=0, seed=3))
    first = world.reset()
    away = first.position_m + np.array([[300.0, 0.0, 0.0], [1.0, 0.0, 0.0]], np.float32)
    timeline = Timeline(world.catalog)
    timeline.append_step(first, np.zeros(0, np.uint8))
    timeline.append_step(dataclasses.replace(first, position_m=away), np.zeros(0, np.uint8))
    middle = STEP_NS // 2
    wanted = first.position_m + np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]], np.float32)
    np.testing.assert_allclose(timeline.actors_at(middle).position_m, wanted, atol=1e-4)
    poses = timeline.actor_poses(np.array([0, 1]), np.full(2, middle))
    np.testing.assert_allclose(poses.position_m, wanted, atol=1e-4)


def test_nobody_turns_round_on_the_way_to_the_lane_beside(road: LaneNetwork) -> None:
    """A car that came in beside where it had left swept over the road for a step, and hit others."""
    world = TrafficWorld(road, TrafficConfig(vehicles=2, walkers=0, seed=3))
    first = world.reset()
    change = np.array([[-2.0, 3.5, 0.0], [2.0, 0.0, 0.0]], np.float32)
    second = dataclasses.replace(
        first,
        position_m=first.position_m + change,
        heading_rad=first.heading_rad + np.array([np.pi, 0.05], np.float32),
    )
    timeline = Timeline(world.catalog)
    for frame in (first, second):
        timeline.append_step(frame, np.zeros(0, np.uint8))
    middle = timeline.actors_at(STEP_NS // 2)
    assert middle.heading_rad - first.heading_rad == pytest.approx([0.0, 0.025], abs=1e-5)
    np.testing.assert_allclose(middle.position_m[0], first.position_m[0])
    poses = timeline.actor_poses(np.array([0, 1]), np.full(2, STEP_NS // 2))
    assert poses.heading_rad - first.heading_rad == pytest.approx([0.0, 0.025], abs=1e-5)


def test_a_route_takes_all_of_a_road_that_ends(road: LaneNetwork) -> None:
    """From five metres behind its beginning to five metres before its end."""
    route = choose_route(road, fit_turns=fit_turns)
    assert route is not None
    assert route.length_m == pytest.approx(590.0, abs=1.0)
