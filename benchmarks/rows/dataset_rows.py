"""The dataset factory: time per condition-second, compared with naive PyBullet."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from bench import Bench, Row
from naive_pybullet import NaiveWorld
from scenario import SEED, TOWN
from timing import Timing, time_calls

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.drive.record import RecordConfig, record
from recorder.replaying.replay import ReplayConfig, replay

STEPS_PER_S = 1_000_000_000 // STEP_NS
CORES = 2
"""The machine of the targets; units of a drive are independent, so that its cores share the work evenly."""
WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
LEVELS = ("static", "dynamic")


def dataset(name: str, topics: str, what: str, target_s: float) -> Callable[[Bench], Row]:
    """A row of the time of a condition-second on two cores, six conditions made together."""

    def row(bench: Bench) -> Row:
        ours = _condition_second(bench, topics)
        return Row(
            name=name,
            what=f"dataset of Town03, {what}, 6 conditions: a condition-second",
            value=ours.cpu_s / CORES,
            unit=f"s on {CORES} cores",
            target=target_s,
            at_least=False,
            ours=ours,
            note=f"CPU time over {CORES}; what a further stretch takes, so that opening does not count",
        )

    return row


def dataset_beside(bench: Bench) -> Row:
    """A condition-second without events compared with stereo pair and LiDAR in PyBullet, CPU time of both."""
    ours = _condition_second(bench, "standard")
    naive = time_calls({"naive": _naive_instant(bench)}, 1 if bench.quick else bench.repeat, warm_up=0)[
        "naive"
    ]
    second = Timing(
        median_s=STEPS_PER_S * naive.median_s,
        least_s=STEPS_PER_S * naive.least_s,
        cpu_s=STEPS_PER_S * naive.cpu_s,
        calls=naive.calls,
    )
    return Row(
        name="dataset_beside",
        what="the same without events beside TinyRenderer and rayTestBatch",
        value=second.cpu_s / ours.cpu_s,
        unit="× faster",
        target=6.0,
        ours=ours,
        naive=second,
        note=f"PyBullet: a stereo pair and {_lidar().rays} rays 20 times, nothing written, no weather",
    )


def _condition_second(bench: Bench, topics: str) -> Timing:
    """Time of a condition-second in this process: a longer replay less a shorter one."""
    short_s, long_s = (0.05, 0.15) if bench.quick else (0.25, 0.6)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drive = folder / "drive.mcap"
        record(RecordConfig(map=TOWN, out=drive, duration_s=4.0, seed=SEED, traffic="dynamic"))
        # The first one finds caches that are cold.
        _replay(drive, folder / "first", topics, 0.05)
        short = _replay(drive, folder / "short", topics, short_s)
        long = _replay(drive, folder / "long", topics, long_s)
    seconds = (long_s - short_s) * len(WEATHERS) * len(LEVELS)
    wall_s, cpu_s = ((after - before) / seconds for before, after in zip(short, long, strict=True))
    return Timing(median_s=wall_s, least_s=wall_s, cpu_s=cpu_s, calls=1)


def _replay(drive: Path, out: Path, topics: str, length_s: float) -> tuple[float, float]:
    """Wall clock and CPU time of a replay [s]."""
    config = ReplayConfig(
        episode=drive,
        out=out,
        weathers=WEATHERS,
        traffic=LEVELS,
        formats=("rosbag1",),
        topics=topics,
        start_s=2.0,
        duration_s=length_s,
        workers=1,
        preview=False,
    )
    began, cpu_began = time.perf_counter(), time.process_time()
    replay(config)
    return time.perf_counter() - began, time.process_time() - cpu_began


def _lidar() -> LidarConfig:
    return next(c for c in rig_by_name("paper").sensors if isinstance(c, LidarConfig))


def _naive_instant(bench: Bench) -> Callable[[], object]:
    """Both pictures and one revolution in PyBullet."""
    naive: NaiveWorld = bench.naive_drive()
    T_world_base = bench.drive.timeline.ego_motion([bench.drive.stamps_ns[0]]).T_world_frame[0]
    cameras = [c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig)]
    lidar = _lidar()
    T = T_world_base @ lidar.mount.T_base_sensor
    turn, lift = np.meshgrid(
        -2 * np.pi * np.arange(lidar.columns) / lidar.columns, np.radians(lidar.elevations_deg), indexing="ij"
    )
    rays = np.stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)], axis=-1)
    directions = rays.reshape(-1, 3) @ T[:3, :3].T

    def instant() -> None:
        for camera in cameras:
            naive.picture(camera.pinhole, T_world_base @ camera.mount.T_base_sensor)
        naive.ranges_m(T[:3, 3], directions, lidar.range_max_m)

    return instant


dataset_plain = dataset("dataset", "standard", "the paper's suite without events", 4.0)
dataset_full = dataset("dataset_full", "full", "the paper's suite with events", 8.0)
