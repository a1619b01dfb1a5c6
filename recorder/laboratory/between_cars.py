"""Truth between the cars of a drive: relative poses, radio contact, and closures that one could find."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.raycast.scene import RayScene
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.schedule import weather_of
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_of
from recorder.evaluation.together import relative
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import write_tum
from recorder.laboratory.place_pairs import Frames, find_pairs, frames_along, write_csv
from recorder.laboratory.true_map import field_of
from recorder.replaying.plan import ReplayPlan
from recorder.writers.base import DEFAULT_EPOCH_NS

FOLDER = "between_cars"
"""Folder of the truth between cars, beside those of the cars."""
RADIO_RANGE_M = 70.0
"""Distance within which cars hear each other [m], as data sets of cooperative perception have it."""
EVERY_M, WITHIN_M, LEAST_OVERLAP = 2.0, 30.0, 0.3
"""Way between the frames of which closures are made, longest distance of both, and least overlap."""
_POSE = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BetweenCars:
    """What was written."""

    folder: Path
    """Folder of the tables."""
    closures: int | None
    """Number of closures; None: no two have a LiDAR or a camera."""


def write_between_cars(
    plans: Sequence[ReplayPlan],
    out: Path,
    *,
    radio_range_m: float = RADIO_RANGE_M,
    report: Callable[[float, float], None] = lambda *_: None,
) -> BetweenCars:
    """Write the truth between the cars of a drive, and fixed units; poses that are there already are kept.

    Args:
        plans: The replay of each car and unit, of one stretch.
        out: Folder of the cars' folders.
        radio_range_m: Distance within which cars hear each other [m].
        report: Called with pairs of cars done and in all.

    Raises:
        ConfigError: the range is not above 0.
        OutputError: a file cannot be written.
    """
    if not radio_range_m > 0.0:
        raise ConfigError(f"radio range {radio_range_m:g} m; give more than 0")
    folder, first = out / FOLDER, plans[0]
    stamps = np.arange(*first.span_ns, STEP_NS)
    contacts: list[list[object]] = []
    closures: list[list[object]] = []
    eyes = [_eye(plan) for plan in plans]
    stage = _stage(first) if len(eyes) - eyes.count(None) > 1 else None
    pairs = list(combinations(zip(plans, eyes, strict=True), 2))
    for done, ((a, eye_a), (b, eye_b)) in enumerate(pairs):
        between = relative_motion(a.timeline, b.timeline, stamps)
        pair = [a.config.carrier, b.config.carrier]
        path = folder / f"{pair[0]}_{pair[1]}.tum"
        if not path.exists():
            write_tum(path, between.shifted(DEFAULT_EPOCH_NS))
        contacts += [[*pair, *row] for row in contact_times(between, radio_range_m)]
        if stage is not None and eye_a is not None and eye_b is not None:
            closures += [[*pair, *row] for row in true_closures(stage.rays(), eye_a, eye_b)]
        report(done + 1, len(pairs))
    write_csv(folder / "radio.csv", ["car_a", "car_b", "begin_ns", "end_ns", "nearest_m"], contacts)
    if stage is None:
        return BetweenCars(folder=folder, closures=None)
    stage.close()
    columns = ["car_a", "car_b", "stamp_a_ns", "stamp_b_ns", *_POSE, "of_a", "of_b", "overlap"]
    write_csv(folder / "closures.csv", columns, closures)
    return BetweenCars(folder=folder, closures=len(closures))


def relative_motion(a: Timeline, b: Timeline, stamps_ns: NDArray[np.int64]) -> Trajectory:
    """Poses of the `base_link` of car b in that of car a at equal times."""
    motions = [car.ego_motion(stamps_ns) for car in (a, b)]
    paths = (
        Trajectory(stamp_ns=one.stamp_ns, position_m=one.position_m, quat_xyzw=one.quat_xyzw)
        for one in motions
    )
    return relative(*paths)


def contact_times(between: Trajectory, range_m: float) -> list[list[object]]:
    """First and last stamp [ns] of each time within a range, and the least distance in it [m]."""
    apart_m = np.sqrt(np.sum(between.position_m**2, axis=1))
    near = np.concatenate([[False], apart_m <= range_m, [False]])
    edges = np.flatnonzero(np.diff(near.astype(np.int8))).reshape(-1, 2)
    stamps = between.stamp_ns
    return [
        [int(stamps[begin]), int(stamps[end - 1]), f"{apart_m[begin:end].min():.3f}"]
        for begin, end in edges.tolist()
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eye:
    """Sensor of a car or unit, and its frames."""

    sensor: LidarConfig | CameraConfig
    frames: Frames
    """Frames every two metres; of a unit, which stands still, the first one."""
    stands: bool
    """Whether this is a unit."""

    def base(self, number: int) -> Array:
        """Pose of the `base_link` at a frame, world, shape (4, 4)."""
        T = self.sensor.mount.T_base_sensor
        return np.asarray(self.frames.T_world_sensor[number] @ transforms.invert(T))


def true_closures(rays: RayScene, first: Eye, second: Eye) -> list[list[object]]:
    """Stamps [ns], pose of the second `base_link` in the first, and overlap, of frames that show one place.

    A unit shows its place at all times: its stamp is that of the car.
    """
    fields = field_of(first.sensor), field_of(second.sensor)
    found = find_pairs(rays, fields[0], first.frames, second.frames, within_m=WITHIN_M, other=fields[1])
    rows: list[list[object]] = []
    for k in np.flatnonzero(found.overlap >= LEAST_OVERLAP):
        a, b = int(found.query[k]), int(found.reference[k])
        T = transforms.invert(first.base(a)) @ second.base(b)
        pose = [*T[:3, 3], *transforms.matrix_to_quat(T[:3, :3])]
        shares = found.of_query[k], found.of_reference[k], found.overlap[k]
        stamps = [int(first.frames.stamp_ns[a]), int(second.frames.stamp_ns[b])]
        stamps[1] = stamps[0] if second.stands else stamps[1]
        rows.append([*stamps, *(f"{v:.9f}" for v in pose), *(f"{share:.4f}" for share in shares)])
    return rows


def _eye(plan: ReplayPlan) -> Eye | None:
    """The rig's first LiDAR, or else its first camera."""
    kinds = (LidarConfig, CameraConfig)
    found = [config for kind in kinds for config in plan.rig.sensors if isinstance(config, kind)]
    if not found:
        return None
    sensor, stands, at = found[0], plan.config.roadside is not None, np.array(plan.span_ns[:1])
    T = plan.timeline.ego_motion(at).T_world_frame @ sensor.mount.T_base_sensor
    frames = Frames(stamp_ns=at, distance_m=np.zeros(1), T_world_sensor=T)
    if not stands:
        with suppress(EvaluationError):  # a car that waits has one frame, too
            frames = frames_along(plan.timeline, sensor, every_m=EVERY_M, span_ns=plan.span_ns)
    return Eye(sensor=sensor, frames=frames, stands=stands)


def _stage(plan: ReplayPlan) -> SensorStage:
    episode = Episode.load(plan.config.episode)
    return SensorStage(town_of(episode, plan.recipe.town), seed=0, weather=weather_of("ClearNoon"))
