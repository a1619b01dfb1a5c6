"""Options that `carlaloc replay` and `carlaloc dataset` have in common, and their configuration."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from carlaloc_env.core.errors import ConfigError, UsageError
from recorder.cli.arguments import (
    OutputFolder,
    input_path,
    names,
    option,
    positive_int,
    positive_seconds,
    seconds,
    seed,
)

if TYPE_CHECKING:
    from recorder.streaming.drive import DriveConfig


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
    option(parser, "--workers", positive_int, "N", "processes; else one per core")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Dask scheduler whose workers do the work")
    text = "seconds of the drive that a worker makes at a time (default: 10)"
    option(parser, "--unit", positive_seconds, "S", text, 10.0)
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
    for flag, default, text in (
        ("--weather", weathers, "weathers, or schedules (.yaml)"),
        ("--traffic", traffic, "dynamic, static, empty, fractions"),
    ):
        option(parser, flag, names, "A,B", f"{text} (default: {','.join(default)})", default)
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
        help="weather, traffic, faults, stretch and seed of a .yaml file; later options override it",
    )
    parser.add_argument("--lidar-weather", action="store_true", help="fog, rain and spray reach the LiDARs")
    parser.add_argument("--lens-drops", action="store_true", help="drops on the lenses while it rains")
    option(parser, "--leaf-wind", seconds, "M/S", "wind that sways leaves [m/s]", 0.0)
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
    option(parser, "--start", seconds, "S", "begin here [s]", 0.0)
    option(parser, "--duration", positive_seconds, "S", "length [s]; else to the end")
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


def drive_config(arguments: argparse.Namespace, episodes: Iterable[Path], **given: Any) -> DriveConfig:
    """Drives that are read as they are made, under the conditions and over the stretch of the options.

    Args:
        arguments: Options of `add_condition_options` and `add_stretch_options`, and ``--map``.
        episodes: The drives.
        given: Further fields of the configuration.
    """
    from recorder.replaying.plan import ReplayOptions
    from recorder.streaming.drive import DriveConfig

    options = ReplayOptions(**condition_options(arguments), seed=arguments.seed)
    stretch = {"start_s": arguments.start, "duration_s": arguments.duration}
    return DriveConfig(episodes=tuple(episodes), options=options, map=arguments.map, **stretch, **given)


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
