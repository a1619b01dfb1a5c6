"""Kinds of command-line values that several commands take.

Options that `carlaloc replay` and `carlaloc dataset` have in common, and their configuration.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from carlaloc_env.core.errors import ConfigError, OutputError, UsageError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX, check_output_file, check_output_folder
from carlaloc_env.core.files.recordings import check_episode_output

if TYPE_CHECKING:
    from recorder.replaying.options import ReplayOptions
    from recorder.streaming.drive import DriveConfig

T = TypeVar("T")
_PART_MAX_BYTES = 255
"""Longest name of a file or folder on common file systems."""


def input_path(text: str) -> Path:
    """Path of something that is read, `~` expanded; one that no disk can hold is refused."""
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError("give a path")
    if any(len(os.fsencode(part)) > _PART_MAX_BYTES for part in Path(text).parts):
        raise argparse.ArgumentTypeError(f"a name in '{text[:40]}…' is longer than {_PART_MAX_BYTES} bytes")
    try:
        return Path(text).expanduser()
    except RuntimeError as error:
        raise argparse.ArgumentTypeError(f"{text}: {error}") from error


class OutputFile:
    """Kind of an option that names a file to write; `main` checks it before the command runs.

    Args:
        suffixes: Allowed suffixes, in lower case.
    """

    def __init__(self, *suffixes: str) -> None:
        self.suffixes = suffixes

    def __call__(self, text: str) -> Path:
        """Path typed by the user."""
        return input_path(text)

    def check(self, path: Path, *, overwrite: bool) -> None:
        """Refuse a path that may not be written.

        Raises:
            OutputError: see `check_output_file` and `check_episode_output`.
        """
        if self.suffixes == (EPISODE_SUFFIX,):
            check_episode_output(path, overwrite=overwrite)
        else:
            check_output_file(path, suffixes=self.suffixes, overwrite=overwrite)


class OutputFolder:
    """Kind of an option that names a folder to write into; `main` checks it before the command runs.

    Args:
        files: Names of the files that are written there; none: the command looks after them.
    """

    def __init__(self, *files: str) -> None:
        self.files = files

    def __call__(self, text: str) -> Path:
        """Path typed by the user."""
        return input_path(text)

    def check(self, path: Path, *, overwrite: bool) -> None:
        """Refuse a folder that may not be written into.

        Raises:
            OutputError: see `check_output_folder`.
        """
        check_output_folder(path, files=self.files, overwrite=overwrite)


def chosen_actions(
    parser: argparse.ArgumentParser, arguments: argparse.Namespace
) -> Iterator[argparse.Action]:
    """Options of the command that was chosen, those of its sub-commands included."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from chosen_actions(action.choices[getattr(arguments, action.dest)], arguments)
        else:
            yield action


def check_outputs(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """Refuse outputs that may not be written, before anything is done.

    Raises:
        OutputError: the first of them that may not.
    """
    actions = list(chosen_actions(parser, arguments))
    read = {path.resolve() for path in _inputs(actions, arguments)}
    for action in actions:
        value = getattr(arguments, action.dest, None)
        if isinstance(action.type, (OutputFile, OutputFolder)) and value is not None:
            if value.resolve() in read:
                raise OutputError(f"{value} is read by this command; give another name to write to")
            action.type.check(value, overwrite=getattr(arguments, "force", False))


def _inputs(actions: list[argparse.Action], arguments: argparse.Namespace) -> Iterator[Path]:
    for action in actions:
        value = getattr(arguments, action.dest, None)
        if action.type is input_path and value is not None:
            yield from value if isinstance(value, list) else [value]


def option(
    parser: argparse._ActionsContainer,
    flag: str,
    kind: Callable[[str], Any],
    metavar: str,
    text: str,
    default: Any = None,
    *,
    dest: str | None = None,
) -> None:
    """Add an option that takes a value, by the order of words in ``--help``: flag, value, text."""
    parser.add_argument(flag, type=kind, default=default, metavar=metavar, help=text, dest=dest)


def force_option(parser: argparse.ArgumentParser, what: str) -> None:
    """Add `--force`, which replaces an older file; a wrong suffix it does not overcome."""
    parser.add_argument("--force", action="store_true", help=f"replace {what}")


def config_of(kind: type[T], arguments: argparse.Namespace, **given: Any) -> T:
    """A configuration: its fields are the options of the same names, without units, and those given."""
    all_fields = [field.name for field in fields(cast(Any, kind))]
    options = {field: field.removesuffix("_s").removesuffix("_m") for field in all_fields}
    known = {field: getattr(arguments, name) for field, name in options.items() if hasattr(arguments, name)}
    return kind(**known | given)


def names(text: str) -> tuple[str, ...]:
    """Names separated by commas."""
    parts = tuple(part.strip() for part in text.split(",") if part.strip())
    if not parts:
        raise argparse.ArgumentTypeError("give at least one name")
    return parts


def numbers(text: str) -> tuple[float, ...]:
    """Finite numbers separated by commas."""
    return tuple(number(word) for word in names(text))


def seconds(text: str) -> float:
    """A time that is not negative [s]; an `s` may follow the number."""
    value = number(text.removesuffix("s"))
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative")
    return value


def positive_seconds(text: str) -> float:
    """A time above zero [s]; an `s` may follow the number."""
    value = number(text.removesuffix("s"))
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return value


def positive_int(text: str) -> int:
    """A whole number above zero."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return value


def seed(text: str) -> int:
    """Seed of random numbers: a whole number of 0 or more."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative; give a whole number of 0 or more")
    return value


def number_or_search(text: str) -> float | str:
    """A finite number, or the word `search`."""
    return text if text == "search" else number(text)


def number(text: str) -> float:
    """A finite number."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not finite")
    return value


def shared_options(*, nested: bool = False) -> argparse.ArgumentParser:
    """Parent parser of the options that every command takes.

    Args:
        nested: For the actions of a command that has them: options before the action count, too.
    """
    default = argparse.SUPPRESS if nested else False
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument(
        "--json", action="store_true", default=default, help="print a machine-readable result"
    )
    parser.add_argument("--verbose", action="store_true", default=default, help="write a log to stderr")
    return parser


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
        dest="formats",
        type=names,
        default=("rosbag1", "euroc"),
        metavar="A,B",
        help="rosbag1, rosbag1_lz4, rosbag1_bz2, rosbag2, rosbag2_sqlite3, euroc, kitti, dsec, nuscenes, "
        "opv2v, colmap, doppler_icp, rinex, raw (default: rosbag1,euroc)",
    )
    parser.add_argument(
        "--topics",
        default="standard",
        help="topic profile of bags: standard, slam, paper, paper_seg, full, compact or compact_full; your "
        "own: FILE.py:NAME",
    )
    text = "write the car's true pose to bags, /tf from map to base_link"
    parser.add_argument("--truth-tf", action="store_true", help=text)
    text = "write /clock to bags; `ros2 bag play --clock` and `rosbag play --clock` make it, too"
    parser.add_argument("--clock", action="store_true", help=text)
    option(parser, "--workers", int, "N", "processes; else one per core")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Dask scheduler whose workers do the work")
    text = "seconds of the drive that a worker makes at a time (default: 10)"
    option(parser, "--unit", seconds, "S", text, 10.0)
    parser.add_argument("--no-preview", action="store_false", dest="preview", help="make no films")


def add_condition_options(
    parser: argparse._ActionsContainer, *, weathers: tuple[str, ...], traffic: tuple[str, ...]
) -> None:
    """Declare conditions, sensors and quality of images.

    Args:
        parser: Parser of the command, or a group of it.
        weathers: Default of ``--weather``.
        traffic: Default of ``--traffic``.
    """
    text = f"weathers, or schedules (.yaml) (default: {','.join(weathers)})"
    option(parser, "--weather", names, "A,B", text, weathers, dest="weathers")
    text = f"dynamic, static, empty, fractions (default: {','.join(traffic)})"
    option(parser, "--traffic", names, "A,B", text, traffic)
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
    parser.add_argument(
        "--lidar-weather", action="store_true", help="fog, rain, snow and spray reach the LiDARs"
    )
    parser.add_argument(
        "--rig",
        default="paper",
        help="paper, flu, real, minimal, lidar, lidars, state, dsec, or a .yaml file (default: paper)",
    )
    parser.add_argument("--quality", default="medium", help="low, medium or high")


class _ConditionAction(argparse.Action):
    """Sets the options of a condition to those of a file."""

    def __call__(self, _: Any, namespace: argparse.Namespace, values: Any, __: str | None = None) -> None:
        from recorder.replaying.condition_file import ConditionFile

        try:
            file = ConditionFile.read(values)
        except ConfigError as error:
            raise UsageError(str(error)) from error
        namespace.condition = values
        namespace.weathers, namespace.traffic = (file.weather,), (file.traffic,)
        namespace.lidar_weather = file.lidar_weather
        namespace.fault = file.fault_words
        for name, value in (("start", file.start_s), ("duration", file.duration_s), ("seed", file.seed)):
            if value is not None and hasattr(namespace, name):
                setattr(namespace, name, value)


def add_stretch_options(parser: argparse._ActionsContainer) -> None:
    """Declare the stretch of a drive and the seed of its noise."""
    option(parser, "--start", seconds, "S", "begin here [s]", 0.0)
    option(parser, "--duration", positive_seconds, "S", "length [s]; else to the end")
    parser.add_argument("--seed", type=int, help="seed of sensor noise; else the episode's")


def replay_options(arguments: argparse.Namespace, **given: Any) -> ReplayOptions:
    """How to replay, by `add_condition_options`, `add_replay_options` and the fields that are given."""
    from carlaloc_env.faults.faults import Faults
    from recorder.replaying.options import ReplayOptions

    return config_of(ReplayOptions, arguments, faults=Faults.parse(arguments.fault), **given)


def drive_config(arguments: argparse.Namespace, episodes: Iterable[Path], **given: Any) -> DriveConfig:
    """Drives that are read as they are made, under the conditions and over the stretch of the options.

    Args:
        arguments: Options of `add_condition_options` and `add_stretch_options`, and ``--map``.
        episodes: The drives.
        given: Further fields of the configuration.
    """
    from recorder.streaming.drive import DriveConfig

    # Workers and clusters of these commands run systems, not replays.
    options = replay_options(arguments, workers=None, cluster=None)
    return config_of(DriveConfig, arguments, episodes=tuple(episodes), options=options, **given)
