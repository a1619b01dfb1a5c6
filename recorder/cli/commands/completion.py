"""Print the completion of `carlaloc` for a shell.

Examples:
  carlaloc completion bash > ~/.local/share/bash-completion/completions/carlaloc
  carlaloc completion zsh > ~/.zfunc/_carlaloc
"""

import argparse
from importlib.util import find_spec
from typing import Any

from carlaloc_env.core.errors import MissingDependencyError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc completion`."""
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"), metavar="SHELL", help="bash, zsh or tcsh")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Make the script.

    Raises:
        MissingDependencyError: shtab is not installed.
    """
    if find_spec("shtab") is None:
        raise MissingDependencyError('shtab is not installed; pip install "carlaloc[completion]"')
    import shtab

    from recorder.cli.main import make_parser

    return {"shell": arguments.shell, "script": shtab.complete(make_parser(), shell=arguments.shell)}


def show(result: dict[str, Any]) -> None:
    """Print the script."""
    print(result["script"])
