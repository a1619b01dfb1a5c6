"""Population of the traffic: models, colours and drivers drawn from the catalogue."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.catalog import VEHICLES, WALKERS, Tints
from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_WHEELBASE_M
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.actors import ActorCatalog
from carlaloc_env.traffic.tables.record_arrays import fill
from carlaloc_env.traffic.tables.vehicle_state import Drivers
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoView

_HEAVY_TOP_MPS = 25.0
"""Top speed of trucks and buses [m/s]: 90 km/h."""
_CYCLIST_MPS = (15.0 / 3.6, 22.0 / 3.6)
"""Least and greatest desired speed of cyclists [m/s]: 15 to 22 km/h."""
_CYCLE_EDGE_M = 0.75
"""Distance of cyclists from the edge of their lane at the kerb [m]."""


def draw_vehicles(config: TrafficConfig) -> tuple[list[str], NDArray[np.uint8]]:
    """Model names of all vehicles and their colours (N, 3)."""
    draw = clock.stream(config.seed, "traffic/fleet")
    names = draw_names(draw, {name: model.weight for name, model in VEHICLES.items()}, config.vehicles)
    return names, np.array([draw_tint(draw, VEHICLES[name].tints) for name in names], np.uint8)


def draw_drivers(names: list[str], config: TrafficConfig, egos: int) -> Drivers:
    """Drivers of N vehicles, the egos in the last rows, (N + C,).

    Headways as in towns (Treiber & Kesting, "Traffic Flow Dynamics", ch. 11); accelerations up to those of
    SUMO's vehicle classes.
    """
    draw = clock.stream(config.seed, "traffic/drivers")
    count = len(names)
    models = [VEHICLES[name] for name in names]
    tag = np.array([int(model.tag) for model in models], dtype=np.int64)
    heavy = np.isin(tag, (int(Tag.TRUCK), int(Tag.BUS))) & np.array([m.size_m[0] > 6.5 for m in models], bool)
    motorcycle, bicycle = tag == int(Tag.MOTORCYCLE), tag == int(Tag.BICYCLE)
    two_wheels = motorcycle | bicycle
    factor = np.clip(draw.normal(1.0, 0.1, count), 0.8, 1.2)
    headway = np.clip(draw.normal(1.1, 0.2, count), 0.8, 1.8)
    standstill = draw.uniform(2.0, 2.5, count)
    acceleration = draw.uniform(1.8, 2.6, count)
    change_s = np.clip(draw.normal(4.6, 0.8, count), 3.0, 7.0)
    cyclist = draw.uniform(*_CYCLIST_MPS, count)
    keeps_to_kerb = draw.random(count) < 0.01 * config.keep_right_rule_percentage
    slower = 1.0 - 0.01 * config.global_percentage_speed_difference
    distance = config.distance_to_leading_vehicle
    ego = EgoView(position_m=(0.0, 0.0, 0.0), heading_rad=0.0, speed_mps=0.0)

    def with_ego(values: Array, of_ego: float) -> Array:
        return np.append(values.astype(np.float64), np.full(egos, of_ego))

    return fill(
        Drivers,
        count + egos,
        length_m=with_ego(np.array([model.size_m[0] for model in models]), ego.length_m),
        width_m=with_ego(np.array([model.size_m[1] for model in models]), ego.width_m),
        wheelbase_m=with_ego(np.array([model.wheelbase_m for model in models]), EGO_WHEELBASE_M),
        speed_factor=with_ego(factor * slower * np.where(heavy, 0.9, 1.0), 1.0),
        top_mps=with_ego(np.where(bicycle, cyclist * slower, np.where(heavy, _HEAVY_TOP_MPS, 70.0)), 70.0),
        headway_s=with_ego(np.where(heavy, 1.6, np.where(two_wheels, 1.1, headway)), 1.2),
        standstill_m=with_ego(
            np.where(heavy, 3.0, np.where(two_wheels, 1.5, standstill))
            if distance is None
            else np.full(count, distance),
            2.0,
        ),
        acceleration_mps2=with_ego(
            np.where(heavy | bicycle, 1.2, np.where(motorcycle, 2.6, acceleration)), 1.5
        ),
        braking_mps2=with_ego(np.where(heavy | bicycle, 1.5, np.where(motorcycle, 2.5, 2.0)), 2.0),
        change_s=with_ego(np.where(two_wheels, 3.0, change_s), 4.0),
        keeps_to_kerb=with_ego(np.where(keeps_to_kerb | bicycle, 0.2, 0.0), 0.0),
        edge_distance_m=with_ego(np.where(bicycle, _CYCLE_EDGE_M, 0.0), 0.0),
    )


def draw_catalog(names: list[str], tints: NDArray[np.uint8], config: TrafficConfig) -> ActorCatalog:
    """All vehicles, then all walkers."""
    draw = clock.stream(config.seed, "traffic/people")
    walker_models = draw_names(draw, {name: model.weight for name, model in WALKERS.items()}, config.walkers)
    clothes = np.array([draw_tint(draw, WALKERS[name].tints) for name in walker_models], np.uint8)
    return catalog_of(names, walker_models, np.concatenate([tints.reshape(-1, 3), clothes.reshape(-1, 3)]))


def catalog_of(vehicles: list[str], walkers: list[str], tints: NDArray[np.uint8]) -> ActorCatalog:
    """All vehicles, then all walkers, by the names of their models and their colours (N, 3)."""
    size = [VEHICLES[name].size_m for name in vehicles] + [WALKERS[name].size_m for name in walkers]
    tags = [int(VEHICLES[name].tag) for name in vehicles] + [int(Tag.PEDESTRIAN)] * len(walkers)
    return ActorCatalog(
        id=np.arange(EGO_INSTANCE + 1, EGO_INSTANCE + 1 + len(tags), dtype=np.uint32),
        model=(*vehicles, *walkers),
        tag=np.array(tags, np.uint8),
        size_m=np.array(size, np.float32).reshape(-1, 3),
        tint=tints,
    )


def draw_names(draw: np.random.Generator, weights: Mapping[str, float], count: int) -> list[str]:
    """Names of `count` models, each as often as its weight has it."""
    probability = np.array(list(weights.values()))
    names = list(weights)
    return [names[k] for k in draw.choice(len(names), size=count, p=probability / probability.sum())]


def draw_tint(draw: np.random.Generator, tints: Tints) -> tuple[int, int, int]:
    """Colour of one actor, sRGB."""
    probability = np.array([weight for _, weight in tints])
    return tints[int(draw.choice(len(tints), p=probability / probability.sum()))][0]
