"""How well the scans along a town's route hold the car, without traffic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.lidar.config import LidarConfig
from carlaloc_env.sensors.lidar.scan_pattern import ScanPattern
from carlaloc_env.town.routing.route import Route
from carlaloc_env.town.town import Town
from carlaloc_env.weather.parameters import weather_by_name
from recorder.slam.localizability import localizability


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RouteLocalizability:
    """`Localizability.least` along a route, arrays of K stations."""

    station_m: Array
    """Distance from the start of the route [m], shape (K,)."""
    least: Array
    """With all returns, shape (K,)."""
    firm: Array
    """The same where leaves and grass hold nothing, whose planes odometries reject, shape (K,)."""
    along: Array
    """Cosine between the weakest direction of firm returns and the road, shape (K,)."""


def route_localizability(
    town: Town,
    lidar: LidarConfig,
    *,
    step_m: float = 5.0,
    progress: Callable[[int, int], None] | None = None,
) -> RouteLocalizability:
    """Scans of a standing car every few metres of the route, with the true normals of what they meet.

    Args:
        town: The town; nobody else is on the road.
        lidar: The LiDAR with its mount; its range noise is left out.
        step_m: Distance of the scans [m].
        progress: Told of every scan.

    Raises:
        EvaluationError: The town has no route.
        RaycastError: open3d cannot be imported on this machine.
    """
    if town.route is None:
        raise EvaluationError(f"{town.name} has no route; give it one in town.toml")
    stage = SensorStage(town, seed=0, weather=weather_by_name("ClearNoon"))
    rays, mount = stage.rays(), lidar.mount.T_base_sensor
    directions = ScanPattern(lidar, stage).directions @ mount[:3, :3].T
    own = rays.cast_ego(np.broadcast_to(mount[:3, 3], directions.shape), directions, lidar.range_max_m)
    directions = directions[~np.isfinite(own.range_m)]
    station = np.arange(0.0, town.route.length_m, step_m)
    found = np.zeros((len(station), 3))
    for k, T in enumerate(_poses(town.route, station)):
        aimed = directions @ T[:3, :3].T
        hits, normals = rays.surfaces(T[:3, :3] @ mount[:3, 3] + T[:3, 3], aimed, lidar.range_max_m)
        seen = (hits.range_m >= lidar.range_min_m) & np.isfinite(hits.range_m)
        points = aimed[seen] * hits.range_m[seen, None].astype(np.float64)
        normal = normals[seen].astype(np.float64)
        every = localizability(points, normal)
        loose = (hits.tag[seen] == Tag.VEGETATION) & (hits.material[seen] != Material.BARK)
        firm = localizability(points, np.where(loose[:, None], 0.0, normal))
        found[k] = every.least, firm.least, abs(firm.weakest @ T[:3, 0])
        if progress is not None:
            progress(k + 1, len(station))
    stage.close()
    return RouteLocalizability(station_m=station, least=found[:, 0], firm=found[:, 1], along=found[:, 2])


def _poses(route: Route, station_m: Array) -> Array:
    """Poses of `base_link`, shape (K, 4, 4)."""
    at = route.at(station_m)
    c, s, cp, sp = (f(a) for a in (at.heading_rad, at.pitch_rad) for f in (np.cos, np.sin))
    T = np.zeros((len(station_m), 4, 4))
    T[:, 0, 0], T[:, 0, 1], T[:, 0, 2] = c * cp, -s, -c * sp
    T[:, 1, 0], T[:, 1, 1], T[:, 1, 2] = s * cp, c, -s * sp
    T[:, 2, 0], T[:, 2, 2] = sp, cp
    T[:, :3, 3], T[:, 3, 3] = at.position_m, 1.0
    return T
