"""Walkers: on sidewalks and crosswalks, at red lights and before an ego that does not stop."""

import numpy as np
import pytest

from benchmarks.traffic_audit import NOBODY, on_walkable
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.signals import SignalState
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.tables.lane_tables import TAKEN
from carlaloc_env.traffic.tables.walker_network import CROSSWALK
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.world import TrafficWorld


@pytest.fixture(scope="module")
def tables() -> TrafficTables:
    """What traffic knows of Town03."""
    return TrafficTables(load_town("Town03").network)


def test_every_crosswalk_joins_two_sidewalks(tables: TrafficTables) -> None:
    """All crosswalks of Town03 can be walked, each over as many lanes as the map says."""
    walker_network, network = tables.walker_network, tables.network
    crosswalks = np.flatnonzero(walker_network.path.kind == CROSSWALK)
    assert len(crosswalks) == len(network.crosswalks)
    assert (walker_network.landing[crosswalks] >= 0).all()
    lanes = sorted(
        int(walker_network.path.lane_crossing_end[k] - walker_network.path.lane_crossing_first[k])
        for k in crosswalks
    )
    assert lanes == sorted(len(item.lanes) for item in network.crosswalks)


def test_walkers_keep_to_their_paths_and_distance(tables: TrafficTables) -> None:
    """On an empty town all stay on sidewalks and crosswalks, cross, and never stand inside each other."""
    world = TrafficWorld(tables.network, TrafficConfig(vehicles=0, walkers=80, seed=2), tables)
    frame = world.reset()
    across = 0
    for step in range(20 * 90):
        frame = world.step(NOBODY)
        if step % 20:
            continue
        sidewalk, crosswalk = on_walkable(tables.network, frame.position_m)
        assert (sidewalk | crosswalk).all()
        across += int((crosswalk & ~sidewalk).sum())
        apart = np.linalg.norm(frame.position_m[:, None, :2] - frame.position_m[None, :, :2], axis=-1)
        apart[np.arange(80), np.arange(80)] = 9.0
        assert apart.min() > 0.2
    assert across > 100
    assert (frame.travelled_m > 20.0).mean() > 0.9


def test_walkers_do_not_set_out_against_a_green(tables: TrafficTables) -> None:
    """Nobody steps onto the carriageway while a light lets the traffic drive that would come across."""
    world = TrafficWorld(tables.network, TrafficConfig(vehicles=0, walkers=80, seed=4), tables)
    world.reset()
    state, walker_network = world._walkers.state, tables.walker_network
    was = state.crossing.copy()
    begun = 0
    for step in range(20 * 90):
        lights = world.signals((step - 0) * STEP_NS)
        world.step(NOBODY)
        for w in np.flatnonzero(state.crossing & ~was):
            path = int(state.path[w])
            rows = range(
                int(walker_network.path.lane_crossing_first[path]),
                int(walker_network.path.lane_crossing_end[path]),
            )
            heads = [
                int(walker_network.head[i])
                for k in rows
                for i in range(
                    int(walker_network.lane_crossing.head_first[k]),
                    int(walker_network.lane_crossing.head_end[k]),
                )
            ]
            begun += bool(heads)
            assert (lights[heads] == SignalState.RED).all()
        was = state.crossing.copy()
    assert begun > 10


def test_a_walker_whose_path_is_parked_up_leaves_the_road(tables: TrafficTables) -> None:
    """It holds up only the lane that it stands in and, after a while, goes back to where it came from."""
    world = TrafficWorld(tables.network, TrafficConfig(vehicles=0, walkers=1, seed=2, warm_up_s=0.0), tables)
    world.reset()
    walker_network, state, roads = tables.walker_network, world._walkers.state, tables.roads
    path = next(
        w
        for w in np.flatnonzero(walker_network.path.kind == CROSSWALK)
        if walker_network.path.lane_crossing_end[w] - walker_network.path.lane_crossing_first[w] == 4
    )
    crossings = range(
        int(walker_network.path.lane_crossing_first[path]), int(walker_network.path.lane_crossing_end[path])
    )
    first, parked = sorted(crossings, key=lambda k: float(walker_network.lane_crossing.near_m[k]))[:2]
    state.path[0], state.path_direction[0], state.crossing[0] = path, 1, True
    state.station_m[0] = walker_network.lane_crossing.near_m[first]
    row = int(walker_network.path.row_first[path] + state.station_m[0] / walker_network.path.row_step_m[path])
    state.position_m[0] = walker_network.row.position_m[row]
    crossing = int(walker_network.lane_crossing.crossing[parked])
    lane = int(roads.crossing.lane[crossing])
    middle = 0.5 * (roads.crossing.enter_m[crossing] + roads.crossing.leave_m[crossing])
    pose = tables.network.pose(np.array([lane]), np.array([middle]))
    x, y, z = (float(value) for value in pose.position_m[0])
    ego = EgoView(position_m=(x, y, z), heading_rad=float(pose.heading_rad[0]), speed_mps=0.0)
    waited, back = 0.0, False
    for _ in range(20 * 60):
        frame = world.step(ego)
        if state.waited_s[0] > 5.0:
            waited = max(waited, float(state.waited_s[0]))
            assert world._taken[walker_network.lane_crossing.crossing[parked]] == TAKEN
            assert world._taken[walker_network.lane_crossing.crossing[first]] == 0
        back = back or (walker_network.path.kind[state.path[0]] != CROSSWALK)
        if back:
            break
    assert waited > 5.0
    assert back
    start = walker_network.row.position_m[walker_network.path.row_first[path]]
    assert np.linalg.norm(frame.position_m[0, :2] - start[:2]) < 2.0


def test_catalogue_lists_walkers_last(tables: TrafficTables) -> None:
    """Vehicles come first, then walkers, as frames do."""
    world = TrafficWorld(tables.network, TrafficConfig(vehicles=3, walkers=4, seed=2), tables)
    assert (world.catalog.tag[3:] == Tag.PEDESTRIAN).all()
    assert len(world.reset()) == 7
