"""Roads from OpenStreetMap: joints, radii, reachability, sides, heights, lights, restrictions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tomllib
from shared_fixtures.worlds.imported_towns import made
from shared_fixtures.worlds.street_sketches import OXFORD, Sketch, bridge, village

from carlaloc_env.authoring.geometry.plan_view_curves import Pose
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.openstreetmap.axes import between, radius
from carlaloc_env.openstreetmap.import_town import import_town
from carlaloc_env.openstreetmap.turning_places import PLACE_NAME
from carlaloc_env.scenery.kerbs.tight_turns import fit_turns
from carlaloc_env.traffic.signals import SignalPlan, SignalState


def middles(network: LaneNetwork, kind: str) -> np.ndarray:
    """Points on the middles of all lanes of a type, (N, 2)."""
    tables = network.tables
    rows = [
        np.arange(tables.count[lane.index]) + tables.first[lane.index]
        for lane in network.lanes
        if lane.type == kind
    ]
    points: np.ndarray = tables.position_m[np.concatenate(rows), :2]
    return points


def covered(network: LaneNetwork, points: np.ndarray) -> float:
    """Share of points (N, 2) within 2 m of a driving lane's middle."""
    driven = middles(network, "driving")
    return float(np.mean([np.hypot(*(driven - p).T).min() < 2.5 for p in points]))


def test_a_village(tmp_path: Path) -> None:
    town, network = made(village(), tmp_path)
    assert town.report["built_m"] == town.report["streets_m"]
    assert len(network.signals) >= 4
    limits = {round(lane.speed_limit_mps * 3.6) for lane in network.lanes if lane.type == "driving"}
    assert limits == {50}, "residential streets have the town's limit also where no house stands"
    # A town's origin is the middle of its streets.
    assert covered(network, np.column_stack([np.arange(-190, 80, 5.0), np.zeros(54)]) - (10.0, 15.0)) > 0.95


def test_left_hand_traffic_mirrors_the_lanes(tmp_path: Path) -> None:
    _, network = made(village(OXFORD), tmp_path)
    assert all(lane.kerb_side == 1 for lane in network.lanes if lane.type == "driving")


def test_a_bridge_clears_the_street_below(tmp_path: Path) -> None:
    sketch = bridge()
    _, network = made(sketch, tmp_path)
    low, high, steepest = 1e9, 0.0, 0.0
    for lane in network.lanes:
        if lane.type != "driving":
            continue
        s = np.linspace(0.0, lane.length_m, max(3, int(lane.length_m)))
        pose = network.exact_pose(np.full(len(s), lane.index), s)
        xyz = np.asarray(pose[0])
        steepest = max(steepest, float(np.abs(pose[2]).max()))
        at = np.hypot(xyz[:, 0], xyz[:, 1]) < 4.0
        if at.any():
            low, high = min(low, float(xyz[at, 2].min())), max(high, float(xyz[at, 2].max()))
    assert high - low >= 5.0
    assert steepest <= 0.1


def test_roundabouts_keep_their_island(tmp_path: Path) -> None:
    sketch = Sketch()
    angle = np.linspace(0.0, 2 * np.pi, 17)
    ring = [(round(18 * float(np.cos(a)), 2), round(18 * float(np.sin(a)), 2)) for a in angle[:-1]]
    sketch.way(*ring, ring[0], highway="secondary", junction="roundabout")
    for k in (0, 4, 8, 12):
        x, y = ring[k]
        sketch.way((x, y), (x * 8, y * 8), highway="secondary")
    _, network = made(sketch, tmp_path)
    tables = network.tables
    nearest = min(
        float(
            np.hypot(
                *tables.position_m[int(tables.first[k.index]) :][: int(tables.count[k.index]), :2].T
            ).min()
        )
        for k in network.lanes
        if k.type == "driving"
    )
    assert nearest > 12.0


def test_one_way_streets_at_the_box_are_led_back(tmp_path: Path) -> None:
    """A pair of carriageways gets a loop at both ends; streets farther apart get a street round the town."""
    sketch = Sketch()
    sketch.way((-300, 0), (0, 0), (110, 0), (300, 0), highway="primary", oneway="yes", name="East")
    sketch.way((300, 14), (0, 14), (-300, 14), highway="primary", oneway="yes", name="West")
    sketch.way((0, 14), (0, 0), highway="residential")
    sketch.way((0, 0), (0, -100), (0, -200), highway="residential", oneway="yes", name="South")
    sketch.way((110, -200), (110, -100), (110, 0), highway="residential", oneway="yes", name="North")
    sketch.way((0, -100), (110, -100), highway="residential")
    town, _ = made(sketch, tmp_path)
    assert town.report["built_m"] > 0.95 * town.report["streets_m"]
    assert town.report["turning_places_m"] > 100


def test_parts_that_meet_beyond_the_box_are_joined(tmp_path: Path) -> None:
    """A cross of streets, and a pair of streets apart from it, one of which leaves the box one-way."""
    sketch = Sketch()
    sketch.way((-200, 0), (0, 0), (200, 0), highway="residential")
    sketch.way((0, -200), (0, 0), (0, 200), highway="residential")
    sketch.way((60, 200), (60, 80), (200, 80), highway="residential", oneway="yes", name="Apart")
    sketch.way((60, 80), (60, 30), highway="residential", name="Apart")
    town, network = made(sketch, tmp_path)
    assert town.report["built_m"] == town.report["streets_m"]
    assert covered(network, np.column_stack([np.full(20, 60.0), np.linspace(90, 190, 20)])) == 1.0
    assert not [why for why in town.report["left_out"].values() if "leads to and back" in why]


def test_streets_that_turn_back_too_tightly_are_built_to_their_end(tmp_path: Path) -> None:
    """Two carriageways 8 m apart that meet at their far end: too close for any bend."""
    sketch = Sketch()
    sketch.way((-150, 0), (0, 0), (60, 0), (150, 0), highway="residential")
    turn = [(0, 0), (0, 205), (4, 220), (8, 205), (8, 40), (60, 0)]
    sketch.way(*turn, highway="residential", oneway="yes")
    _, network = made(sketch, tmp_path)
    middle = np.array([0.0, 110.0])
    assert covered(network, np.column_stack([np.zeros(30), np.linspace(30, 200, 30)]) - middle) > 0.95
    assert covered(network, np.column_stack([np.full(30, 8.0), np.linspace(60, 200, 30)]) - middle) > 0.95


def test_the_default_route_follows_the_towns_own_streets(tmp_path: Path) -> None:
    """About a kilometre round, so that a drive of any duration goes on, and planned as any route is."""
    town, network = made(village(), tmp_path)
    asked = tomllib.loads(town.toml)["route"]
    route = plan_route(network, [(x, y) for x, y in asked["points"]], loop=asked["loop"], fit_turns=fit_turns)
    assert route.closed
    assert 500.0 < route.length_m < 1500.0
    names = {road.id: road.name for road in read_opendrive(tmp_path / "town.xodr").roads}
    driven = {names[network.lanes[lane].road_id] for lane in set(route.lane.tolist())}
    assert not [name for name in driven if PLACE_NAME in name]


def test_a_turn_that_is_not_allowed_has_no_lane(tmp_path: Path) -> None:
    """Where streets meet; a bend of one street stays."""

    def turns(banned: bool) -> int:
        sketch = Sketch()
        west = sketch.way((-200, 0), (0, 0), highway="residential")
        sketch.way((0, 0), (200, 0), highway="residential")
        north = sketch.way((0, 0), (0, 200), highway="residential")
        if banned:
            via = sketch.nodes[0, 0]
            members = (("way", west, "from"), ("node", via, "via"), ("way", north, "to"))
            sketch.relation(*members, type="restriction", restriction="no_left_turn")
        _, network = made(sketch, tmp_path)
        return sum(lane.type == "driving" for lane in network.lanes)

    assert turns(False) - turns(True) == 1


def test_no_sidewalk_crosses_the_mouth_of_a_street_that_leads_in(tmp_path: Path) -> None:
    """Walkers stay on sidewalks, so that one across a lane puts them before the cars."""
    sketch = Sketch()
    sketch.way((-250, 0), (0, 0), (250, 0), (250, 200), highway="residential", sidewalk="both")
    sketch.way((250, 200), (60, 200), (-250, 200), highway="residential", sidewalk="both")
    sketch.way((60, 200), (40, 60), (0, 0), highway="residential", sidewalk="both", oneway="yes")
    _, network = made(sketch, tmp_path)
    apart = middles(network, "sidewalk")[:, None] - middles(network, "driving")
    assert np.hypot(apart[..., 0], apart[..., 1]).min() > 1.5


def test_the_same_file_gives_the_same_bytes(tmp_path: Path) -> None:
    path = village().write(tmp_path / "a.osm")
    first, second = import_town(path), import_town(path)
    assert (first.xodr, first.toml, first.features) == (second.xodr, second.toml, second.features)


def test_absurd_tags_are_built_as_if_they_were_missing(tmp_path: Path) -> None:
    sketch = village()
    sketch.way(
        (80, 0), (80, 120), highway="residential", lanes="900", width="narrow", maxspeed="∞", layer="x"
    )
    sketch.block(100, 20, 12, 12, building="yes", building__levels="900", height="very")
    town, _ = made(sketch, tmp_path)
    assert '"levels": 900' not in town.features


@pytest.mark.parametrize("angle_deg", [12.0, 25.0, 40.0])
def test_acute_legs(angle_deg: float, tmp_path: Path) -> None:
    sketch = Sketch()
    sketch.way((-250, 0), (0, 0), (250, 0), highway="secondary")
    x, y = 240 * np.cos(np.radians(angle_deg)), 240 * np.sin(np.radians(angle_deg))
    sketch.way((0, 0), (round(float(x), 2), round(float(y), 2)), highway="residential")
    _, network = made(sketch, tmp_path)
    beyond_the_fork = np.linspace(0.5, 0.95, 40)[:, None] * (x, y)
    assert covered(network, beyond_the_fork - (0.0, y / 2)) == 1.0


@pytest.mark.parametrize("oneway", ["no", "yes"])
def test_lit_crossings_between_junctions_have_lights(oneway: str, tmp_path: Path) -> None:
    """All traffic stops at once, long enough to walk; unlit ones have none, near ones are a junction's."""
    sketch = Sketch()
    sketch.way((-200, 0), (-100, 0), (0, 0), (20, 0), (100, 0), (200, 0), highway="secondary", oneway=oneway)
    sketch.way((200, 0), (200, -100), (-200, -100), (-200, 0), highway="residential", oneway=oneway)
    sketch.way((0, 0), (0, -100), highway="residential")
    for x, kind in ((-100, "traffic_signals"), (20, "traffic_signals"), (100, "uncontrolled")):
        sketch.node(x, 0, highway="crossing", crossing=kind)
    _, network = made(sketch, tmp_path)
    places = np.array([signal.T_world_signal[:2, 3] for signal in network.signals]) - (0.0, 50.0)
    near = [k for k, at in enumerate(places) if np.hypot(*(at - (-100.0, 0.0))) < 25.0]
    assert len(near) == (1 if oneway == "yes" else 2)
    assert all(np.hypot(*at) < 40.0 for k, at in enumerate(places) if k not in near)
    heads = [network.signals[k] for k in near]
    assert len({head.junction_id for head in heads}) == 1
    assert all(head.lanes and head.junction_lanes for head in heads)
    plan = SignalPlan.from_network(network)
    shown = np.array([plan.at(round(second * 1e9)).state[near] for second in np.arange(0.0, 120.0, 0.5)])
    assert (shown == shown[:, :1]).all()
    stopped = shown[:, 0] == SignalState.RED
    assert 0.2 < stopped.mean() < 0.6
    middles = np.array([(walk.start_m + walk.end_m)[:2] / 2 for walk in network.crosswalks]) - (0.0, 50.0)
    assert (np.hypot(*(middles - (-100.0, 0.0)).T) < 9.0).sum() == 1
    assert (np.hypot(*(middles - (100.0, 0.0)).T) < 15.0).sum() == 1


def test_a_pose_straight_behind_is_not_joined_by_a_straight_ahead() -> None:
    """Both ends of a short street in one junction: the path ends at its end, however tight it is."""
    path = between(Pose(0.0, 0.0, 0.0), Pose(-14.5, 0.0, 0.0))
    assert (path.end.x, path.end.y) == pytest.approx((-14.5, 0.0), abs=1e-6)
    assert radius(path) < 1.0
    assert between(Pose(0.0, 0.0, 0.0), Pose(14.5, 0.0, 0.0)).length == pytest.approx(14.5)


def test_bulbs_of_narrow_lanes_are_wider(tmp_path: Path) -> None:
    """By a metre in the middle of a lane of 2.6 m: 2.5 for each that it lacks of 3."""
    radii = []
    for width in ("7", "5.2"):
        sketch = Sketch()
        sketch.way((-200, 0), (200, 0), highway="residential", width=width)
        _, network = made(sketch, tmp_path)
        (bulb, *_) = (k for k in network.lanes if k.type == "driving" and k.junction_id is not None)
        s = np.linspace(0.0, bulb.length_m, 200)
        radii.append(1.0 / np.abs(network.exact_pose(np.full(len(s), bulb.index), s)[3]).max())
    assert radii[1] - radii[0] == pytest.approx(1.0, abs=0.02)
