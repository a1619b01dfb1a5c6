"""Left-hand traffic: a mirrored village is driven as the village in a mirror, and a ring on its left."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from shared_fixtures.worlds.maps import VILLAGE
from shared_fixtures.worlds.mirrored import mirrored

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.default_route import choose_route
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.scenery.kerbs.tight_turns import fit_turns
from carlaloc_env.traffic.signals import SignalPlan
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.world import TrafficWorld
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode

MIRROR = np.array([1.0, -1.0, 1.0])
RING = """<OpenDRIVE><header revMajor="1" revMinor="6"/>
<road name="Ring" length="{length}" id="1" junction="-1" rule="{rule}"><link>
<predecessor elementType="road" elementId="1" contactPoint="end"/>
<successor elementType="road" elementId="1" contactPoint="start"/></link>
<type s="0" type="town"><speed max="50" unit="km/h"/></type><planView>
<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>
<geometry s="100" x="100" y="0" hdg="0" length="{half}"><arc curvature="{bend}"/></geometry>
<geometry s="{second}" x="100" y="60" hdg="{pi}" length="100"><line/></geometry>
<geometry s="{third}" x="0" y="60" hdg="{pi}" length="{half}"><arc curvature="{bend}"/></geometry></planView>
<lanes><laneSection s="0"><left>{left}</left><center><lane id="0" type="none"/></center>
<right>{right}</right></laneSection></lanes></road></OpenDRIVE>"""
LANE = (
    '<lane id="{0}" type="driving"><link><predecessor id="{0}"/><successor id="{0}"/></link>'
    '<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
)


def ring(rule: str) -> str:
    """A closed road of 388.5 m, anticlockwise, a lane each way."""
    half = 30.0 * np.pi
    return RING.format(
        length=200.0 + 2.0 * half, half=half, second=100.0 + half, third=200.0 + half, bend=1.0 / 30.0,
        pi=np.pi, rule=rule, left=LANE.format(1), right=LANE.format(-1),
    )  # fmt: skip


@pytest.fixture(scope="module")
def pair() -> tuple[LaneNetwork, LaneNetwork]:
    """The village, and the village in a mirror."""
    return build_network(VILLAGE), build_network(mirrored(VILLAGE))


@pytest.fixture(scope="module")
def partner(pair: tuple[LaneNetwork, LaneNetwork]) -> list[int]:
    """The mirrored village's number of each of the village's lanes."""
    index = {(lane.road_id, lane.section, lane.lane_id): lane.index for lane in pair[1].lanes}
    return [index[lane.road_id, lane.section, -lane.lane_id] for lane in pair[0].lanes]


def test_lanes_run_as_in_a_mirror(pair: tuple[LaneNetwork, LaneNetwork], partner: list[int]) -> None:
    """Places, directions, links; left and right change, and with them the kerb's side."""
    assert {lane.kerb_side for lane in pair[0].lanes} == {-1}
    assert {lane.kerb_side for lane in pair[1].lanes} == {1}
    for lane in pair[0].lanes:
        other = pair[1].lanes[partner[lane.index]]
        assert other.forward == lane.forward
        assert set(other.successors) == {partner[n] for n in lane.successors}
        assert other.left == (None if lane.right is None else partner[lane.right])
        assert other.right == (None if lane.left is None else partner[lane.left])
        own, its = (
            network.pose([n] * 5, np.linspace(0.0, lane.length_m, 5))
            for network, n in zip(pair, (lane.index, other.index), strict=True)
        )
        np.testing.assert_allclose(its.position_m, own.position_m * MIRROR, atol=1e-9)
        np.testing.assert_allclose(np.sin(its.heading_rad), -np.sin(own.heading_rad), atol=1e-9)


def test_signals_and_signs_speak_to_the_same_lanes(
    pair: tuple[LaneNetwork, LaneNetwork], partner: list[int]
) -> None:
    """Poles stand at the other kerb and face the same drivers, who stop at the same lines."""
    assert len(pair[0].signals) == 3
    for own, its in zip(pair[0].signals, pair[1].signals, strict=True):
        assert its.lanes == tuple(partner[n] for n in own.lanes)
        assert set(its.junction_lanes) == {partner[n] for n in own.junction_lanes}
        np.testing.assert_allclose(its.stop_station_m, own.stop_station_m, atol=1e-9)
        for column in (0, 3):
            expected = own.T_world_signal[:3, column] * MIRROR
            np.testing.assert_allclose(its.T_world_signal[:3, column], expected, atol=1e-9)
    stops = [
        [(sign.kind, sign.lanes) for sign in network.static_signs if sign.kind == "stop"] for network in pair
    ]
    assert stops[0]
    assert stops[1] == [(kind, tuple(partner[n] for n in lanes)) for kind, lanes in stops[0]]


def test_ranks_and_phases_are_the_same(pair: tuple[LaneNetwork, LaneNetwork], partner: list[int]) -> None:
    """Who turns right there crosses the oncoming traffic, as who turns left does here."""
    ours, theirs = (TrafficTables(network).roads.lane for network in pair)
    assert len(set(ours.rank.tolist())) >= 3
    np.testing.assert_array_equal(theirs.rank[partner], ours.rank)
    np.testing.assert_allclose(theirs.turn_rad[partner], -ours.turn_rad, atol=1e-9)
    np.testing.assert_allclose(theirs.stop_m[partner], ours.stop_m, atol=1e-9)
    plans = [SignalPlan.from_network(network) for network in pair]
    for stamp_ns in range(0, 60_000_000_000, 700_000_000):
        np.testing.assert_array_equal(plans[1].at(stamp_ns).state, plans[0].at(stamp_ns).state)


def sides_m(network: LaneNetwork, kinds: tuple[str, ...], *, walkers: int, vehicles: int) -> Array:
    """How far left of the middle of their lanes road users go, seen in their own direction [m]."""
    config = TrafficConfig(vehicles=vehicles, walkers=walkers, seed=5, warm_up_s=20.0)
    frame = TrafficWorld(network, config).reset()
    position = frame.position_m.astype(np.float64)
    near = network.nearest(position, kinds)
    pose = network.pose(near.lane, near.station_m)
    left = np.stack([-np.sin(pose.heading_rad), np.cos(pose.heading_rad)], axis=-1)
    offset = np.sum((position - pose.position_m)[:, :2] * left, axis=1)
    along = np.cos(frame.heading_rad - pose.heading_rad)
    return offset[np.abs(along) > 0.9] * np.sign(along[np.abs(along) > 0.9])


def test_walkers_keep_to_the_side_of_the_cars(pair: tuple[LaneNetwork, LaneNetwork]) -> None:
    right, left = (sides_m(network, ("sidewalk",), walkers=24, vehicles=0) for network in pair)
    assert np.median(right) < -0.1
    assert np.median(left) > 0.1


def test_cycles_keep_near_the_kerb(
    pair: tuple[LaneNetwork, LaneNetwork], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "carlaloc_env.traffic.population.draw_names",
        lambda draw, weights, count: ["bicycle"] * count if "bicycle" in weights else [*weights][:count],
    )
    right, left = (sides_m(network, ("driving",), walkers=0, vehicles=6) for network in pair)
    assert np.median(right) == pytest.approx(-(1.6 - 0.75), abs=0.1)
    assert np.median(left) == pytest.approx(1.6 - 0.75, abs=0.1)


def test_the_route_is_the_one_in_the_mirror(pair: tuple[LaneNetwork, LaneNetwork]) -> None:
    points = [(1.6, -40.0), (1.6, 20.0), (158.4, 0.0)]
    own, its = (
        plan_route(network, [(x, sign * y) for x, y in points], fit_turns=fit_turns)
        for network, sign in zip(pair, (1.0, -1.0), strict=True)
    )
    assert its.length_m == pytest.approx(own.length_m, abs=1e-6)
    np.testing.assert_allclose(its.position_m, own.position_m * MIRROR, atol=1e-6)


class Steady:
    """A generator of a driver who makes no errors, which have a side."""

    def normal(self, mean: float = 0.0, _: float = 1.0) -> float:
        return mean

    def uniform(self, low: float = 0.0, high: float = 1.0) -> float:
        return 0.5 * (low + high)


def track_m(folder: Path, xodr: bytes, toml: str) -> Array:
    """Where the scripted driver drives in a town without traffic, every tick (N, 3)."""
    folder.mkdir()
    (folder / "town.xodr").write_bytes(xodr)
    (folder / "town.toml").write_text(toml)
    out = folder / "drive.mcap"
    result = record(RecordConfig(map=str(folder / "town.xodr"), out=out, traffic="empty", duration_s=18.0))
    assert result.collisions == 0
    assert not result.violations
    return np.array(Episode.load(out).ego["position_m"])


@pytest.mark.long
def test_the_driver_drives_as_in_a_mirror(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Along a street and round a corner, on smooth roads and without the driver's small errors."""
    monkeypatch.setattr(
        "recorder.devices.scripted.steering.clock", SimpleNamespace(stream=lambda *_: Steady())
    )
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "cache"))
    toml = '[town]\nroad_roughness = 0\ndefault_zone = "rural"\n[route]\npoints = {}\n'
    points = [[1.6, -40.0], [1.6, 20.0], [158.4, 0.0]]
    own = track_m(tmp_path / "village", VILLAGE.read_bytes(), toml.format(points))
    its = track_m(tmp_path / "mirrored", mirrored(VILLAGE), toml.format([[x, -y] for x, y in points]))
    assert np.ptp(own[:, 1]) > 40.0
    np.testing.assert_allclose(its, own * MIRROR, atol=0.05)


@pytest.mark.long
def test_cars_go_round_a_ring_on_its_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a closed road lane 1 is driven along s and lane −1 against it; nobody drives the wrong way."""
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "cache"))
    path, out = tmp_path / "ring.xodr", tmp_path / "drive.mcap"
    path.write_text(ring("LHT"))
    result = record(RecordConfig(map=str(path), out=out, duration_s=20.0))
    assert result.collisions == 0
    assert not result.violations
    assert result.driven_m > 100.0
    network, episode = build_network(path), Episode.load(out)
    route = choose_route(network, fit_turns=fit_turns)
    assert route is not None
    assert route.closed
    (lane,) = {network.lanes[n].lane_id for n in route.lane.tolist()}
    radius_m = 30.0 - 1.75 * lane
    assert route.length_m == pytest.approx(200.0 + 2.0 * np.pi * radius_m, rel=2e-3)
    at = network.nearest(episode.ego["position_m"][::200])
    assert {network.lanes[n].lane_id for n in at.lane.tolist()} == {lane}
    frame = episode.timeline().actors_at(10_000_000_000)
    assert len(frame) == 6
    near = network.nearest(frame.position_m.astype(np.float64))
    pose = network.pose(near.lane, near.station_m)
    assert np.all(np.cos(frame.heading_rad - pose.heading_rad) > 0.9)
    for n in near.lane.tolist():
        assert network.lanes[n].forward == (network.lanes[n].lane_id > 0)
