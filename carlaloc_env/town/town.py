"""A finished town: its roads, meshes and solid parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.road.road_profile import Roughness
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.routing.route import Route
from carlaloc_env.town.town_roads import TownRoads
from carlaloc_env.town.town_scenery import TownOutline


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Town:
    """One town; world frame ENU, metres."""

    name: str
    """Name of its folder in `maps`, or of its file."""
    config: TownConfig
    """Settings of `town.toml`."""
    roads: TownRoads
    """Lanes and surfaces for traffic."""
    outline: TownOutline
    """Collision mesh, bumps of the road, and lights."""
    scenery: Callable[[], tuple[Mesh, ...]]
    """Gives `chunks`, which are read from a file of their own at first use."""
    roughness: Roughness | None = None
    """Roughness for the wheels beyond the roads' meshes; None where `road_roughness` is 0."""
    town_hash: str = ""
    """Hash of the built town as `town_hash` makes it, 32 hexadecimal digits."""

    @property
    def network(self) -> LaneNetwork:
        """Lanes, signals and crosswalks."""
        return self.roads.network

    @property
    def geo(self) -> GeoReference:
        """Where the world lies on the Earth."""
        return self.roads.geo

    @property
    def route(self) -> Route | None:
        """The ego's route, None where the town has none."""
        return self.roads.route

    @property
    def chunks(self) -> tuple[Mesh, ...]:
        """Static scenery in squares of about 60 m."""
        return self.scenery()
