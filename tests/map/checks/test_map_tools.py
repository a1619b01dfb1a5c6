"""Our own towns before other people's tools, and their drives as town.toml describes them."""

import heapq
import itertools
import os
import pathlib
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.towns import network_at

from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.map.routing.route import Route

MAPS = sorted((pathlib.Path(__file__).parents[3] / "maps").glob("*/town.xodr"))
PAPER_LENGTH_M = {
    "Town01": 678.0,
    "Town03": 970.0,
    "Town04": 2108.0,
    "Town05": 473.0,
    "Town06": 266.0,
    "Town07": 747.0,
    "Town10": 1115.0,
}
each_map = pytest.mark.parametrize("path", MAPS, ids=[path.parent.name for path in MAPS])


def drive(path: pathlib.Path) -> tuple[LaneNetwork, TownConfig, Route]:
    network = network_at(path)
    config = TownConfig.from_toml(path.parent / "town.toml")
    route = config.route
    return network, config, plan_route(network, route.points, loop=route.loop, length_m=route.length_m)


@each_map
def test_quality_checker_finds_nothing(path: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """ASAM's checker for OpenDRIVE 1.7."""
    checker = shutil.which("qc_opendrive")
    if checker is None:
        pytest.skip("qc_opendrive (pip package asam-qc-opendrive) is not on the PATH")
    result = tmp_path / "result.xqar"
    config = tmp_path / "config.xml"
    config.write_text(
        f'<Config><Param name="InputFile" value="{path}"/><CheckerBundle application="xodrBundle">'
        f'<Param name="resultFile" value="{result}"/></CheckerBundle></Config>',
        encoding="utf-8",
    )
    subprocess.run([checker, "-c", str(config)], check=True, capture_output=True, cwd=tmp_path)
    root = ElementTree.parse(result).getroot()
    assert len(list(root.iter("Checker"))) > 20
    assert [issue.get("description") for issue in root.iter("Issue")] == []


@each_map
def test_netconvert_imports_it(path: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """SUMO; a lane that begins beside another (a pocket, an exit) is the only thing it may remark on."""
    netconvert = shutil.which("netconvert")
    if netconvert is None:
        pytest.skip("netconvert (Debian package sumo) is not on the PATH")
    home = {"SUMO_HOME": os.environ.get("SUMO_HOME", "/usr/share/sumo")}
    if not (pathlib.Path(home["SUMO_HOME"]) / "data/typemap").is_dir():
        pytest.skip("SUMO's types of roads (Debian package sumo-tools) are not installed")
    command = [netconvert, "--opendrive", str(path), "-o", str(tmp_path / "net.xml")]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | home)
    assert done.returncode == 0, done.stderr
    remarks = [line for line in done.stderr.splitlines() if line.startswith(("Warning", "Error"))]
    assert [line for line in remarks if "is not connected from any incoming edge" not in line] == []


@each_map
def test_the_drive_has_the_papers_length(path: pathlib.Path) -> None:
    _, config, route = drive(path)
    target = PAPER_LENGTH_M[path.parent.name]
    assert route.length_m == pytest.approx(target, rel=0.01)
    assert config.route.length_m == pytest.approx(target)
    assert route.closed == config.route.loop
    if route.closed:
        gap = route.position_m[0] - route.position_m[-1]
        assert np.linalg.norm(gap) < 2.0
        turned = np.unwrap(np.append(route.heading_rad, route.heading_rad[0]))
        assert abs(np.degrees(turned[-1] - turned[-2])) < 5.0


LANE_CHANGES = {"Town06": 1}
"""Drives that change lanes; Town06's moves over to its exit."""


@each_map
def test_the_drive_follows_lanes(path: pathlib.Path) -> None:
    """From lane to following lane, and on their centres but where it changes to the one beside."""
    network, config, route = drive(path)
    assert (config.route.start is None) != route.closed  # an open route starts at its first point
    changes = [(k, a, b) for k, (a, b) in enumerate(itertools.pairwise(route.lane)) if a != b]
    aside = [(k, a, b) for k, a, b in changes if b not in network.lanes[a].successors]
    assert all(b in (network.lanes[a].left, network.lanes[a].right) for _, a, b in aside)
    assert len(aside) == LANE_CHANGES.get(path.parent.name, 0)
    _, offset, _ = (np.asarray(v) for v in network.nearest(route.position_m)[1:])
    calm = np.full(len(offset), True)
    for k, _, _ in aside:
        calm[max(k - 40, 0) : k + 40] = False
    assert np.abs(offset[calm]).max() < 0.1


@each_map
@pytest.mark.long
def test_the_drive_is_as_long_in_carla(path: pathlib.Path) -> None:
    """Shortest way through the same points over carla.Map's topology."""
    carla = pytest.importorskip("carla")
    town = carla.Map(path.parent.name, path.read_text(encoding="utf-8"))
    _, config, route = drive(path)
    if not config.route.loop:
        pytest.skip("the drive is no loop")
    points = [*config.route.points, config.route.points[0]]
    places = [_waypoint(carla, town, route, x, y) for x, y in points]
    following: dict[tuple[int, int, int], list[Any]] = {}
    for a, b in town.get_topology():
        following.setdefault(_key(a), []).append(b)
    total = sum(_distance(a, b, following) for a, b in itertools.pairwise(places))
    assert total == pytest.approx(route.length_m, abs=3.0)


def _key(waypoint: Any) -> tuple[int, int, int]:
    return (waypoint.road_id, waypoint.section_id, waypoint.lane_id)


def _waypoint(carla: Any, town: Any, route: Route, x: float, y: float) -> Any:
    z = route.position_m[np.argmin(np.hypot(route.position_m[:, 0] - x, route.position_m[:, 1] - y)), 2]
    return town.get_waypoint(carla.Location(x, -y, float(z)))


def _to_end(waypoint: Any, following: dict[tuple[int, int, int], list[Any]]) -> float:
    """Way to the end of the lane section; CARLA's own method runs on to the end of the road."""
    ahead = [w for w in waypoint.next_until_lane_end(0.5) if _key(w) == _key(waypoint)]
    steps = [waypoint, *ahead, following[_key(waypoint)][0]]
    return sum(_plan_gap(a, b) for a, b in itertools.pairwise(steps))


def _plan_gap(a: Any, b: Any) -> float:
    p, q = a.transform.location, b.transform.location
    return float(np.hypot(p.x - q.x, p.y - q.y))


def _distance(a: Any, b: Any, following: dict[tuple[int, int, int], list[Any]]) -> float:
    """Way from waypoint a to waypoint b along lanes [m]."""
    ahead = _to_end(a, following) - _to_end(b, following)
    if _key(a) == _key(b) and ahead > 0:
        return ahead
    queue = [(_to_end(a, following), 0, start) for start in following[_key(a)]]
    done: set[tuple[int, int, int]] = set()
    count = 0
    while queue:
        way, _, lane = heapq.heappop(queue)
        if _key(lane) == _key(b):
            return way + _to_end(lane, following) - _to_end(b, following)
        if _key(lane) in done:
            continue
        done.add(_key(lane))
        length = _to_end(lane, following)
        for after in following[_key(lane)]:
            count += 1
            heapq.heappush(queue, (way + length, count, after))
    raise AssertionError(f"no way from {_key(a)} to {_key(b)}")


def test_town03_has_what_it_is_known_for() -> None:
    """Loop through a roundabout, under a street and over a hill; size and density of the plan."""
    path = MAPS[[m.parent.name for m in MAPS].index("Town03")]
    network, _, route = drive(path)
    z = route.position_m[:, 2]
    assert z.min() == pytest.approx(-6.0, abs=0.05)
    assert z.max() == pytest.approx(8.0, abs=0.05)
    assert np.abs(route.slope).max() == pytest.approx(0.078, abs=0.003)
    driving = [lane for lane in network.lanes if lane.type == "driving"]
    assert 13.0 < sum(lane.length_m for lane in driving) / 1000 < 17.0
    assert len({lane.junction_id for lane in driving} - {None}) >= 10
    centre = np.array([-84.0, 15.0])
    ring = np.hypot(*(route.position_m[:, :2] - centre).T) < 24.0
    angles = np.unwrap(np.arctan2(*(route.position_m[ring, :2] - centre).T[::-1]))
    # Three quarters from arm to arm, less the two half-angles at which entry and exit meet the ring.
    assert np.radians(200.0) < angles[-1] - angles[0] < np.radians(270.0)
