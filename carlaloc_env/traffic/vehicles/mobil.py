"""MOBIL: incentive and safety criterion of lane changes.

Kesting, Treiber & Helbing, "General lane-changing model MOBIL for car-following models", Transportation
Research Record 1999 (2007).
"""

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_geometry import allowed_at, station_beside
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.vehicle_state import Drivers, Fleet
from carlaloc_env.traffic.vehicles.car_following import FREE_MPS, follow
from carlaloc_env.traffic.vehicles.neighbours import find_beside

POLITENESS = 0.2
"""MOBIL's politeness p: weight of the followers' gain beside one's own; 0.2 to 0.5 in Kesting et al. 2007."""
SAFE_BRAKING_MPS2 = 3.0
"""MOBIL's b_safe: braking that a change may ask of any vehicle at most [m/s²]; 4 in Kesting et al. 2007."""
URGENT_BRAKING_MPS2 = 4.5
"""The same for changes that the path needs soon [m/s²]; ours, half of hard braking."""
_CRAWL_MPS = 0.5
"""Below this speed a change needs room to pull out [m/s]; ours."""
_PULL_OUT_ROOM_M = 4.0
"""That room ahead [m]: what a car needs to swing its front out of the lane; ours."""


@compiled
def mobil_incentive(
    occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, target: int
) -> float:
    """MOBIL's incentive: own gain in acceleration and, times the politeness, the followers' [m/s²]."""
    lane, speed = fleet.plan[v, 0], fleet.speed_mps[v]
    half = 0.5 * drivers.length_m[v]
    station = station_beside(roads, lane, fleet.station_m[v], target)
    desired = min(allowed_at(roads, lane, fleet.station_m[v]) * drivers.speed_factor[v], drivers.top_mps[v])
    _, gap, front_speed, back, back_gap, back_speed = find_beside(occupancy, roads, target, station, v, half)
    _, own_gap, own_speed, old, old_gap, old_speed = find_beside(
        occupancy, roads, lane, fleet.station_m[v], v, half
    )
    mine = follow(drivers, v, speed, desired, gap, front_speed) - follow(
        drivers, v, speed, desired, own_gap, own_speed
    )
    others = 0.0
    if back >= 0:
        others += follow(drivers, back, back_speed, FREE_MPS, back_gap, speed)
        others -= follow(drivers, back, back_speed, FREE_MPS, back_gap + 2.0 * half + gap, front_speed)
    if old >= 0:
        others += follow(drivers, old, old_speed, FREE_MPS, old_gap + 2.0 * half + own_gap, own_speed)
        others -= follow(drivers, old, old_speed, FREE_MPS, old_gap, speed)
    return mine + POLITENESS * others


@compiled
def is_safe(
    occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, target: int, urgent: bool
) -> bool:
    """Whether neither the vehicle nor its new follower would have to brake hard."""
    lane, speed = fleet.plan[v, 0], fleet.speed_mps[v]
    half = 0.5 * drivers.length_m[v]
    station = station_beside(roads, lane, fleet.station_m[v], target)
    _, gap, front_speed, back, back_gap, back_speed = find_beside(occupancy, roads, target, station, v, half)
    limit = URGENT_BRAKING_MPS2 if urgent else SAFE_BRAKING_MPS2
    if speed < _CRAWL_MPS and gap < _PULL_OUT_ROOM_M:
        return False
    if gap < 1.0 + 0.5 * max(speed - front_speed, 0.0) or back_gap < 1.0 + 0.5 * max(back_speed - speed, 0.0):
        return False
    if follow(drivers, v, speed, max(speed, 1.0), gap, front_speed) < -limit:
        return False
    return bool(back < 0 or follow(drivers, back, back_speed, max(back_speed, 1.0), back_gap, speed) > -limit)
