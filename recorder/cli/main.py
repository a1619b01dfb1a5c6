"""The `carlaloc` command: sub-commands, one-line errors, exit codes, `--json`."""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module

from carlaloc_env import __version__
from carlaloc_env.core.errors import CarlaLocError, UsageError
from recorder.cli.arguments import check_outputs, shared_options

COMMANDS = ("doctor", "maps", "record", "info", "edit", "replay", "evaluate", "list", "completion")
"""Sub-commands; each is a module of this package with `add_arguments` and `run`."""

EXIT_DONE, EXIT_ERROR, EXIT_USAGE = 0, 1, 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns:
        0 when done, 1 after a named error (one line on stderr), 2 after a usage error.
    """
    parser = make_parser()
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    logging.basicConfig(
        level=logging.DEBUG if arguments.verbose else logging.WARNING,
        format="%(levelname)s %(name)s: %(message)s",
    )
    command = import_module(f"recorder.cli.{arguments.command}")
    try:
        check_outputs(parser, arguments)
        with _stdout_kept_clean():
            result = command.run(arguments)
    except UsageError as error:
        _fail(arguments, str(error))
        return EXIT_USAGE
    except CarlaLocError as error:
        return _fail(arguments, str(error))
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(arguments, f"{where}{error.strerror or error}")
    except KeyboardInterrupt:
        return _fail(arguments, "interrupted; nothing unfinished was left under a final name")
    if arguments.json:
        print(json.dumps(result, indent=2, default=str))
    else:
        command.show(result)
    return EXIT_ERROR if result.get("failed") else EXIT_DONE


@contextmanager
def _stdout_kept_clean() -> Iterator[None]:
    """Send what libraries print on their own (PyBullet does on import) to stderr."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        os.dup2(2, 1)
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)


def _fail(arguments: argparse.Namespace, message: str) -> int:
    line = " ".join(message.split())
    if arguments.json:
        print(json.dumps({"error": line}))
    print(f"carlaloc {arguments.command}: {line}", file=sys.stderr)
    return EXIT_ERROR


def make_parser() -> argparse.ArgumentParser:
    """Parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="carlaloc",
        description="Drive once; replay the drive under any weather and traffic; write bags; score SLAM.",
    )
    parser.add_argument("--version", action="version", version=f"carlaloc {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    shared = shared_options()
    for name in COMMANDS:
        module = import_module(f"recorder.cli.{name}")
        summary = (module.__doc__ or "").strip().splitlines()[0]
        sub = commands.add_parser(
            name, parents=[shared], help=summary, description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        module.add_arguments(sub)
    return parser


if __name__ == "__main__":
    sys.exit(main())
