"""Vehicles and walkers that stand about a town, for its images."""

from __future__ import annotations

import numpy as np

from carlaloc_env.assets.catalog import VEHICLES, WALKERS
from carlaloc_env.core import clock
from carlaloc_env.timeline.timeline import ActorCatalog, ActorFrame
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.population import catalog_of, draw_names, draw_tint
from carlaloc_env.traffic.traffic_tables import TrafficTables

_PER_SIDEWALK_M = 45.0
"""Metres of sidewalk per walker."""


def standing_traffic(
    network: LaneNetwork, vehicles: int, *, seed: int = 0
) -> tuple[ActorCatalog, ActorFrame]:
    """Vehicles at the places where traffic starts, and walkers in mid-stride on the sidewalks.

    Args:
        network: Lanes of the town.
        vehicles: How many vehicles at most.
        seed: What stands where.
    """
    lanes, stations = TrafficTables(network).starting_positions(seed, np.zeros((0, 3)))
    drivers = network.pose(lanes[:vehicles], stations[:vehicles])
    draw = clock.stream(seed, "preview/traffic")
    names = draw_names(draw, {n: m.weight for n, m in VEHICLES.items()}, len(drivers.heading_rad))
    sidewalk = np.array(network.sidewalks, dtype=np.intp)
    length = network.tables.length_m[sidewalk] if len(sidewalk) else np.zeros(0)
    count = np.floor(length / _PER_SIDEWALK_M + draw.uniform(size=len(length))).astype(np.intp)
    strolled = np.repeat(sidewalk, count)
    people = network.pose(strolled, draw.uniform(size=len(strolled)) * np.repeat(length, count))
    walkers = draw_names(draw, {n: m.weight for n, m in WALKERS.items()}, len(strolled))
    tints = [draw_tint(draw, VEHICLES[n].tints) for n in names]
    tints += [draw_tint(draw, WALKERS[n].tints) for n in walkers]
    catalog = catalog_of(names, walkers, np.array(tints, np.uint8).reshape(-1, 3))
    about = np.where(draw.uniform(size=len(walkers)) < 0.5, np.pi, 0.0)
    frame = ActorFrame(
        position_m=np.concatenate([drivers.position_m, people.position_m]).astype(np.float32),
        heading_rad=np.concatenate([drivers.heading_rad, people.heading_rad + about]).astype(np.float32),
        pitch_rad=np.concatenate([drivers.pitch_rad, np.zeros(len(walkers))]).astype(np.float32),
        speed_mps=np.ones(len(tints), np.float32),
        travelled_m=draw.uniform(0.0, 20.0, len(tints)).astype(np.float32),
        steer_rad=np.zeros(len(tints), np.float32),
        lights=np.zeros(len(tints), np.uint8),
    )
    return catalog, frame
