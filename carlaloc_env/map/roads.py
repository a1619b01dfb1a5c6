"""The roads of a town, as they are built from its map and as the cache returns them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.core.map_projection import ProjectedReference
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.build_lanes import road_map
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.network_arrays import from_arrays, to_arrays
from carlaloc_env.map.opendrive.records import OpenDrive
from carlaloc_env.map.road_roughness import road_levels
from carlaloc_env.map.routing.default_route import choose_route
from carlaloc_env.map.routing.plan_route import FitTurns, plan_route
from carlaloc_env.map.routing.route import Route
from carlaloc_env.road.road_profile import LevelGrid, Relief


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TownRoads:
    """Everything that traffic in a town drives on."""

    network: LaneNetwork
    """Lanes, signals and crosswalks."""
    geo: GeoReference
    """Geodetic position of the world origin."""
    route: Route | None = None
    """The ego's route, None where the town has none."""
    levels: LevelGrid | None = None
    """How rough the roads are; None: smooth."""

    def to_arrays(self) -> Arrays:
        """The roads as named arrays."""
        geo = self.geo
        arrays = {f"network/{name}": value for name, value in to_arrays(self.network).items()}
        arrays["geo"] = np.array([geo.latitude_deg, geo.longitude_deg, geo.height_m])
        if isinstance(geo, ProjectedReference):
            arrays["geo/grid"] = np.array([geo.x_m, geo.y_m, geo.turn_rad, geo.azimuth_rad])
            arrays["geo/projection"] = np.frombuffer(geo.projection.encode(), np.uint8)
        if self.levels is not None:
            arrays |= {f"levels/{name}": np.asarray(v) for name, v in self.levels.table._asdict().items()}
        if self.route is not None:
            values = {field.name: getattr(self.route, field.name) for field in fields(Route)}
            arrays |= {f"route/{name}": np.asarray(v) for name, v in values.items() if v is not None}
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Arrays, read: Callable[[], OpenDrive], seed: int) -> TownRoads:
        """Restores the roads from their arrays.

        Args:
            arrays: What `to_arrays` made of them.
            read: Reads their map when it is asked for.
            seed: Number from which their relief was drawn.
        """
        level, line = _below(arrays, "levels/"), _below(arrays, "route/")
        levels, route = None, None
        # Copies: compiled functions take arrays of a file, which are read-only, for another type.
        if level:
            levels = LevelGrid(tuple(level["low_m"].tolist()), float(level["cell_m"]), level["level"].copy())
        if line:
            plain: dict[str, Any] = {k: v.copy() if v.ndim else v.item() for k, v in line.items()}
            route = Route(**plain)
        network = from_arrays(_below(arrays, "network/"), lambda: road_map(read(), relief_on(seed, levels)))
        return cls(network=network, levels=levels, route=route, geo=_geo(arrays))


def _geo(arrays: Arrays) -> GeoReference:
    place = dict(zip(("latitude_deg", "longitude_deg", "height_m"), arrays["geo"].tolist(), strict=True))
    if "geo/grid" not in arrays:
        return GeoReference(**place)
    grid = zip(("x_m", "y_m", "turn_rad", "azimuth_rad"), arrays["geo/grid"].tolist(), strict=True)
    return ProjectedReference(projection=arrays["geo/projection"].tobytes().decode(), **place, **dict(grid))


def _below(arrays: Arrays, prefix: str) -> Arrays:
    """Arrays whose names begin so, by the rest of their names."""
    return {name[len(prefix) :]: value for name, value in arrays.items() if name.startswith(prefix)}


def relief_on(seed: int, levels: LevelGrid | None) -> Relief | None:
    """Waves of rough roads, drawn from a number; None for smooth ones."""
    return None if levels is None else Relief(seed, levels)


def build_roads(
    xodr: OpenDrive, config: TownConfig, seed: int, fit_turns: FitTurns | None = None
) -> TownRoads:
    """The roads of a map.

    Args:
        xodr: The map.
        config: Settings of `town.toml`, or those chosen in its place.
        seed: Number from which their relief is drawn.
        fit_turns: Fits the tight turns of the route to a car; None: it keeps to the lanes' middle.

    Raises:
        MapError: No lane is for cars.
    """
    levels = road_levels(xodr.roads, config)
    network = build_network(xodr, relief_on(seed, levels))
    types = sorted({lane.type for lane in network.lanes})
    if "driving" not in types:
        first_types = ", ".join(types[:8])
        raise MapError(
            f"{xodr.source}: no lane is of type driving, so no car can drive there; it has {first_types}"
        )
    # Else the map's own reference, else the equator at Greenwich's meridian.
    geo = config.geo or xodr.geo or GeoReference(latitude_deg=0.0, longitude_deg=0.0)
    return TownRoads(network=network, levels=levels, route=_route(network, config, fit_turns), geo=geo)


def _route(network: LaneNetwork, config: TownConfig, fit_turns: FitTurns | None) -> Route | None:
    wanted = config.route
    if not wanted.points:
        return choose_route(network, fit_turns=fit_turns)
    route = plan_route(
        network, wanted.points, loop=wanted.loop, length_m=wanted.length_m, fit_turns=fit_turns
    )
    return route.starting_at(wanted.start) if wanted.start is not None else route
