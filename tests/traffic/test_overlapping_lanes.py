"""Roads that lie on each other without a junction: where that is, and that vehicles take turns there."""

import math

import numpy as np
import pytest

from benchmarks.traffic_audit import NOBODY, audit_traffic
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.tables.occupancy import empty_occupancy
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.overlapping_lanes import CLEAR_M, empty_approaches
from carlaloc_env.traffic.world import TrafficWorld

ROAD = (
    '<road id="{id}" length="{length}" junction="-1"><link/><planView>'
    '<geometry s="0" x="{x}" y="{y}" hdg="{heading}" length="{length}"><line/></geometry></planView>'
    '<elevationProfile><elevation s="0" a="{z}" b="0" c="0" d="0"/></elevationProfile>'
    '<lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right>{lanes}</right>'
    "</laneSection></lanes></road>"
)
LANE = '<lane id="-{}" type="driving"><width sOffset="0" a="3.2" b="0" c="0" d="0"/></lane>'
HALF_M = 120.0


def crossing(angle_rad: float, *, bridge_m: float = 0.0, lanes: int = 1) -> LaneNetwork:
    """Straight one-way roads of 240 m that cross at an angle, the second one so much higher."""
    roads = ""
    for number, (heading, z) in enumerate(((0.0, 0.0), (angle_rad, bridge_m)), start=1):
        # The first lane's middle runs through the origin.
        x, y = -1.6 * math.sin(heading), 1.6 * math.cos(heading)
        roads += ROAD.format(
            id=number,
            length=2 * HALF_M,
            heading=heading,
            x=x - HALF_M * math.cos(heading),
            y=y - HALF_M * math.sin(heading),
            z=z,
            lanes="".join(LANE.format(k + 1) for k in range(lanes)),
        )
    text = f'<OpenDRIVE><header revMajor="1" revMinor="4"/>{roads}</OpenDRIVE>'
    return build_network(text.encode())


@pytest.mark.parametrize("angle_deg", [90.0, 60.0, 30.0])
def test_shared_pieces_are_where_lanes_are_near(angle_deg: float) -> None:
    """A point s before the crossing lies s·sin φ off the other lane's middle (90° at most)."""
    overlaps = TrafficTables(crossing(math.radians(angle_deg))).overlaps
    assert len(overlaps.piece.twin) == 2
    reach = CLEAR_M / math.sin(math.radians(angle_deg))
    for row in range(2):
        assert overlaps.piece.twin[row] == 1 - row
        assert overlaps.piece.enter_m[row] == pytest.approx(HALF_M - reach, abs=0.6)
        assert overlaps.piece.leave_m[row] == pytest.approx(HALF_M + reach, abs=0.6)


def test_bridges_and_neighbours_share_nothing() -> None:
    """What passes 6 m above is elsewhere; lanes side by side do not lie on each other."""
    assert len(TrafficTables(crossing(math.pi / 2, bridge_m=6.0)).overlaps.piece.twin) == 0
    pieces = TrafficTables(crossing(math.pi / 2, lanes=2)).overlaps
    # Two lanes cross two: four places, each seen from both sides.
    assert len(pieces.piece.twin) == 8


@pytest.mark.parametrize("angle_deg", [90.0, 150.0])
def test_vehicles_take_turns_where_roads_cross(angle_deg: float) -> None:
    """Five minutes of ten vehicles on two roads that cross, or meet almost head-on: no boxes overlap."""
    network = crossing(math.radians(angle_deg), lanes=2)
    report = audit_traffic(network, TrafficConfig(vehicles=10, walkers=0, seed=3), 300.0)
    assert report.overlaps == []
    assert report.longest_stand_s < 90.0
    assert report.speed_fraction > 0.3


def test_full_tables_grow_and_lose_nobody() -> None:
    """With one row for all bodies and one for all approaches, ten vehicles drive as with room enough."""
    network = crossing(math.pi / 2, lanes=2)
    tables = TrafficTables(network)
    roomy, tight = (
        TrafficWorld(network, TrafficConfig(vehicles=10, walkers=0, seed=3), tables) for _ in range(2)
    )
    roomy.reset()
    tight.reset()
    vehicles = tight._vehicles
    vehicles.traffic = vehicles.traffic._replace(
        occupancy=empty_occupancy(10, len(network.lanes), rows=1), approaches=empty_approaches(10, rows=1)
    )
    for _ in range(300):
        expected, frame = roomy.step(NOBODY), tight.step(NOBODY)
        np.testing.assert_array_equal(frame.position_m, expected.position_m)
    assert len(vehicles.occupancy.order) > 1
    assert len(vehicles.traffic.approaches.entry.row) > 1
