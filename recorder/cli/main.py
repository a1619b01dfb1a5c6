"""The `carlaloc` command: sub-commands, one-line errors, exit codes, `--json`."""

import argparse
import logging
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn, TextIO, cast

from carlaloc_env import __version__
from carlaloc_env.core.errors import CarlaLocError, UsageError
from recorder.cli.arguments import check_outputs, shared_options
from recorder.cli.interrupts import ended_as_by_ctrl_c
from recorder.cli.output import make_streams_safe, to_json

COMMANDS = (
    "demo", "doctor", "maps", "record", "info", "edit", "replay", "dataset", "verify", "realism", "odometry",
    "evaluate", "places", "minari", "benchmark", "sweep", "break", "consistency", "closedloop", "vocabulary",
    "view", "list", "completion",
)  # fmt: skip
"""Sub-commands; each is a module of `commands` with `add_arguments` and `run`."""

EXIT_DONE, EXIT_ERROR, EXIT_USAGE = 0, 1, 2
EXIT_PIPE = 141
"""Exit code when the reader of the output has gone: that of a program which SIGPIPE ends in a shell."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns:
        0 when done, 1 after a named error (one line on stderr), 2 after a usage error, 141 when the reader
        of the output has gone, as in ``carlaloc list weathers | head -1``.
    """
    make_streams_safe()
    try:
        code = _main(argv)
        sys.stdout.flush()
    except BrokenPipeError:
        _drop(sys.stdout, sys.stderr)
        return EXIT_PIPE
    except OSError as error:
        # The rest of the output is lost, and stderr may be as full.
        _drop(sys.stdout)
        with suppress(OSError):
            print(f"carlaloc: cannot write to stdout: {error.strerror or error}", file=sys.stderr)
        return EXIT_ERROR
    return code


def _drop(*streams: TextIO) -> None:
    """Drop the output of streams: Python flushes them at exit, and would report the same error once more."""
    for stream in streams:
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())


def _main(argv: Sequence[str] | None) -> int:
    words = sys.argv[1:] if argv is None else list(argv)
    as_json = any(len(word) > 2 and "--json".startswith(word) for word in words)
    parser = make_parser()
    printed = StringIO()
    try:
        with redirect_stdout(printed):
            arguments = parser.parse_args(words)
    except UsageError as error:
        return _fail("", str(error), as_json=as_json, code=EXIT_USAGE)
    except SystemExit as stop:
        text = printed.getvalue()
        print(to_json({"text": text}) if as_json else text, end="\n" if as_json else "")
        return int(stop.code or 0)
    shown = logging.StreamHandler()
    shown.setLevel(logging.DEBUG if arguments.verbose else logging.WARNING)
    # A log file may hold more than is shown.
    logging.basicConfig(
        level=logging.DEBUG if arguments.verbose else logging.INFO,
        format="%(levelname)s %(name)s: %(message)s",
        handlers=[shown],
    )
    command = _module(arguments.command)
    name = str(arguments.command)
    try:
        check_outputs(parser, arguments)
        with ended_as_by_ctrl_c(), _stdout_kept_clean():
            result = command.run(arguments)
    except UsageError as error:
        return _fail(name, str(error), as_json=as_json, code=EXIT_USAGE)
    except CarlaLocError as error:
        return _fail(name, str(error), as_json=as_json)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(name, f"{where}{error.strerror or error}", as_json=as_json)
    except KeyboardInterrupt as stop:
        what = str(stop) or "nothing unfinished was left under a final name"
        code = _fail(name, f"interrupted; {what}", as_json=as_json)
        if argv is None:
            # Where an interrupt has passed through exec(), as in a dataclass's making, Python would
            # end by SIGINT, although it was handled.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        return code
    except Exception as error:
        if as_json:
            print(to_json({"error": f"{type(error).__name__}: {error}"}))
        raise
    if as_json:
        print(to_json(result))
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


def _fail(command: str, message: str, *, as_json: bool, code: int = EXIT_ERROR) -> int:
    line = " ".join(message.split())
    if as_json:
        print(to_json({"error": line}))
    print(f"{' '.join(['carlaloc', command]).strip()}: {line}", file=sys.stderr)
    return code


class _Parser(argparse.ArgumentParser):
    """A parser that raises its messages about wrong words, so that `--json` can report them.

    A word that begins with a minus and a digit is a value: -1.5,2 and -2s as well as -1.
    """

    def __init__(self, *words: Any, **settings: Any) -> None:
        super().__init__(*words, **settings)
        self._negative_number_matcher = re.compile(r"-(\.?\d|inf|nan)", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """Refuse the words of a command.

        Raises:
            UsageError: always.
        """
        self.print_usage(sys.stderr)
        raise UsageError(f"{self.prog.removeprefix('carlaloc').strip()}: {message}".removeprefix(": "))


def _module(name: str) -> ModuleType:
    """Module of a command."""
    return import_module(f"recorder.cli.commands.{name}")


def make_parser() -> argparse.ArgumentParser:
    """Parser of all commands."""
    description = "Drive once; replay the drive under any weather and traffic; write bags; score SLAM."
    parser = cast(argparse.ArgumentParser, _Parser(prog="carlaloc", description=description))
    parser.add_argument("--version", action="version", version=f"carlaloc {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    shared = shared_options()
    for name in COMMANDS:
        module = _module(name)
        # Without docstrings (python -OO) the name has to do.
        summary = (module.__doc__ or name).strip().splitlines()[0]
        sub = commands.add_parser(
            name, parents=[shared], help=summary, description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        module.add_arguments(sub)
    return parser


if __name__ == "__main__":
    sys.exit(main())
