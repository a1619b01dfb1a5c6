"""Lets the scripted driver drive routes by estimated poses, and scores lane keeping beside the estimate."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.route import Route
from recorder.evaluation.align import umeyama
from recorder.laboratory.estimated_pose_env import EstimatedPoseEnv
from recorder.laboratory.pose_source import KnownError, PoseSource, SystemPose
from recorder.laboratory.step_driver import StepDriver

Progress = Callable[[float, int, str | None], None]
"""Called with drives done, drives in all, and the drive that has ended, if one has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoopConfig:
    """Configuration of closed-loop drives: town, route, traffic, and sources of poses."""

    town: str | Path
    """Town, or an OpenDRIVE file."""
    methods: tuple[str, ...] = ()
    """Systems, or ``.py`` files that define one."""
    offsets_m: tuple[float, ...] = ()
    """Known errors to the left of the truth [m]; the truth itself is always driven by."""
    traffic: tuple[str, ...] = ("static",)
    """Levels of traffic."""
    seeds: tuple[int, ...] = (0,)
    """Seeds of traffic, noise and driver."""
    rig: str = "lidar"
    """Sensors of the systems."""
    route: str = "town"
    """``town`` or ``random``."""
    time_limit_s: float = 120.0
    """Time after which a drive ends [s]."""
    silence_s: float = 2.0
    """Longest time of a drive without a pose [s]."""

    def __post_init__(self) -> None:
        if not (self.time_limit_s > 0 and self.silence_s > 0):
            raise ConfigError("a drive needs a time limit and a time without a pose above 0 s")


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveScore:
    """One drive by one source of poses, judged by the truth."""

    source: str
    """``truth``, a system, or an offset [m]."""
    traffic: str
    seed: int
    route_completion: float
    """Share of the route, 0–1."""
    ended_by: str
    """``goal``, ``collision``, ``off_road``, ``off_route``, ``time``, ``standing`` or ``estimator``."""
    reason: str
    """Reason for the estimator's failure; empty if none."""
    collision: bool
    red_lights: int
    lateral_mean_m: float
    """Mean offset to the left of the route's line while moving [m]."""
    lateral_rms_m: float
    lateral_max_m: float
    lane_invasions: int
    """How often a side of the car came farther from the route's line than half a lane."""
    outside_s: float
    """Time there [s]."""
    pose_error_rms_m: float
    """Distance of the pose by which the car was driven from the truth, RMS [m]."""
    pose_error_max_m: float
    ape_m: float
    """Its APE as of an open loop: RMSE after the SE(3) fit [m]."""
    driven_s: float
    real_time: float
    """Simulated time over wall-clock time, the start of the system left out."""
    cpu_per_s: float = float("nan")
    """CPU time of a second of driving, that of the system and of its start included [s]."""


def run_closed_loop(
    config: ClosedLoopConfig,
    progress: Progress = lambda *_: None,
    keep: Callable[[Sequence[DriveScore]], None] = lambda _: None,
) -> list[DriveScore]:
    """Drive every level and seed by every source of poses.

    Args:
        config: Town, systems and drives.
        progress: Called with the progress of the drives.
        keep: Called after each drive with all scores so far.

    Raises:
        ConfigError: a town, rig or system is unknown.
        MissingDependencyError: a system is not installed.
        EvaluationError: the rig does not serve a system.
    """
    plan = [(traffic, seed, source) for traffic in config.traffic for seed in config.seeds
            for source in sources(config)]  # fmt: skip
    scores: list[DriveScore] = []
    for traffic, seed, (name, source) in plan:
        rig = "state" if isinstance(source, KnownError) else config.rig
        env = CarlaLocEnv(
            config.town,
            rig,
            action="controls",
            traffic=traffic,
            route=config.route,
            task={"time_limit_s": config.time_limit_s},
            info=() if rig == "state" else ("samples",),
        )
        wrapped, before_s = EstimatedPoseEnv(env, source), _processor_s()
        try:
            done = len(scores)
            score = drive(
                wrapped, name=name, traffic=traffic, seed=seed,
                report=lambda share: progress(done + share, len(plan), None),  # noqa: B023
            )  # fmt: skip
        finally:
            wrapped.close()
        scores.append(replace(score, cpu_per_s=(_processor_s() - before_s) / score.driven_s))
        keep(scores)
        text = f"{name}, {traffic}, seed {seed}: {score.ended_by}, {score.route_completion:.0%}"
        progress(len(scores), len(plan), text)
    return scores


def _processor_s() -> float:
    """Processor time of this process and of all that have ended below it [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def sources(config: ClosedLoopConfig) -> Iterator[tuple[str, PoseSource]]:
    """Names and sources of poses that a configuration asks for."""
    yield "truth", KnownError()
    for offset_m in config.offsets_m:
        yield f"{offset_m:+g} m", KnownError(offset_m)
    for method in config.methods:
        yield Path(method).stem, SystemPose(method, silence_s=config.silence_s)


def drive(
    env: EstimatedPoseEnv,
    *,
    name: str,
    traffic: str,
    seed: int,
    report: Callable[[float], None] = lambda _: None,
) -> DriveScore:
    """One episode of the scripted driver.

    Args:
        env: The environment, with actions of the kind ``controls``.
        name: Name of the source of poses.
        traffic: Name of its level of traffic.
        seed: Seed of the episode and the driver.
        report: Called with the share of the route that is driven.
    """
    _, info = env.reset(seed=seed)
    driver, ended, began_s = StepDriver(seed), False, 0.0
    rows: list[tuple[float, float, float, float]] = []
    T_true, T_believed = [], []
    while not ended:
        _, _, terminated, truncated, info = env.step(driver.act(env.world.driver_view()))
        ended = terminated or truncated
        if not rows:
            began_s = time.perf_counter()
        speed_mps = abs(env.unwrapped.world.state.speed_mps)  # type: ignore[attr-defined]
        rows.append((info["route_s_m"], info["route_offset_m"], speed_mps, info["cost_terms"]["red_light"]))
        T_true.append(env.world.T_true)
        T_believed.append(info["believed_pose"])
        if len(rows) % 20 == 0:
            report(info["route_completion"])
    wall_s = time.perf_counter() - began_s
    route_s_m, lateral_m, speed, red = np.array(rows).T
    step_s = 1e-9 * info["stamp_ns"] / len(rows)
    true, believed = np.array(T_true), np.array(T_believed)
    room_m = half_lanes_m(env.world.town.network, env.world.route)
    route = env.world.route
    outside = np.abs(lateral_m) + 0.5 * EGO_SIZE_M[1] > room_m[[route.row_at(s) for s in route_s_m]]
    away_m = np.linalg.norm(believed[:, :3, 3] - true[:, :3, 3], axis=1)
    moving = lateral_m[speed > 0.5] if np.any(speed > 0.5) else np.zeros(1)
    return DriveScore(
        source=name,
        traffic=traffic,
        seed=seed,
        route_completion=float(info["route_completion"]),
        ended_by=str(info["ended_by"]),
        reason=str(info.get("estimator_error", "")),
        collision=info["ended_by"] == "collision",
        red_lights=int(red.sum()),
        lateral_mean_m=float(moving.mean()),
        lateral_rms_m=float(np.sqrt(np.mean(moving**2))),
        lateral_max_m=float(np.abs(moving).max()),
        lane_invasions=int(np.sum(np.diff(outside.astype(int), prepend=0) == 1)),
        outside_s=float(outside.sum() * step_s),
        pose_error_rms_m=float(np.sqrt(np.mean(away_m**2))),
        pose_error_max_m=float(away_m.max()),
        ape_m=_ape_m(true, believed),
        driven_s=float(1e-9 * info["stamp_ns"]),
        real_time=float((len(rows) - 1) * step_s / max(wall_s, 1e-9)),
    )


def half_lanes_m(network: LaneNetwork, route: Route) -> Array:
    """Half the width of the lane at each sample of a route [m], (K,)."""
    nearest = network.nearest(route.position_m)
    half_m: Array = 0.5 * network.width_m(nearest.lane, nearest.station_m)
    return half_m


def _ape_m(T_true: Array, T_believed: Array) -> float:
    """RMSE of positions after the fit of Umeyama [m]; NaN where the car never moved."""
    x, y = T_believed[:, :3, 3], T_true[:, :3, 3]
    try:
        fit = umeyama(x, y, name="the car")
    except EvaluationError:
        return float("nan")
    rest = x @ fit.R.T + fit.t - y
    return float(np.sqrt(np.mean(np.sum(rest**2, axis=1))))
