"""An ego and a vehicle whose ways cross, without lights: one of them goes first, whenever they come."""

import math
import re

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shared_fixtures.worlds.maps import CROSSING

from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoBox, EgoView, passes_ego
from carlaloc_env.traffic.world import TrafficWorld

EGO_X_M = 1.75
"""The ego's lane leads north at this x; the junction lies about the origin [m]."""
CRUISE_MPS, BRAKING_MPS2, START_MPS2 = 8.3, 2.0, 1.5
"""The ego's speed, and how it brakes and starts."""
GAP_M, SIDE_M = 2.0, 0.25
"""The ego stops so far before a vehicle that is within this distance of its way [m]."""

Box = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float, float]


@pytest.fixture(scope="module")
def tables() -> TrafficTables:
    """Four arms of one lane each way, without lights."""
    text = re.sub(rb"<signals>.*?</signals>", b"", CROSSING.read_bytes(), flags=re.DOTALL)
    return TrafficTables(build_network(text))


def box_of(x_m: float, y_m: float, heading_rad: float, length_m: float, width_m: float) -> Box:
    """Centre, two axes, two half sides."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return np.array([x_m, y_m]), np.array([c, s]), np.array([-s, c]), 0.5 * length_m, 0.5 * width_m


def apart_m(a: Box, b: Box) -> float:
    """Greatest distance of two boxes along the directions of their sides [m], negative where they overlap."""
    gaps = []
    for axis in (a[1], a[2], b[1], b[2]):
        reach = sum(abs(box[1] @ axis) * box[3] + abs(box[2] @ axis) * box[4] for box in (a, b))
        gaps.append(abs((b[0] - a[0]) @ axis) - reach)
    return float(max(gaps))


def free_way_m(ego_y_m: float, other: Box) -> float:
    """How far the ego can drive before it comes near a box [m]."""
    for way in np.arange(0.0, 30.0, 0.5):
        wide = box_of(EGO_X_M, ego_y_m + way, 0.5 * math.pi, EGO_SIZE_M[0], EGO_SIZE_M[1] + 2.0 * SIDE_M)
        if apart_m(wide, other) < 0.0:
            return float(way)
    return math.inf


def meet(tables: TrafficTables, plan: tuple[int, int, int], ego_y_m: float) -> tuple[float | None, float]:
    """Time at which both are through [s], None if they are not after 45 s, and their least distance [m].

    The vehicle comes at 8 m/s from 20 m along its first lane. The ego drives straight on, and brakes only
    for a body that is in its way.
    """
    world = TrafficWorld(tables.network, TrafficConfig(vehicles=1, walkers=0, seed=1, warm_up_s=0.0), tables)
    world.reset()
    fleet, size = world._vehicles.fleet, world.catalog.size_m[0]
    fleet.plan[0], fleet.goals[0], fleet.past[0] = -1, -1, -1
    fleet.plan[0, :3], fleet.goals[0, 0] = plan, plan[1]
    fleet.station_m[0], fleet.speed_mps[0] = 20.0, 8.0
    y, speed, least = ego_y_m, CRUISE_MPS, math.inf
    for step in range(45 * 20):
        ego = EgoView(position_m=(EGO_X_M, y, 0.0), heading_rad=0.5 * math.pi, speed_mps=speed)
        frame = world.step(ego)
        x, other_y, _ = frame.position_m[0].tolist()
        other = box_of(x, other_y, float(frame.heading_rad[0]), float(size[0]), float(size[1]))
        least = min(least, apart_m(box_of(EGO_X_M, y, 0.5 * math.pi, EGO_SIZE_M[0], EGO_SIZE_M[1]), other))
        way = max(free_way_m(y, other) - GAP_M, 0.05)
        needed = 0.5 * speed * speed / way
        change = -min(needed, 7.0) if needed > BRAKING_MPS2 else START_MPS2 if way > 1.0 else -4.0
        speed = min(max(speed + 0.05 * change, 0.0), CRUISE_MPS)
        y += 0.05 * speed
        if fleet.plan[0, 0] == plan[2] and fleet.station_m[0] > 8.0 and y > 20.0:
            return 0.05 * step, least
    return None, least


LEFT_FROM_RIGHT, LEFT_FROM_AHEAD, ON_FROM_LEFT = (1, 22, 14), (5, 23, 2), (9, 26, 2)
"""Ways that cross the ego's: left turns from its right and from ahead, straight on from its left."""
STRAIGHT = 17
"""A lane of the ego's way, from 72 to 42 m before the junction's middle."""


@pytest.mark.parametrize(
    ("plan", "ego_y_m"),
    [
        (LEFT_FROM_RIGHT, -75.0),
        (LEFT_FROM_RIGHT, -72.0),
        (LEFT_FROM_RIGHT, -71.0),
        (LEFT_FROM_AHEAD, -54.0),
        (ON_FROM_LEFT, -67.0),
    ],
)
def test_one_goes_first(tables: TrafficTables, plan: tuple[int, int, int], ego_y_m: float) -> None:
    """The vehicle, in the junction, notices the ego: it stops where the ego passes it, or drives on."""
    through_s, least = meet(tables, plan, ego_y_m)
    assert through_s is not None
    assert through_s < 25.0
    assert least > 0.1


def test_a_vehicle_passes_a_standing_ego_where_there_is_room(tables: TrafficTables) -> None:
    """On a straight lane, against the rectangle that its body sweeps; the last step may reach a metre on."""
    world = TrafficWorld(tables.network, TrafficConfig(vehicles=1, walkers=0, seed=1, warm_up_s=0.0), tables)
    world.reset()
    fleet, drivers = world._vehicles.fleet, world._vehicles.drivers
    fleet.plan[0], fleet.past[0] = -1, -1
    fleet.plan[0, 0], fleet.station_m[0] = STRAIGHT, 8.0
    start, forward, left = np.array([EGO_X_M, -64.0]), np.array([0.0, 1.0]), np.array([-1.0, 0.0])
    reach_m, half, width = 12.0, 0.5 * drivers.length_m[0], 0.5 * drivers.width_m[0] + 0.2

    def swept(more_m: float) -> shapely.Polygon:
        ends = start - half * forward, start + (reach_m + more_m + half) * forward
        return shapely.MultiPoint([end + side * width * left for end in ends for side in (-1, 1)]).convex_hull

    least, most, random, passed = swept(0.0), swept(1.01), np.random.default_rng(3), 0
    for _ in range(400):
        x, y = start + random.uniform(-8, 24) * forward + random.uniform(-5, 5) * left
        turn = random.uniform(-math.pi, math.pi)
        half_length, half_width = 0.5 * EGO_SIZE_M[0], 0.5 * EGO_SIZE_M[1]
        ego = EgoBox(x, y, 0.0, math.cos(turn), math.sin(turn), 0.0, half_length, half_width)
        body = shapely.affinity.rotate(
            shapely.box(x - half_length, y - half_width, x + half_length, y + half_width),
            turn,
            use_radians=True,
        )
        passes = passes_ego(tables.roads, drivers, fleet, ego, 0, reach_m)
        passed += passes
        assert passes or most.intersects(body)
        assert not passes or not least.buffer(-0.01).intersects(body)
    assert 100 < passed < 300
