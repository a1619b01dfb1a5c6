"""Truth between the cars of a drive: relative poses, radio contact, and closures that one could find."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.raycast.scene import RayScene
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.timeline.motion import Motion
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.schedule import weather_of
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_of
from recorder.laboratory.place_pairs import Frames, find_pairs, frames_along, write_csv
from recorder.laboratory.true_map import field_of
from recorder.replaying.plan import ReplayPlan
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.formats.tum import write_tum

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
    """Number of closures; None: there is one car, or the rig has neither LiDAR nor camera."""


def write_between_cars(
    plans: Sequence[ReplayPlan],
    out: Path,
    *,
    radio_range_m: float = RADIO_RANGE_M,
    report: Callable[[float, float], None] = lambda *_: None,
) -> BetweenCars:
    """Write the truth between the cars of a drive, and fixed units; poses that are there already are kept.

    Args:
        plans: The replay of each car and unit, of one stretch; closures are those of cars.
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
    sensor = _sensor(first)
    timelines = [plan.timeline for plan in plans]
    stamps = np.arange(*first.span_ns, STEP_NS)
    pairs, names = list(combinations(range(len(plans)), 2)), [plan.config.carrier for plan in plans]
    is_car = [plan.config.roadside is None for plan in plans]
    contacts: list[list[object]] = []
    closures: list[list[object]] = []
    stage = _stage(first) if sensor is not None and sum(is_car) > 1 else None
    for done, (a, b) in enumerate(pairs):
        relative = relative_motion(timelines[a], timelines[b], stamps)
        path, pair = folder / f"{names[a]}_{names[b]}.tum", [names[a], names[b]]
        if not path.exists():
            write_tum(path, relative, epoch_ns=DEFAULT_EPOCH_NS)
        contacts += [[*pair, *row] for row in contact_times(relative, radio_range_m)]
        if stage is not None and sensor is not None and is_car[a] and is_car[b]:
            found = true_closures(stage.rays(), sensor, (timelines[a], timelines[b]), first.span_ns)
            closures += [[*pair, *row] for row in found]
        report(done + 1, len(pairs))
    write_csv(folder / "radio.csv", ["car_a", "car_b", "begin_ns", "end_ns", "nearest_m"], contacts)
    if stage is None:
        return BetweenCars(folder=folder, closures=None)
    stage.close()
    columns = ["car_a", "car_b", "stamp_a_ns", "stamp_b_ns", *_POSE, "of_a", "of_b", "overlap"]
    write_csv(folder / "closures.csv", columns, closures)
    return BetweenCars(folder=folder, closures=len(closures))


def relative_motion(a: Timeline, b: Timeline, stamps_ns: NDArray[np.int64]) -> Motion:
    """Poses of the `base_link` of car b in that of car a at equal times, as the motion of a frame."""
    of_a, of_b = a.ego_motion(stamps_ns), b.ego_motion(stamps_ns)
    to_a = transforms.quat_conjugate(of_a.quat_xyzw)
    none = np.zeros_like(of_a.position_m)
    return Motion(
        stamp_ns=of_a.stamp_ns,
        position_m=transforms.quat_rotate(to_a, of_b.position_m - of_a.position_m),
        quat_xyzw=transforms.quat_multiply(to_a, of_b.quat_xyzw),
        velocity_world_mps=none,
        acceleration_world_mps2=none,
        omega_body_radps=none,
        alpha_body_radps2=none,
    )


def contact_times(relative: Motion, range_m: float) -> list[list[object]]:
    """First and last stamp [ns] of each time within a range, and the least distance in it [m]."""
    apart_m = np.sqrt(np.sum(relative.position_m**2, axis=1))
    near = np.concatenate([[False], apart_m <= range_m, [False]])
    edges = np.flatnonzero(np.diff(near.astype(np.int8))).reshape(-1, 2)
    stamps = relative.stamp_ns
    return [
        [int(stamps[begin]), int(stamps[end - 1]), f"{apart_m[begin:end].min():.3f}"]
        for begin, end in edges.tolist()
    ]


def true_closures(
    rays: RayScene,
    sensor: LidarConfig | CameraConfig,
    pair: tuple[Timeline, Timeline],
    span_ns: tuple[int, int],
) -> list[list[object]]:
    """Stamps [ns], pose of the second `base_link` in the first, and overlap, of frames that show one place.

    Args:
        rays: The town.
        sensor: Sensor of both cars.
        pair: Their drives.
        span_ns: First stamp and end (not included) of the stretch [ns].
    """
    frames = [frames_along(timeline, sensor, every_m=EVERY_M, span_ns=span_ns) for timeline in pair]
    found = find_pairs(rays, field_of(sensor), *frames, within_m=WITHIN_M)
    rows: list[list[object]] = []
    for k in np.flatnonzero(found.overlap >= LEAST_OVERLAP):
        a, b = int(found.query[k]), int(found.reference[k])
        T = transforms.invert(_base(frames[0], sensor, a)) @ _base(frames[1], sensor, b)
        pose = [*T[:3, 3], *transforms.matrix_to_quat(T[:3, :3])]
        shares = found.of_query[k], found.of_reference[k], found.overlap[k]
        stamps = int(frames[0].stamp_ns[a]), int(frames[1].stamp_ns[b])
        rows.append([*stamps, *(f"{v:.9f}" for v in pose), *(f"{share:.4f}" for share in shares)])
    return rows


def _base(frames: Frames, sensor: SensorConfig, number: int) -> Array:
    pose: Array = frames.T_world_sensor[number] @ transforms.invert(sensor.mount.T_base_sensor)
    return pose


def _sensor(plan: ReplayPlan) -> LidarConfig | CameraConfig | None:
    """The rig's first LiDAR, or else its first camera."""
    for kind in (LidarConfig, CameraConfig):
        found = next((config for config in plan.rig.sensors if isinstance(config, kind)), None)
        if found is not None:
            return found
    return None


def _stage(plan: ReplayPlan) -> SensorStage:
    episode = Episode.load(plan.config.episode)
    return SensorStage(town_of(episode, plan.recipe.town), seed=0, weather=weather_of("ClearNoon"))
