"""Kinds of command-line values that several commands take."""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path

_PART_MAX_BYTES = 255
"""Longest name of a file or folder on common file systems."""


def path_argument(text: str) -> Path:
    """Path typed by the user, `~` expanded; one that no disk can hold is refused."""
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError("give a path")
    if any(len(os.fsencode(part)) > _PART_MAX_BYTES for part in Path(text).parts):
        raise argparse.ArgumentTypeError(f"a name in '{text[:40]}…' is longer than {_PART_MAX_BYTES} bytes")
    try:
        return Path(text).expanduser()
    except RuntimeError as error:
        raise argparse.ArgumentTypeError(f"{text}: {error}") from error


def names(text: str) -> tuple[str, ...]:
    """Names separated by commas."""
    found = tuple(part.strip() for part in text.split(",") if part.strip())
    if not found:
        raise argparse.ArgumentTypeError("give at least one name")
    return found


def seconds(text: str) -> float:
    """A time that is not negative [s]."""
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative")
    return value


def positive_seconds(text: str) -> float:
    """A time above zero [s]."""
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return value


def positive_int(text: str) -> int:
    """A whole number above zero."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return value


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not finite")
    return value


def shared_options(*, nested: bool = False) -> argparse.ArgumentParser:
    """Parent parser of the options that every command takes.

    Args:
        nested: For the actions of a command that has them: what stands before the action counts too.
    """
    default = argparse.SUPPRESS if nested else False
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument(
        "--json", action="store_true", default=default, help="print a machine-readable result"
    )
    parser.add_argument("--verbose", action="store_true", default=default, help="log what happens")
    return parser
