"""Scores the map that a system built on a drive against the town in which it was driven."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.cells import first_in_cells
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.scene.mesh import merge
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.town import without_movables
from carlaloc_env.weather.schedule import weather_of
from recorder.dataset.rig_sensors import lidar_of
from recorder.dataset.scans import Scan
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_of
from recorder.episode.traffic_level import traffic_level
from recorder.evaluation.align import Similarity
from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.straight_paths import roll_turn
from recorder.evaluation.trajectory import Trajectory
from recorder.laboratory.map_scores import Distances, GhostRule, MapScore, find_ghosts, measure, score_map
from recorder.laboratory.surface_cloud import Region, SurfaceCloud, sample_surface
from recorder.laboratory.true_map import Progress, TrueMap, ever_visible
from recorder.view.sequence_view import in_world
from recorder.writers.base import DEFAULT_EPOCH_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class MapTruthConfig:
    """Configuration of map scores: the drive, distances and samples."""

    drive: Path
    """Episode of the drive."""
    map: Path | str | None = None
    """Town of the drive, name or file; None: the one that the episode names."""
    traffic: str = "dynamic"
    """Traffic level of the drive as the map's maker saw it: its movers leave ghosts and hide surfaces."""
    rig: str = "paper"
    """Rig whose LiDAR decides about visibility."""
    reach_m: float = 50.0
    """Horizontal distance from the driven path within which surfaces and maps count [m]."""
    distances_m: tuple[float, ...] = (0.1, 0.2, 0.5)
    """Distances d of precision and recall [m]."""
    points_per_m2: float = 4.0
    """Density of the points on true surfaces [1/m²]."""
    voxel_m: float = 0.1
    """Edge of the voxels that keep one point of the map each, so that dense parts count no more than others
    [m]; 0: all points count."""
    look_every_m: float = 2.0
    """Way between two looks of the LiDAR that decide about visibility [m]."""
    seed: int = 0
    """Seed of the points on true surfaces."""
    ghosts: GhostRule = field(default_factory=GhostRule)
    """When a point is a ghost."""

    def __post_init__(self) -> None:
        if self.voxel_m < 0 or not self.look_every_m > 0:
            raise ConfigError("the voxels of a map must not be below 0 m, and looks must lie above 0 m apart")
        if not self.distances_m or min(self.distances_m) <= 0:
            raise ConfigError("distances of precision and recall must be above 0 m, such as 0.1,0.2")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapResult:
    """Scores of one map."""

    name: str
    """Name of the map."""
    scores: tuple[MapScore, ...]
    """Rows by part, class and distance."""
    points_m: Array
    """Points that counted, in the world, shape (N, 3)."""
    distance_m: Array
    """Their distances from the nearest surface [m], shape (N,)."""
    ghost: Mask
    """Which of them movers have left, shape (N,)."""

    @property
    def ghost_rate(self) -> float:
        """Share of the map's points that are ghosts, 0–1."""
        return float(self.ghost.mean())

    def to_mapping(self) -> dict[str, Any]:
        """The result as JSON values, without the points."""
        return {
            "map": self.name,
            "points": len(self.points_m),
            "ghosts": int(self.ghost.sum()),
            "ghost_rate": self.ghost_rate,
            "scores": [asdict(score) for score in self.scores],
        }


class MapJudge:
    """A stretch of a drive as the truth of maps: made once, it scores any number of them.

    Args:
        config: Which drive.
        span_ns: First and last Unix time of the stretch [ns].
        report: Called while visibility is found out.

    Raises:
        CarlaLocError: the drive, its town or its rig is missing or not valid.
        EvaluationError: the stretch lies outside the drive.
    """

    def __init__(
        self, config: MapTruthConfig, span_ns: tuple[int, int], report: Progress = lambda *_: None
    ) -> None:
        self.config = config
        level, lidar = traffic_level(config.traffic), lidar_of(rig_by_name(config.rig))
        episode = Episode.load(config.drive)
        self._timeline = level.select(episode.timeline())
        first, last = (ns - DEFAULT_EPOCH_NS for ns in span_ns)
        end_ns = self._timeline.end_ns
        if first < 0 or last - STEP_NS > end_ns:
            raise EvaluationError(
                f"the truth's stamps lie outside {config.drive} (0…{end_ns / 1e9:g} s after "
                f"{DEFAULT_EPOCH_NS / 1e9:.0f}); give the drive that it was made of"
            )
        # Points of the last sweep are later than its stamp.
        self._span_ns = (first, min(last + lidar.sweep_ns, end_ns))
        town = town_of(episode, config.map)
        town = town if level.parked_cars else without_movables(town)
        stamps = np.arange(self._span_ns[0], self._span_ns[1] + 1, STEP_NS)
        path_m = self._timeline.ego.motion(stamps).position_m
        covered_m = np.append(0.0, np.cumsum(np.sqrt(np.sum(np.diff(path_m, axis=0) ** 2, axis=1))))
        looks = np.unique(covered_m // config.look_every_m, return_index=True)[1]
        self._region = Region(path_m, config.reach_m)
        mesh = merge(town.chunks)
        self._truth = TrueMap(mesh)
        self.surface: SurfaceCloud = sample_surface(
            mesh, points_per_m2=config.points_per_m2, seed=config.seed, region=self._region
        )
        stage = SensorStage(town, seed=config.seed, weather=weather_of("ClearNoon"))
        points = self.surface.points_xyz_m.astype(np.float64)
        self.visible = ever_visible(points, stage.rays(), self._timeline, lidar, stamps[looks], report)

    def judge(self, points_m: Array, transform: Similarity | None = None, *, name: str = "map") -> MapResult:
        """Scores of a map.

        Args:
            points_m: Points of the map in its own frame [m], shape (N, 3).
            transform: Maps that frame to the world; None: it is the world.
            name: Name of the map.

        Raises:
            EvaluationError: no point lies near the drive.
        """
        config = self.config
        if transform is not None:
            points_m = transform.scale * (points_m @ transform.R.T) + transform.t
        points_m = thinned(points_m[self._region.contains(points_m)], config.voxel_m)
        nearest = self._truth.nearest(points_m)
        distances: Distances = measure(points_m, nearest, self.surface, self.visible)
        return MapResult(
            name=name,
            scores=score_map(distances, config.distances_m),
            points_m=points_m,
            distance_m=distances.map_m,
            ghost=find_ghosts(points_m, distances.map_m, self._timeline, self._span_ns, config.ghosts),
        )


def transform_of_map(result: EvaluationResult) -> Similarity:
    """The transform that lays a map over the world, that of the trajectory.

    About a nearly straight path the alignment leaves the roll open, which turns walls far off that path by
    metres. There the roll is the one that fits the attitudes.
    """
    fit = result.transform
    if not result.roll_from_attitudes:
        return fit
    R_roll = transforms.quat_to_matrix(roll_turn(result.truth, result.estimate))
    centre_m = result.truth.position_m.mean(axis=0)
    return Similarity(R=R_roll @ fit.R, t=R_roll @ (fit.t - centre_m) + centre_m, scale=fit.scale)


def thinned(points_m: Array, voxel_m: float) -> Array:
    """The first point in each voxel of a grid, shape (M, 3); all of them where the edge is 0 m."""
    return points_m[first_in_cells(points_m, voxel_m)] if voxel_m else points_m


def build_map(scans: Iterable[Scan], poses: Trajectory, *, voxel_m: float = 0.1) -> Array:
    """A map out of sweeps, each point laid where the LiDAR was at its own time, shape (N, 3) [m].

    Args:
        scans: Sweeps.
        poses: Poses of the LiDAR in the map's frame, interpolated at the points' times.
        voxel_m: Edge of the voxels that keep one point each [m].
    """
    parts = []
    for scan in scans:
        order = np.argsort(np.rint(scan.time_s * 1e9), kind="stable")
        parts.append(thinned(in_world(scan, poses)[order], voxel_m))
    return thinned(np.concatenate(parts), voxel_m) if parts else np.zeros((0, 3))
