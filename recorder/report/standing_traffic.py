"""Vehicles and walkers that stand about a town, for its images."""

from __future__ import annotations

import numpy as np

from carlaloc_env.assets.catalog import VEHICLES, WALKERS, Tints
from carlaloc_env.core import rng
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.timeline import ActorCatalog, ActorFrame
from carlaloc_env.town.lanes.lane_network import LaneNetwork
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
    draw = rng.stream(seed, "preview/traffic")
    names = _names(draw, {n: m.weight for n, m in VEHICLES.items()}, len(drivers.heading_rad))
    sidewalk = np.array(network.sidewalks, dtype=np.intp)
    length = network.tables.length_m[sidewalk] if len(sidewalk) else np.zeros(0)
    count = np.floor(length / _PER_SIDEWALK_M + draw.uniform(size=len(length))).astype(np.intp)
    strolled = np.repeat(sidewalk, count)
    people = network.pose(strolled, draw.uniform(size=len(strolled)) * np.repeat(length, count))
    walkers = _names(draw, {n: m.weight for n, m in WALKERS.items()}, len(strolled))
    sizes = [VEHICLES[n].size_m for n in names] + [WALKERS[n].size_m for n in walkers]
    tints = [_tint(draw, VEHICLES[n].tints) for n in names] + [_tint(draw, WALKERS[n].tints) for n in walkers]
    total = len(sizes)
    tags = [int(VEHICLES[n].tag) for n in names] + [int(Tag.PEDESTRIAN)] * len(walkers)
    catalog = ActorCatalog(
        id=np.arange(total, dtype=np.uint32) + np.uint32(EGO_INSTANCE + 1),
        model=(*names, *walkers),
        tag=np.array(tags, np.uint8),
        size_m=np.array(sizes, np.float32).reshape(-1, 3),
        tint=np.array(tints, np.uint8).reshape(-1, 3),
    )
    about = np.where(draw.uniform(size=len(walkers)) < 0.5, np.pi, 0.0)
    frame = ActorFrame(
        position_m=np.concatenate([drivers.position_m, people.position_m]).astype(np.float32),
        heading_rad=np.concatenate([drivers.heading_rad, people.heading_rad + about]).astype(np.float32),
        pitch_rad=np.concatenate([drivers.pitch_rad, np.zeros(len(walkers))]).astype(np.float32),
        speed_mps=np.ones(total, np.float32),
        travelled_m=draw.uniform(0.0, 20.0, total).astype(np.float32),
        steer_rad=np.zeros(total, np.float32),
        lights=np.zeros(total, np.uint8),
    )
    return catalog, frame


def _names(draw: np.random.Generator, weights: dict[str, float], count: int) -> list[str]:
    weight = np.array(list(weights.values()))
    names = list(weights)
    return [names[k] for k in draw.choice(len(names), size=count, p=weight / weight.sum())]


def _tint(draw: np.random.Generator, tints: Tints) -> tuple[int, int, int]:
    weight = np.array([weight for _, weight in tints])
    return tints[int(draw.choice(len(tints), p=weight / weight.sum()))][0]
