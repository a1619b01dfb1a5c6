"""Numbers of vehicles and walkers of a town: those asked for, or as many as its map has room for."""

import numpy as np

from carlaloc_env.map.config import TrafficCounts
from carlaloc_env.map.lanes.lane_network import LaneNetwork

VEHICLES, WALKERS = 50, 10
"""Vehicles and walkers of a map that has room for them."""
VEHICLES_PER_KM = 8.0
"""Vehicles for each kilometre of driving lane outside junctions: light traffic that no map jams under."""
WALKERS_PER_KM = 40.0
"""Walkers for each kilometre of sidewalk, at most."""
_SHORTEST_LANE_M, _SHORTEST_SIDEWALK_M = 14.0, 12.0
_NARROWEST_LANE_M, _NARROWEST_SIDEWALK_M = 2.5, 0.9


def traffic_counts(network: LaneNetwork, asked: TrafficCounts) -> tuple[int, int]:
    """Vehicles and walkers of a town: as many as are asked for, else what there is room for.

    Maps without sidewalks get no walkers; small maps get fewer vehicles.
    """
    if asked.vehicles is not None and asked.walkers is not None:
        return asked.vehicles, asked.walkers
    tables = network.tables
    least_m = np.minimum.reduceat(tables.width_m, tables.first) if network.lanes else tables.width_m
    lanes_m = sidewalks_m = 0.0
    for lane, width_m in zip(network.lanes, least_m, strict=True):
        if lane.type == "driving":
            fits = lane.length_m > _SHORTEST_LANE_M and width_m > _NARROWEST_LANE_M
            lanes_m += lane.length_m if fits and lane.junction_id is None else 0.0
        elif lane.type == "sidewalk":
            fits = lane.length_m > _SHORTEST_SIDEWALK_M and width_m > _NARROWEST_SIDEWALK_M
            sidewalks_m += lane.length_m if fits else 0.0
    vehicles = min(VEHICLES, round(VEHICLES_PER_KM * lanes_m / 1000.0))
    walkers = min(WALKERS, int(WALKERS_PER_KM * sidewalks_m / 1000.0))
    return (
        vehicles if asked.vehicles is None else asked.vehicles,
        walkers if asked.walkers is None else asked.walkers,
    )
