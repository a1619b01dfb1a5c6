"""Maps that nobody drew for this: SUMO's netgenerate makes them, netconvert writes them as OpenDRIVE."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmarks.traffic_audit import audit_traffic
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.default_route import choose_route
from carlaloc_env.scenery.kerbs.tight_turns import fit_turns
from carlaloc_env.scenery.meshing.props import InstanceIds
from carlaloc_env.scenery.street.signals_and_signs import add_signals
from carlaloc_env.traffic.traffic_config import TrafficConfig
from recorder.drive.record import RecordConfig, record

SHAPES = {
    "grid": ["--grid", "--grid.number", "3", "--grid.length", "120", "--grid.attach-length", "80"],
    "spider": ["--spider", "--spider.arm-number", "5", "--spider.circle-number", "2",
               "--spider.space-radius", "90"],
    "rand": ["--rand", "--rand.iterations", "60", "--rand.grid"],
    "rough": ["--rand", "--rand.iterations", "28", "--rand.min-distance", "70", "--rand.max-distance", "160",
              "--random-lanenumber", "true", "--turn-lanes", "1"],
}  # fmt: skip
SEEDS = {"rough": "71"}


def generated(shape: str, folder: Path) -> Path:
    """A generated town with lights and two lanes each way."""
    if not (shutil.which("netgenerate") and shutil.which("netconvert")):
        pytest.skip("netgenerate and netconvert (Debian package sumo) are not on the PATH")
    common = ["--tls.guess", "true", "--sidewalks.guess", "true", "--default.lanenumber", "2"]
    common += ["--seed", SEEDS.get(shape, "9")]
    made = ["netgenerate", *SHAPES[shape], *common, "-o", "map.net.xml"]
    subprocess.run(made, check=True, capture_output=True, cwd=folder)
    written = ["netconvert", "-s", "map.net.xml", "--opendrive-output", "map.xodr"]
    subprocess.run(written, check=True, capture_output=True, cwd=folder)
    return folder / "map.xodr"


@pytest.fixture(params=["grid", "spider"], scope="module")
def network(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> LaneNetwork:
    """Lanes of a generated town."""
    return build_network(generated(request.param, tmp_path_factory.mktemp("unseen")))


def test_lights_act_on_the_lanes_below_them(network: LaneNetwork) -> None:
    """SUMO counts lanes from the right edge: each light still stops a lane before its junction."""
    lights = network.signals
    assert len(lights) > 20
    for head in lights:
        assert len(head.lanes) == 1
        assert head.junction_lanes
        assert network.lanes[head.lanes[0]].junction_id is None


def test_posts_stand_beside_the_lanes(network: LaneNetwork) -> None:
    """SUMO's lights hang over lanes: their posts stand where no car drives."""
    _, lenses, feet = add_signals(network, lambda xy: np.zeros(len(xy)), InstanceIds())
    near = network.nearest(feet[:, :2])
    assert (near.distance_m > 0.5 * network.width_m(near.lane, near.station_m) + 0.3).all()
    assert len(lenses.signal) >= 3 * len(network.signals)


def test_traffic_flows_and_a_route_is_found(network: LaneNetwork) -> None:
    """Forty vehicles obey the lights, none stands for ever, and there is a drive of about a kilometre."""
    route = choose_route(network, fit_turns=fit_turns)
    assert route is not None
    assert 900.0 < route.length_m < 1100.0
    report = audit_traffic(network, TrafficConfig(vehicles=40, walkers=0, seed=1), 90.0)
    assert report.lines_crossed > 20
    assert report.red_runs == 0
    assert report.longest_stand_s < 80.0
    assert report.speed_fraction > 0.25
    assert report.overlap_fraction <= 0.0005


def test_vehicles_take_turns_where_roads_lie_on_each_other(tmp_path: Path) -> None:
    """Two roads of this town run into each other; without turns taken, boxes would overlap there."""
    network = build_network(generated("rough", tmp_path))
    report = audit_traffic(network, TrafficConfig(vehicles=50, walkers=0, seed=4), 100.0)
    assert report.overlap_fraction <= 0.0005
    assert report.longest_stand_s < 60.0


@pytest.mark.soak
@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_the_scripted_driver_completes_a_kilometre(
    shape: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Among the map's own traffic, without running a light or leaving the road."""
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "cache"))
    source = generated(shape, tmp_path)
    result = record(RecordConfig(map=str(source), out=tmp_path / "drive.mcap", seed=1))
    assert not result.stuck
    assert result.route_m > 900.0
    assert result.violations == {}
