"""Replay an episode under any weather and traffic, and write datasets.

Examples:
  carlaloc replay drive.mcap --out data --weather ClearNoon,FoggyNoon --traffic static,dynamic
  carlaloc replay drive.mcap --out lidar --rig lidar --format rosbag1 --start 10 --duration 20
"""

from __future__ import annotations

import argparse
from typing import Any

from recorder.cli.arguments import (
    OutputFolder,
    input_path,
    names,
    positive_int,
    positive_seconds,
    seconds,
    seed,
)
from recorder.cli.progress import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc replay`."""
    parser.add_argument("episode", type=input_path, help="episode to replay (.mcap)")
    parser.add_argument("--out", type=OutputFolder(), required=True, help="folder of the dataset")
    parser.add_argument(
        "--weather", type=names, default=("ClearNoon",), metavar="A,B", help="weathers, or schedules (.yaml)"
    )
    parser.add_argument("--lens-drops", action="store_true", help="drops on the lenses while it rains")
    parser.add_argument(
        "--leaf-wind", type=seconds, default=0.0, metavar="M/S", help="wind that sways leaves [m/s]"
    )
    parser.add_argument(
        "--traffic", type=names, default=("dynamic",), metavar="A,B", help="dynamic, static, empty, fractions"
    )
    parser.add_argument(
        "--rig",
        default="paper",
        help="paper, flu, real, minimal, lidar, state, or a .yaml file (default: paper)",
    )
    parser.add_argument(
        "--format",
        type=names,
        default=("rosbag1", "euroc"),
        metavar="A,B",
        help="rosbag1, rosbag2, rosbag2_sqlite3, euroc, kitti, dsec (default: rosbag1,euroc)",
    )
    parser.add_argument(
        "--topics", default="standard", help="topic profile of bags: standard, slam, paper or full"
    )
    parser.add_argument("--start", type=seconds, default=0.0, metavar="S", help="begin here [s]")
    parser.add_argument("--duration", type=positive_seconds, metavar="S", help="length [s]; else to the end")
    parser.add_argument("--camera-start", type=seconds, metavar="S", help="pictures begin here [s]")
    parser.add_argument(
        "--camera-duration", type=positive_seconds, metavar="S", help="length of pictures [s]"
    )
    parser.add_argument("--seed", type=seed, help="seed of sensor noise; else the episode's")
    parser.add_argument("--map", help="map of the drive, where the episode names none that is known")
    parser.add_argument("--quality", default="medium", help="low, medium or high")
    parser.add_argument("--workers", type=positive_int, metavar="N", help="processes; else one per core")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Dask scheduler whose workers do the work")
    parser.add_argument(
        "--unit",
        type=positive_seconds,
        default=10.0,
        metavar="S",
        help="seconds of the drive that a worker makes at a time (default: 10)",
    )
    parser.add_argument("--no-preview", action="store_true", help="make no films")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Replay."""
    from recorder.generation.replay import ReplayConfig, replay

    config = ReplayConfig(
        episode=arguments.episode,
        out=arguments.out,
        weathers=arguments.weather,
        traffic=arguments.traffic,
        rig=arguments.rig,
        formats=arguments.format,
        topics=arguments.topics,
        start_s=arguments.start,
        duration_s=arguments.duration,
        camera_start_s=arguments.camera_start,
        camera_duration_s=arguments.camera_duration,
        seed=arguments.seed,
        quality=arguments.quality,
        workers=arguments.workers,
        cluster=arguments.cluster,
        unit_s=arguments.unit,
        preview=not arguments.no_preview,
        lens_drops=arguments.lens_drops,
        leaf_wind_mps=arguments.leaf_wind,
        map=arguments.map,
    )
    with Progress("replaying") as progress:
        result = replay(config, progress.update)
    return {
        "out": str(result.out),
        "sequences": [str(path) for path in result.sequences],
        "ground_truth": str(result.ground_truth),
        "samples": result.samples,
    }


def show(result: dict[str, Any]) -> None:
    """Print what was written."""
    for path in result["sequences"]:
        print(path)
    print(f"{result['ground_truth']}  ({sum(result['samples'].values())} samples in all)")
