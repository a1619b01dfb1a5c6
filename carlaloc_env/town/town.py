"""A finished town: what drives, what is seen, what is hit, and the hash of these.

A finished town: its roads, meshes and solid parts.

The roads of a town, as `road_building` makes them of a map and as the cache returns them.

The standing part of a town, as `scenery` builds it and as the cache returns it.

The name of a built town: a hash of all arrays that decide the course of a drive in it.

Two builds have the same hash if their lanes, signals, route, place on the Earth and road surface are the same
to the last bit, and so is all that can be hit. What is only seen does not count: lamps, lenses and meshes.

Towns without the vehicles parked in them: the traffic level `empty`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.files.array_cache import Arrays, arrays_hash
from carlaloc_env.core.geodesy import GeoReference, ProjectedReference
from carlaloc_env.road.road_profile import LevelGrid, Relief, Roughness
from carlaloc_env.scene.materials import SignalLenses, Tag
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.lanes import build_network
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.lanes.lanes import road_map
from carlaloc_env.town.opendrive.records import OpenDrive
from carlaloc_env.town.routing.route import Route


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
        arrays = {f"network/{name}": value for name, value in build_network.to_arrays(self.network).items()}
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
        """The roads again.

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
        network = build_network.from_arrays(
            _below(arrays, "network/"), lambda: road_map(read(), relief_on(seed, levels))
        )
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TownOutline:
    """The part that is needed where nothing is drawn: what is hit and felt, and where lights are."""

    collision_vertices_m: Array
    """Corners of all that is solid [m], shape (V, 3)."""
    collision_triangles: NDArray[np.int32]
    """Corner indices, shape (T, 3)."""
    collision_tags: NDArray[np.uint8]
    """Semantic `Tag` of each of these triangles, shape (T,)."""
    lenses: SignalLenses
    """Lenses of the traffic lights."""
    road_events: Array
    """Events that wheels feel beside the meshes, columns of `road.road_events`, shape (N, 7)."""
    lamps_m: Array
    """Light sources of the street lamps [m], shape (K, 3)."""

    def to_arrays(self) -> Arrays:
        """The outline as named arrays."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        lenses = {f"lenses/{f.name}": getattr(self.lenses, f.name) for f in fields(SignalLenses)}
        return arrays | {name: value for name, value in lenses.items() if value is not None}

    @staticmethod
    def from_arrays(arrays: Arrays) -> TownOutline:
        """The outline again.

        Raises:
            KeyError: An array is missing.
        """
        prefix = "lenses/"
        lenses = {name[len(prefix) :]: value for name, value in arrays.items() if name.startswith(prefix)}
        return TownOutline(lenses=SignalLenses(**lenses), **{name: arrays[name] for name in _ARRAYS})


_ARRAYS = tuple(field.name for field in fields(TownOutline) if field.name != "lenses")
"""Fields of an outline that are arrays."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TownScenery(TownOutline):
    """The standing part of a town."""

    chunks: tuple[Mesh, ...]
    """Everything that is seen, in squares."""


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


SOLID = ("collision_vertices_m", "collision_triangles", "collision_tags", "road_events")
"""Arrays of the outline that are hit or felt."""


def town_hash(roads: TownRoads, outline: TownOutline) -> str:
    """Hash of a built town, 32 hexadecimal digits; the same on every processor."""
    return arrays_hash(roads.to_arrays() | {name: getattr(outline, name) for name in SOLID})


MOVABLE = (Tag.PEDESTRIAN, Tag.RIDER, Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.MOTORCYCLE, Tag.BICYCLE)
"""Tags of things that can move, even where they are parked."""


def without_movables(town: Town) -> Town:
    """The same town without anything movable: neither to be seen nor to be hit."""
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
