"""A finished town: what drives, what is seen, and what is hit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.geometry.geodesy import GeoReference
from carlaloc_env.core.road.road_profile import Roughness
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.routing.route import Route

__all__ = ["SignalLenses", "Town"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Town:
    """One town; world frame ENU, metres."""

    name: str
    """Name of its folder in `maps`, or of its file."""
    network: LaneNetwork
    """Lanes, signals and crosswalks."""
    config: TownConfig
    """What `town.toml` says."""
    route: Route | None
    """The ego's route, None where the town has none."""
    geo: GeoReference
    """Geodetic position of the world origin."""
    scenery: Callable[[], tuple[Mesh, ...]]
    """Gives `chunks`, which lie in a file of their own until somebody looks."""
    collision_vertices_m: NDArray[np.float64]
    """Corners of everything solid, coarser than the scenery [m], shape (V, 3)."""
    collision_triangles: NDArray[np.int32]
    """Corner indices, shape (T, 3)."""
    collision_tags: NDArray[np.uint8]
    """Semantic `Tag` of each of these triangles, shape (T,)."""
    lenses: SignalLenses
    """Lens discs of the traffic lights."""
    lamps_m: NDArray[np.float64]
    """Light sources of the street lamps [m], shape (K, 3)."""
    roughness: Roughness | None
    """What wheels feel of the roads beyond their meshes; None where `road_roughness` is 0."""
    content_hash: str
    """Hash of the map, its `town.toml` and the version of the builder, 32 hexadecimal digits."""

    @property
    def chunks(self) -> tuple[Mesh, ...]:
        """Static scenery in squares of about 60 m."""
        return self.scenery()
