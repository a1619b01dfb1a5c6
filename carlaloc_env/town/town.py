"""A finished town: its roads, its solid outline and its meshes, and a hash of all that decides a drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from carlaloc_env.core.files.array_files import arrays_hash
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.roads import TownRoads
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.map.routing.route import Route
from carlaloc_env.road.road_profile import Roughness
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.outline import TownOutline

SOLID = ("collision_vertices_m", "collision_triangles", "collision_tags", "road_events")
"""Arrays of the outline that are hit or felt."""
MOVABLE = (Tag.PEDESTRIAN, Tag.RIDER, Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.MOTORCYCLE, Tag.BICYCLE)
"""Tags of things that can move, even where they are parked."""


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

    def plan_route(
        self, points_m: Sequence[tuple[float, float]], *, loop: bool = False, length_m: float | None = None
    ) -> Route:
        """The cheapest route for a car through points; it leaves the lanes' middle in tight turns.

        Args:
            points_m: World points (x, y) near the lanes to drive on, in order.
            loop: Drive on from the last point to the first.
            length_m: Length that an open route is cut to, at its start.

        Raises:
            MapError: A point lies off the lanes, no way exists, or the route is shorter than asked.
        """
        # Here, since it brings all that knows kerbs, and the town's own route is fitted already.
        from carlaloc_env.scenery.kerbs.tight_turns import fit_turns

        return plan_route(self.network, points_m, loop=loop, length_m=length_m, fit_turns=fit_turns)

    @property
    def chunks(self) -> tuple[Mesh, ...]:
        """Static scenery in squares of about 60 m."""
        return self.scenery()


def town_hash(roads: TownRoads, outline: TownOutline) -> str:
    """Hash of a built town, 32 hexadecimal digits; the same on every processor.

    Two builds have the same hash if their lanes, signals, route, place on the Earth, road surface and solid
    parts are the same to the last bit. Lamps, lenses and meshes are only seen and do not count.
    """
    return arrays_hash(roads.to_arrays() | {name: getattr(outline, name) for name in SOLID})


def without_movables(town: Town) -> Town:
    """The same town without parked vehicles, neither seen nor hit: the traffic level `empty`."""
    outline = town.outline
    stays = ~np.isin(outline.collision_tags, MOVABLE)
    return replace(
        town,
        scenery=cache(lambda: tuple(_standing(chunk) for chunk in town.chunks)),
        outline=replace(
            outline,
            collision_triangles=outline.collision_triangles[stays],
            collision_tags=outline.collision_tags[stays],
        ),
    )


def _standing(chunk: Mesh) -> Mesh:
    """The part of a mesh that cannot move."""
    stays = ~np.isin(chunk.tag, MOVABLE)
    if stays.all():
        return chunk
    number = np.cumsum(stays) - 1
    triangles = chunk.triangles[stays[chunk.triangles[:, 0]]]
    return chunk.taking(np.flatnonzero(stays), number[triangles].astype(np.uint32))
