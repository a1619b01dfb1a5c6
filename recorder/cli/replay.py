"""Replay an episode under any weather and traffic, and write datasets.

Examples:
  carlaloc replay drive.mcap --out data --weather ClearNoon,FoggyNoon --traffic static,dynamic
  carlaloc replay drive.mcap --out lidar --rig lidar --format rosbag1 --start 10 --duration 20
"""

from __future__ import annotations

import argparse
from typing import Any

from recorder.cli.arguments import input_path, positive_seconds, seconds, seed
from recorder.cli.progress import Progress
from recorder.cli.replay_options import add_replay_options, replay_config


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc replay`."""
    parser.add_argument("episode", type=input_path, help="episode to replay (.mcap)")
    add_replay_options(parser, weathers=("ClearNoon",), traffic=("dynamic",))
    parser.add_argument("--start", type=seconds, default=0.0, metavar="S", help="begin here [s]")
    parser.add_argument("--duration", type=positive_seconds, metavar="S", help="length [s]; else to the end")
    parser.add_argument("--camera-start", type=seconds, metavar="S", help="pictures begin here [s]")
    parser.add_argument(
        "--camera-duration", type=positive_seconds, metavar="S", help="length of pictures [s]"
    )
    parser.add_argument("--seed", type=seed, help="seed of sensor noise; else the episode's")
    parser.add_argument("--map", help="map of the drive, where the episode names none that is known")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Replay."""
    from recorder.generation.replay import replay

    config = replay_config(
        arguments,
        arguments.episode,
        start_s=arguments.start,
        duration_s=arguments.duration,
        camera_start_s=arguments.camera_start,
        camera_duration_s=arguments.camera_duration,
        seed=arguments.seed,
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
