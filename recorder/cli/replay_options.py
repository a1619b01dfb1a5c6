"""Options that `carlaloc replay` and `carlaloc dataset` have in common, and their configuration."""

from __future__ import annotations

import argparse
from typing import Any

from carlaloc_env.core.errors import ConfigError, UsageError
from recorder.cli.arguments import (
    OutputFolder,
    input_path,
    names,
    positive_int,
    positive_seconds,
    seconds,
    seed,
)


def add_replay_options(
    parser: argparse.ArgumentParser, *, weathers: tuple[str, ...], traffic: tuple[str, ...]
) -> None:
    """Declare a dataset's folder, conditions, sensors, formats and workers.

    Args:
        parser: Parser of the command.
        weathers: Default of ``--weather``.
        traffic: Default of ``--traffic``.
    """
    parser.add_argument("--out", type=OutputFolder(), required=True, help="folder of the dataset")
    add_condition_options(parser, weathers=weathers, traffic=traffic)
    parser.add_argument(
        "--format",
        type=names,
        default=("rosbag1", "euroc"),
        metavar="A,B",
        help="rosbag1, rosbag1_lz4, rosbag1_bz2, rosbag2, rosbag2_sqlite3, euroc, kitti, dsec, raw "
        "(default: rosbag1,euroc)",
    )
    parser.add_argument(
        "--topics",
        default="standard",
        help="topic profile of bags: standard, slam, paper, paper_seg, full, compact or compact_full",
    )
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


def add_condition_options(
    parser: argparse._ActionsContainer, *, weathers: tuple[str, ...], traffic: tuple[str, ...]
) -> None:
    """Declare conditions, sensors and quality of images.

    Args:
        parser: Parser of the command, or a group of it.
        weathers: Default of ``--weather``.
        traffic: Default of ``--traffic``.
    """
    parser.add_argument(
        "--weather",
        type=names,
        default=weathers,
        metavar="A,B",
        help=f"weathers, or schedules (.yaml) (default: {','.join(weathers)})",
    )
    parser.add_argument(
        "--traffic",
        type=names,
        default=traffic,
        metavar="A,B",
        help=f"dynamic, static, empty, fractions (default: {','.join(traffic)})",
    )
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a fault of a sensor, e.g. lidar.time_offset_ms=30; may be repeated (docs/robustness/faults.md)",
    )
    parser.add_argument(
        "--condition",
        action=_ConditionAction,
        type=input_path,
        metavar="FILE",
        help="weather, traffic, faults, stretch and seed of a .yaml file; options behind it go before it",
    )
    parser.add_argument("--lidar-weather", action="store_true", help="fog, rain and spray reach the LiDARs")
    parser.add_argument("--lens-drops", action="store_true", help="drops on the lenses while it rains")
    parser.add_argument(
        "--leaf-wind", type=seconds, default=0.0, metavar="M/S", help="wind that sways leaves [m/s]"
    )
    parser.add_argument(
        "--rig",
        default="paper",
        help="paper, flu, real, minimal, lidar, state, dsec, or a .yaml file (default: paper)",
    )
    parser.add_argument("--quality", default="medium", help="low, medium or high")


class _ConditionAction(argparse.Action):
    """Sets the options of a condition to those of a file."""

    def __call__(self, _: Any, namespace: argparse.Namespace, values: Any, __: str | None = None) -> None:
        from recorder.replaying.condition_file import ConditionFile

        try:
            found = ConditionFile.read(values)
        except ConfigError as error:
            raise UsageError(str(error)) from error
        namespace.condition = values
        namespace.weather, namespace.traffic = (found.weather,), (found.traffic,)
        namespace.lidar_weather = found.lidar_weather
        namespace.fault = found.fault_words
        for name, value in (("start", found.start_s), ("duration", found.duration_s), ("seed", found.seed)):
            if value is not None and hasattr(namespace, name):
                setattr(namespace, name, value)


def add_stretch_options(parser: argparse._ActionsContainer) -> None:
    """Declare the stretch of a drive and the seed of its noise."""
    parser.add_argument("--start", type=seconds, default=0.0, metavar="S", help="begin here [s]")
    parser.add_argument("--duration", type=positive_seconds, metavar="S", help="length [s]; else to the end")
    parser.add_argument("--seed", type=seed, help="seed of sensor noise; else the episode's")


def condition_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Fields of `ReplayOptions` that `add_condition_options` gives."""
    from carlaloc_env.faults.faults import Faults

    return {
        "weathers": arguments.weather,
        "traffic": arguments.traffic,
        "rig": arguments.rig,
        "quality": arguments.quality,
        "lens_drops": arguments.lens_drops,
        "lidar_weather": arguments.lidar_weather,
        "faults": Faults.parse(arguments.fault),
        "leaf_wind_mps": arguments.leaf_wind,
    }


def replay_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Fields of `ReplayOptions` that the options above give."""
    return {
        **condition_options(arguments),
        "formats": arguments.format,
        "topics": arguments.topics,
        "workers": arguments.workers,
        "cluster": arguments.cluster,
        "unit_s": arguments.unit,
        "preview": not arguments.no_preview,
    }
