"""Builds the roads of a town from its map."""

from __future__ import annotations

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.default_zones import choose_zones
from carlaloc_env.town.lanes.build_network import build_network
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.opendrive.records import OpenDrive
from carlaloc_env.town.roads.road_classes import road_levels
from carlaloc_env.town.routing.default_route import choose_route
from carlaloc_env.town.routing.route import Route, plan_route
from carlaloc_env.town.town_roads import TownRoads, relief_on


def choose_config(xodr: OpenDrive, name: str) -> TownConfig:
    """Zones for a map without a `town.toml`."""
    return choose_zones(build_network(xodr), TownConfig(name=name))


def build_roads(xodr: OpenDrive, config: TownConfig, seed: int) -> TownRoads:
    """The roads of a map.

    Args:
        xodr: The map.
        config: Settings of `town.toml`, or those chosen in its place.
        seed: Number from which their relief is drawn.

    Raises:
        MapError: No lane is for cars.
    """
    levels = road_levels(xodr.roads, config)
    network = build_network(xodr, relief_on(seed, levels))
    types = sorted({lane.type for lane in network.lanes})
    if "driving" not in types:
        known = ", ".join(types[:8])
        raise MapError(
            f"{xodr.source}: no lane is of type driving, so no car can drive there; it has {known}"
        )
    # Else the map's own reference, else the equator at Greenwich's meridian.
    geo = config.geo or xodr.geo or GeoReference(latitude_deg=0.0, longitude_deg=0.0)
    return TownRoads(network=network, levels=levels, route=_route(network, config), geo=geo)


def _route(network: LaneNetwork, config: TownConfig) -> Route | None:
    wanted = config.route
    if not wanted.points:
        return choose_route(network)
    route = plan_route(network, wanted.points, loop=wanted.loop, length_m=wanted.length_m, for_car=True)
    return route.starting_at(wanted.start) if wanted.start is not None else route
