"""The lane network beside carla.Map, an implementation that nobody here wrote."""

import pathlib
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.maps import MAPS
from shared_fixtures.worlds.towns import network_at

from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.lane_network import LaneNetwork

carla = pytest.importorskip("carla", reason="needs the package carla (pip install carla)")

STEP_M = 2.0


@pytest.fixture(scope="module", params=MAPS)
def pair(request: pytest.FixtureRequest) -> tuple[LaneNetwork, Any]:
    path: pathlib.Path = request.param
    return network_at(path), carla.Map("map", path.read_text(encoding="utf-8"))


def carla_heading(network: LaneNetwork, rows: NDArray[np.void]) -> NDArray[np.float64]:
    """CARLA's heading of a lane: it adds the slope of t over s to the road's heading as if an angle."""
    lane, edges = lane_numbers(network, rows), network.surface.edges
    slope = edges.centre(lane, rows["s"]).slope
    turned = np.where(network.forward[lane], 0.0, np.pi)
    return network.surface.heading(edges.road[lane], rows["s"]) + slope + turned


def lane_numbers(network: LaneNetwork, rows: NDArray[np.void]) -> NDArray[np.int64]:
    road = np.array([network.road_index[label] for label in rows["road_id"]])
    keys = zip(road, rows["section"], rows["lane_id"], strict=True)
    return np.array([network.surface.edges.index[int(r), int(k), int(i)] for r, k, i in keys])


def lean_m(network: LaneNetwork, lane: NDArray[np.int64], s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Height of lane centres above the reference line where a road leans: CARLA knows no superelevation."""
    surface = network.surface
    rise: NDArray[np.float64] = surface.edges.centre(lane, s).t_m * np.sin(
        surface.tilt_rad(surface.edges.road[lane], s)
    )
    return rise


def by_place(labels: list[tuple[int, int, float]]) -> list[int]:
    return sorted(range(len(labels)), key=lambda n: labels[n])


def test_waypoints_agree(pair: tuple[LaneNetwork, Any]) -> None:
    """Same waypoints; 99.9 % of them within 1 cm and 0.1° of CARLA's own height and heading formulas."""
    network, map_ = pair
    ours, theirs = network.waypoints(STEP_M), map_.generate_waypoints(STEP_M)
    assert len(ours) == len(theirs)
    mine = [(int(r), int(i), round(float(s), 6)) for r, i, s in ours[["road_id", "lane_id", "s"]].tolist()]
    yours = [(w.road_id, w.lane_id, round(w.s, 6)) for w in theirs]
    a, b = by_place(mine), by_place(yours)
    assert [mine[n] for n in a] == [yours[n] for n in b]
    assert [int(ours["section"][n]) for n in a] == [theirs[n].section_id for n in b]
    t = [theirs[n].transform for n in b]
    points = np.array([(p.location.x, -p.location.y, p.location.z) for p in t])
    yaw = -np.radians([p.rotation.yaw for p in t])
    rows = ours[a]
    points[:, 2] += lean_m(network, lane_numbers(network, rows), rows["s"])
    away = np.sqrt(sum((rows[k] - points[:, n]) ** 2 for n, k in enumerate("xyz")))
    turn = np.degrees(np.abs(wrap_angle(carla_heading(network, rows) - yaw)))
    assert np.mean(away < 0.01) >= 0.999
    assert np.mean(turn < 0.1) >= 0.999
    # Our own heading is the true one; CARLA's approximation stays near it.
    assert np.quantile(np.degrees(np.abs(wrap_angle(rows["heading"] - yaw))), 0.9) < 0.5


def test_same_lanes_and_junctions(pair: tuple[LaneNetwork, Any]) -> None:
    """The same driving lanes, and the same junctions with the same lanes inside."""
    network, map_ = pair
    theirs = map_.generate_waypoints(STEP_M)
    ours = network.waypoints(STEP_M)
    lanes = {(int(r), int(k), int(i)) for r, k, i in ours[["road_id", "section", "lane_id"]].tolist()}
    assert lanes == {(w.road_id, w.section_id, w.lane_id) for w in theirs}
    inside = {(int(lane.junction_id), int(lane.road_id)) for lane in network.lanes if lane.junction_id}
    seen = {(w.junction_id, w.road_id) for w in theirs if w.is_junction}
    roads = {int(r) for r in ours["road_id"]}
    assert {pair for pair in inside if pair[1] in roads} == seen
    assert len({j for j, _ in seen}) == len({j for j, r in inside if r in roads})


def test_topology_agrees(pair: tuple[LaneNetwork, Any]) -> None:
    """The same driving lane follows the same driving lane, everywhere."""
    network, map_ = pair

    def key(w: Any) -> tuple[int, int, int]:
        return (w.road_id, w.section_id, w.lane_id)

    def own(n: int) -> tuple[int, int, int]:
        lane = network.lanes[n]
        return (int(lane.road_id), lane.section, lane.lane_id)

    driving = [lane for lane in network.lanes if lane.type == "driving"]
    drives = {own(lane.index) for lane in driving}
    # CARLA's edges lead into shoulders, too, where a lane becomes one.
    theirs = {(key(a), key(b)) for a, b in map_.get_topology()}
    theirs = {edge for edge in theirs if set(edge) <= drives}
    ours = {(own(lane.index), own(n)) for lane in driving for n in lane.successors}
    assert ours == theirs


def test_table_poses_lie_on_carlas_lanes(pair: tuple[LaneNetwork, Any]) -> None:
    """Poses from the half-metre tables lie within 1 cm of the waypoint that CARLA has there."""
    network, map_ = pair
    rng = np.random.default_rng(7)
    driving = [lane.index for lane in network.lanes if lane.type == "driving" and lane.length_m > 2.0]
    lane = rng.choice(driving, 200)
    station = rng.uniform(0.5, 1.0, 200) * (network.tables.length_m[lane] - 0.5)
    poses = network.pose(lane, station)
    s = network.s_m(lane, station)
    lean = lean_m(network, lane, s)
    for k, n in enumerate(lane):
        record = network.lanes[n]
        w = map_.get_waypoint_xodr(int(record.road_id), record.lane_id, float(s[k]))
        assert w is not None
        across = np.array([-np.sin(poses.heading_rad[k]), np.cos(poses.heading_rad[k])])
        delta = poses.position_m[k, :2] - np.array([w.transform.location.x, -w.transform.location.y])
        assert abs(float(np.sum(across * delta))) < 0.01
        assert abs(poses.position_m[k, 2] - lean[k] - w.transform.location.z) < 0.01


def test_widths_agree(pair: tuple[LaneNetwork, Any]) -> None:
    """Lane widths at mid-lane equal CARLA's."""
    network, map_ = pair
    for record in network.lanes[:: max(1, len(network.lanes) // 200)]:
        if record.type != "driving" or record.length_m < 1.0:
            continue
        s = float(network.s_m([record.index], [0.5 * record.length_m])[0])
        w = map_.get_waypoint_xodr(int(record.road_id), record.lane_id, s)
        ours = float(network.width_m([record.index], [0.5 * record.length_m])[0])
        assert ours == pytest.approx(w.lane_width, abs=2e-3)


def test_lights_act_on_the_same_lanes(pair: tuple[LaneNetwork, Any]) -> None:
    """Per traffic light, CARLA's landmark lanes are our junction lanes or our approach lanes."""
    network, map_ = pair
    theirs: dict[str, set[tuple[int, int]]] = {}
    for mark in map_.get_all_landmarks():
        if mark.type == "1000001":
            spans = [(min(v), max(v)) for v in mark.get_lane_validities()]
            named = {(mark.road_id, n) for low, high in spans for n in range(low, high + 1) if n != 0}
            theirs.setdefault(mark.id, set()).update(named)

    def own(lanes: tuple[int, ...]) -> set[tuple[int, int]]:
        return {(int(network.lanes[n].road_id), network.lanes[n].lane_id) for n in lanes}

    heads = {head.id: head for head in network.signals if head.type == "1000001"}
    assert set(theirs) <= set(heads)
    for label, lanes in theirs.items():
        assert lanes in (own(heads[label].junction_lanes), own(heads[label].lanes))
    for head in heads.values():
        assert head.lanes
        for n, station in zip(head.lanes, head.stop_station_m, strict=True):
            assert network.lanes[n].junction_id is None
            assert 0.0 <= network.lanes[n].length_m - station < 15.0


def test_crosswalks_stand_in_the_same_places(pair: tuple[LaneNetwork, Any]) -> None:
    """As many outlines; CARLA widens each by a metre, which keeps its middle."""
    network, map_ = pair
    points = [(p.x, -p.y) for p in map_.get_crosswalks()]
    outlines: list[list[tuple[float, float]]] = [[]]
    for point in points:
        outlines[-1].append(point)
        if len(outlines[-1]) > 1 and np.hypot(*np.subtract(point, outlines[-1][0])) < 1e-3:
            outlines.append([])
    theirs = np.array([np.mean(outline[:-1], axis=0) for outline in outlines if outline])
    assert len(theirs) == len(network.crosswalks)
    places = {(road.id, item.id): item.s_m for road in network.xodr.roads for item in road.objects}
    for crosswalk in network.crosswalks:
        # CARLA measures an object's t from the lane-offset line, the standard from the reference line.
        road = np.array([network.road_index[crosswalk.road_id]])
        s = np.array([places[crosswalk.road_id, crosswalk.id]])
        shift, heading = network.surface.edges.lane_offset(road, s).t_m, network.surface.heading(road, s)
        middle = crosswalk.polygon_m[:, :2].mean(axis=0)
        middle = middle + shift * np.array([-np.sin(heading[0]), np.cos(heading[0])])
        assert np.hypot(*(theirs - middle).T).min() < 0.3
