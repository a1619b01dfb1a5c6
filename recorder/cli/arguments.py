"""Kinds of command-line values that several commands take."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, cast

from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX, check_output_file, check_output_folder
from recorder.episode.file_names import check_episode_output

T = TypeVar("T")
_PART_MAX_BYTES = 255
"""Longest name of a file or folder on common file systems."""


def _path(text: str) -> Path:
    """Path typed by the user, `~` expanded; one that no disk can hold is refused."""
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError("give a path")
    if any(len(os.fsencode(part)) > _PART_MAX_BYTES for part in Path(text).parts):
        raise argparse.ArgumentTypeError(f"a name in '{text[:40]}…' is longer than {_PART_MAX_BYTES} bytes")
    try:
        return Path(text).expanduser()
    except RuntimeError as error:
        raise argparse.ArgumentTypeError(f"{text}: {error}") from error


def input_path(text: str) -> Path:
    """Path of something that is read."""
    return _path(text)


class OutputFile:
    """Kind of an option that names a file to write; `main` checks it before the command runs.

    Args:
        suffixes: Allowed suffixes, in lower case.
    """

    def __init__(self, *suffixes: str) -> None:
        self.suffixes = suffixes

    def __call__(self, text: str) -> Path:
        """Path typed by the user."""
        return _path(text)

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
        return _path(text)

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
) -> None:
    """Add an option that takes a value, by the order of words in ``--help``: flag, value, text."""
    parser.add_argument(flag, type=kind, default=default, metavar=metavar, help=text)


def force_option(parser: argparse.ArgumentParser, what: str) -> None:
    """Add `--force`, which replaces an older file; a wrong suffix it does not overcome."""
    parser.add_argument("--force", action="store_true", help=f"replace {what}")


def config_of(kind: type[T], arguments: argparse.Namespace, **given: Any) -> T:
    """A configuration: its fields are the options of the same names, and those that are given."""
    known = {field.name for field in fields(cast(Any, kind))} & vars(arguments).keys()
    return kind(**{**{name: getattr(arguments, name) for name in known}, **given})


def names(text: str) -> tuple[str, ...]:
    """Names separated by commas."""
    found = tuple(part.strip() for part in text.split(",") if part.strip())
    if not found:
        raise argparse.ArgumentTypeError("give at least one name")
    return found


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
