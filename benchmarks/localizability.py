"""Localizability by LiDAR scans along each town's route: `benchmarks/localizability.py [TOWN ...]`.

Point-to-plane ICP minimises Σ (nᵢ · (R pᵢ + t − qᵢ))². Linearised at the true pose, point pᵢ with unit
normal nᵢ has the Jacobian Jᵢ = [(pᵢ × nᵢ)ᵀ, nᵢᵀ] for a small rotation and a shift. So a scan of N points has
the information H = Σ JᵢᵀJᵢ / N per point, for errors of 1 m along the normals. Its eigenvalues
show where an odometry degenerates (Zhang, Kaess, Singh: On Degeneracy of Optimization-based State Estimation
Problems, ICRA 2016; Tuna et al.: X-ICP, T-RO 2023). Rotation is unknown, too: the information that
remains about the shift of the sensor is the Schur complement S = H_tt − H_tr H_rr⁻¹ H_rt, the inverse of its
marginal covariance. The least eigenvalue of S lies between 0 (a shift is not observable) and 1/3 (in a box).

For each town, with the paper's LiDAR and without traffic: the median over the route, the worst 100 m, and the
longest stretch below a tenth of Town03's median. `firm`: leaves and grass hold nothing. `--curve` draws it.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.map.routing.route import Route
from carlaloc_env.map.sources import known_towns
from carlaloc_env.raycast import Hits
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.lidar.scan_pattern import ScanPattern
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.weather.presets import weather_by_name

REFERENCE = "Town03"
FRACTION, LONGEST_M = 0.1, 100.0
"""No stretch longer than this lies below this fraction of the reference's median."""
_BAR = 60
_LEAST_SPREAD = 1e-9
"""Rotations that move no point are left out of the inverse, below this share of the strongest."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Localizability:
    """How strongly a scan holds a shift of the sensor."""

    strengths: Array
    """Eigenvalues of the information about the shift per point, ascending, shape (3,)."""
    directions: Array
    """Unit directions that belong to them, along the axes of the points, columns of (3, 3)."""

    @property
    def least(self) -> float:
        """Strength along the weakest direction, 0 … 1/3."""
        return float(self.strengths[0])

    @property
    def weakest(self) -> Array:
        """Direction along which the sensor is held least, shape (3,)."""
        weakest: Array = self.directions[:, 0]
        return weakest


def localizability(points_m: Array, normals: Array) -> Localizability:
    """Strength with which planes constrain a shift, with the rotation unknown.

    Args:
        points_m: Points from the sensor, along any axes [m], shape (N, 3).
        normals: Unit normals of the surfaces on which they lie, shape (N, 3); a row of zeros is a point that
            holds nothing, such as one on leaves, and still counts among the N.
    """
    strengths, directions = np.linalg.eigh(shift_information(points_m, normals))
    return Localizability(strengths=np.maximum(strengths, 0.0), directions=directions)


def shift_information(points_m: Array, normals: Array) -> Array:
    """Information about the shift per point with the rotation marginalised out, shape (3, 3).

    Args:
        points_m: Points from the sensor, along any axes [m], shape (N, 3).
        normals: Unit normals, or rows of zeros, shape (N, 3).
    """
    if not len(points_m):
        return np.zeros((3, 3))
    jacobian = np.concatenate([np.cross(points_m, normals), normals], axis=1)
    information = jacobian.T @ jacobian / len(points_m)
    rotation, coupling, shift = information[:3, :3], information[:3, 3:], information[3:, 3:]
    known = np.linalg.pinv(rotation, rcond=_LEAST_SPREAD, hermitian=True)
    left: Array = shift - coupling.T @ known @ coupling
    return left


def longest_below(station_m: Array, values: Array, limit: float) -> tuple[float, float]:
    """Longest stretch along which values stay below a limit: its length and its beginning [m].

    Args:
        station_m: Evenly spaced stations, ascending [m], shape (K,).
        values: Value at each, shape (K,).
        limit: Limit of the values.
    """
    below: Mask = values < limit
    if not below.any():
        return 0.0, 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], below, [False]]).astype(np.int8)))
    first, last = edges[::2], edges[1::2]
    longest = int(np.argmax(last - first))
    step = float(station_m[1] - station_m[0]) if len(station_m) > 1 else 0.0
    return float(last[longest] - first[longest]) * step, float(station_m[first[longest]])


def weakest_stretch(station_m: Array, values: Array, length_m: float = 100.0) -> tuple[float, float]:
    """Least mean over a stretch of some length, and where that begins [m].

    Args:
        station_m: Evenly spaced stations, ascending [m], shape (K,).
        values: Value at each, shape (K,).
        length_m: Length of the stretch [m]; the whole line where it is shorter.
    """
    step = float(station_m[1] - station_m[0]) if len(station_m) > 1 else length_m
    window = min(max(round(length_m / step), 1), len(values))
    sums = np.concatenate([[0.0], np.cumsum(values)])
    means = (sums[window:] - sums[:-window]) / window
    worst = int(np.argmin(means))
    return float(means[worst]), float(station_m[worst])


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


def route_localizability(town: Town, lidar: LidarConfig, *, step_m: float = 5.0) -> RouteLocalizability:
    """Scans of a standing car every few metres of the route, with the true normals of what they meet.

    Args:
        town: The town; the road is empty.
        lidar: The LiDAR with its mount; its range noise is left out.
        step_m: Distance of the scans [m].

    Raises:
        EvaluationError: The town has no route.
        RaycastError: open3d cannot be imported on this machine.
    """
    if town.route is None:
        raise EvaluationError(f"{town.name} has no route; give it one in town.toml")
    stage = SensorStage(town, seed=0, weather=weather_by_name("ClearNoon"))
    rays, mount = stage.rays(), lidar.mount.T_base_sensor
    directions = directions_past_the_car(stage, lidar)
    station = np.arange(0.0, town.route.length_m, step_m)
    found = np.zeros((len(station), 3))
    for k, T in enumerate(_poses(town.route, station)):
        aimed = directions @ T[:3, :3].T
        hits, normals = rays.surfaces(T[:3, :3] @ mount[:3, 3] + T[:3, 3], aimed, lidar.range_max_m)
        seen = (hits.range_m >= lidar.range_min_m) & np.isfinite(hits.range_m)
        points = aimed[seen] * hits.range_m[seen, None].astype(np.float64)
        normal = normals[seen].astype(np.float64)
        every = localizability(points, normal)
        firm = localizability(points, np.where(is_loose(hits)[seen, None], 0.0, normal))
        found[k] = every.least, firm.least, abs(firm.weakest @ T[:3, 0])
    stage.close()
    return RouteLocalizability(station_m=station, least=found[:, 0], firm=found[:, 1], along=found[:, 2])


def directions_past_the_car(stage: SensorStage, lidar: LidarConfig) -> Array:
    """Directions of a LiDAR's rays in `base_link` that do not meet the car itself, shape (N, 3)."""
    mount = lidar.mount.T_base_sensor
    rays = ScanPattern(lidar, stage).rays.sweep(0, 0)
    directions = rays.turned(rays.directions) @ mount[:3, :3].T
    origins = np.broadcast_to(mount[:3, 3], directions.shape)
    own = stage.rays().cast_ego(origins, directions, lidar.range_max_m)
    past: Array = directions[~np.isfinite(own.range_m)]
    return past


def is_loose(hits: Hits) -> Mask:
    """Whether hits lie on leaves or grass, which have no planes, shape (N,)."""
    loose: Mask = (hits.tag == Tag.VEGETATION) & (hits.material != Material.BARK)
    return loose


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


def draw_curve(curve: RouteLocalizability, full: float, limit: float) -> None:
    """One line every 20 m; `full` fills it."""
    step = max(round(20.0 / (curve.station_m[1] - curve.station_m[0])), 1)
    for k in range(0, len(curve.station_m), step):
        firm, least = curve.firm[k : k + step].mean(), curve.least[k : k + step].mean()
        bar = "#" * min(round(_BAR * firm / full), _BAR)
        mark = "<" if firm < limit else " "
        print(f"  {curve.station_m[k]:6.0f} m  {least:.4f}  {firm:.4f} {mark} {bar}")


def main() -> None:
    """Measure the towns that were asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("towns", nargs="*", help="all when left out")
    parser.add_argument("--step", type=float, default=5.0, help="distance of the scans [m]")
    parser.add_argument("--curve", action="store_true", help="draw it along the route")
    arguments = parser.parse_args()
    lidar = next(c for c in rig_by_name("paper").sensors if isinstance(c, LidarConfig))
    names = list(arguments.towns or known_towns())
    curves = {
        name: route_localizability(load_town(name), lidar, step_m=arguments.step)
        for name in dict.fromkeys([REFERENCE, *names])
    }
    full = float(np.median(curves[REFERENCE].firm))
    limit = FRACTION * full
    print(f"limit {limit:.5f}: a tenth of {REFERENCE}'s median of firm returns")
    print(
        "town     route m   median all   firm     worst 100 m: firm   from m   longest below limit m   from m"
    )
    for name in names:
        curve = curves[name]
        worst, begin = weakest_stretch(curve.station_m, curve.firm, LONGEST_M)
        length, start = longest_below(curve.station_m, curve.firm, limit)
        verdict = "" if length <= LONGEST_M else "   TOO LONG"
        print(
            f"{name:8} {curve.station_m[-1]:7.0f} {np.median(curve.least):12.4f} {np.median(curve.firm):8.4f}"
            f" {worst:19.4f} {begin:8.0f} {length:23.0f} {start:8.0f}{verdict}"
        )
        if arguments.curve:
            draw_curve(curve, full, limit)


if __name__ == "__main__":
    main()
