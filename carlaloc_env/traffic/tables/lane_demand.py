"""Demand for lanes and sidewalks: the route follows main streets, which carry more traffic."""

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.tables.record_arrays import Flags
from carlaloc_env.traffic.tables.walker_network import WalkerNetwork

MAIN_STREET_DEMAND = 6.0
"""How much more often drivers choose a main street than a side street, as long as it is not crowded."""
ROUTE_DEMAND = 1.0
"""The same for the direction in which the route runs: the stream comes towards it, as in rush hours."""
WALKER_DEMAND = 25.0
"""How much more often walkers choose the sidewalks of a main street: shops, stops and offices lie there."""
STREET_REACH_M = 20.0
"""Lanes this close to the route belong to the same street [m], as do its sidewalks."""
_HEIGHT_M = 4.0
"""What is farther above or below the route is another street [m]."""


def lane_demand(network: LaneNetwork, route_m: Array | None) -> Array:
    """Demand for each lane, 1 on side streets and up to `MAIN_STREET_DEMAND` along the route, (N,).

    Args:
        network: The lanes.
        route_m: Points of the town's route [m], (K, 3), world, in order; None: no street is a main street.
    """
    tables = network.tables
    if route_m is None or not len(tables.first):
        return np.ones(len(tables.first))
    near, along = along_route(tables.position_m, tables.tangent[:, :2], route_m)
    of_sample = np.where(near, np.where(along, ROUTE_DEMAND, MAIN_STREET_DEMAND), 1.0)
    demand: Array = np.add.reduceat(of_sample, tables.first) / tables.count
    return demand


def stretch_demand(demand: Array, stretch: Index, length_m: Array) -> Array:
    """Mean demand of the stretch that each lane belongs to, weighted by length, (N,)."""
    total_m = np.bincount(stretch, weights=length_m)[stretch]
    mean: Array = np.bincount(stretch, weights=demand * length_m)[stretch] / np.maximum(total_m, 1e-9)
    return mean


def walker_demand(walker_network: WalkerNetwork, route_m: Array | None) -> Array:
    """Demand for each path of walkers, 1 in side streets and up to `WALKER_DEMAND` along the route, (F,).

    Args:
        walker_network: Sidewalks and crosswalks.
        route_m: Points of the town's route [m], (K, 3), world, in order; None: no street is a main street.
    """
    path, row = walker_network.path, walker_network.row
    if route_m is None or not len(path.kind):
        return np.ones(len(path.kind))
    near, _ = along_route(row.position_m, row.tangent, route_m)
    demand: Array = np.add.reduceat(np.where(near, WALKER_DEMAND, 1.0), path.row_first) / path.row_count
    return demand


def along_route(points_m: Array, tangents: Array, route_m: Array) -> tuple[Flags, Flags]:
    """Which points (M, 3) lie in a street of the route, and which of them head where it does, (M,) each.

    Args:
        points_m: Points of lanes or sidewalks [m], (M, 3).
        tangents: Their directions, (M, 2).
        route_m: Points of the route [m], (K, 3), in order.
    """
    distance_m, row = point_tree(route_m[:, :2]).query(points_m[:, :2])
    near = (distance_m < STREET_REACH_M) & (np.abs(points_m[:, 2] - route_m[row, 2]) < _HEIGHT_M)
    direction = np.gradient(route_m[:, :2], axis=0)[row]
    return near, np.sum(direction * tangents, axis=1) > 0.0


def weighted_order(draw: np.random.Generator, weight: Array, group: Index | None = None) -> Index:
    """A random order in which heavier things come first more often, (N,).

    Efraimidis & Spirakis, "Weighted random sampling with a reservoir" (2006): by falling u^(1/w).

    Args:
        draw: Where random numbers come from.
        weight: Weight of each thing, (N,).
        group: Number of the group, from 0, to which each belongs, (N,): those of a group with one weight come
            one after the other; None: each forms a group.
    """
    uniform = draw.random(len(weight))
    drawn = uniform if group is None else uniform[group]
    order: Index = np.argsort(elementary.log(drawn) / weight, kind="stable")[::-1]
    return order
