"""All commands and their options, taken from the parsers themselves, so that new ones are covered."""

import argparse
from collections.abc import Iterator
from pathlib import Path

from recorder.cli.arguments import OutputFile, OutputFolder, input_path
from recorder.cli.main import make_parser

Leaf = tuple[tuple[str, ...], argparse.ArgumentParser]
"""Words of a command, such as ``("maps", "check")``, and its parser."""


def all_commands(
    parser: argparse.ArgumentParser | None = None, words: tuple[str, ...] = ()
) -> Iterator[Leaf]:
    """Every command without commands of its own."""
    parser = parser or make_parser()
    below = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    for action in below:
        for name, sub in action.choices.items():
            yield from all_commands(sub, (*words, name))
    if not below:
        yield words, parser


def is_output(action: argparse.Action) -> bool:
    """Whether an option names a file or folder that is written."""
    return isinstance(action.type, (OutputFile, OutputFolder))


def required_words(
    parser: argparse.ArgumentParser, missing: Path, *, without: argparse.Action | None = None
) -> list[str]:
    """Something for all that a command must be given; inputs are files that do not exist.

    Args:
        parser: The command's parser.
        missing: A folder that does not exist.
        without: An option that is left out.
    """
    words: list[str] = []
    for action in parser._actions:
        if not action.required or action is without:
            continue
        value = str(next(iter(action.choices))) if action.choices else "1"
        if action.type is input_path or is_output(action):
            suffix = action.type.suffixes[0] if isinstance(action.type, OutputFile) else ""
            value = str(missing / f"{action.dest}{suffix}")
        words += [action.option_strings[0], value] if action.option_strings else [value]
    return words
