"""Paths, options and public names in docs exist, and docs name functions and options of all commands."""

import argparse
import ast
import importlib
import re
import subprocess
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from shared_fixtures.processes.commands import all_commands

import carlaloc_env
import recorder
from recorder.cli.main import COMMANDS, make_parser

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
TEXT = {page: page.read_text(encoding="utf-8") for page in PAGES}
PUBLIC = {package.__name__: set(package.__all__) for package in (carlaloc_env, recorder)}
HELP_ALONE = {
    # They say to which data other options apply, and have the same words in `--help` and in docs of formats.
    "evaluate": {"--distances", "--town", "--truth-quaternion", "--truth-time-unit"},
    "view": {"--frame"},
    # Sizes and choices whose defaults fit.
    "demo": {"--look"},
    "places": {"--within"},
    "minari": {"--action"},
    "closedloop": {"--limit"},
    "vocabulary": {"--images"},
    # Every program has it.
    "": {"--version"},
}
"""Options that `--help` explains well enough, by command: docs do not repeat them."""
FOREIGN = {
    "nerfstudio": {"--auto-scale-poses", "--center-method", "--data", "--orientation-method"},
    "other programs for cameras and SLAM": {"--cam-calib", "--config"},
    "smfeval": {"--cov", "--est-body-frame", "--ref-body-frame"},
    "docker and pip": {"--cpus", "--gpus", "--group", "--index-url"},
    "dask": {"--memory-limit", "--nthreads", "--nworkers", "--port"},
}
"""Options of programs of others that docs name."""


def spans(text: str) -> list[str]:
    """Text in backquotes outside blocks of code."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


def options_named(text: str) -> set[str]:
    """Long options in a text."""
    return set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", text))


def options_of(parser: argparse.ArgumentParser) -> set[str]:
    """Long options of a command."""
    return {word for action in parser._actions for word in action.option_strings if word.startswith("--")}


def repository_paths() -> set[str]:
    """Files and folders of the repository; those of its packages also by their last parts alone."""
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    done = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("this is no clone")
    files = [line for line in done.stdout.splitlines() if (ROOT / line).exists()]
    paths = {"/".join(file.split("/")[:k]) for file in files for k in range(1, file.count("/") + 2)}
    inner = [path.split("/") for path in paths if path.startswith(("carlaloc_env/", "recorder/"))]
    examples = {path.rpartition("/")[2] for path in paths if path.startswith("examples/")}
    return paths | examples | {"/".join(parts[k:]) for parts in inner for k in range(1, len(parts))}


def paths_named(text: str, folders: set[str]) -> Iterator[str]:
    """Paths in backquotes that look like ours: source files, and files and folders below one of ours."""
    for word in (
        word for span in spans(text) for word in re.findall(r"(?<![\w<])[\w.-]+(?:/[\w.<>-]+)*", span)
    ):
        is_source = word.endswith((".py", ".glsl", ".jinja")) and not word.startswith((".py", ".glsl"))
        is_source |= word.startswith(("carlaloc_env/", "recorder/", "docs/", "examples/", "tests/", "maps/"))
        is_folder = "/" in word and word.split("/")[0] in folders and "." not in word
        if "<" not in word and (is_source or is_folder):
            yield word.rstrip("/")


def test_named_paths_exist() -> None:
    """Source files and folders in backquotes exist, from the root or from within a package."""
    paths = repository_paths()
    sources = [Path(path) for path in paths if path.endswith((".py", ".glsl")) and "/" in path]
    folders = {path.parts[0] for path in sources if (ROOT / path).exists()}
    folders |= {path.parent.name for path in sources if path.parts[0] in PUBLIC} - OUTPUTS
    for page, text in TEXT.items():
        if page.name != "CHANGELOG.md":
            gone = [path for path in paths_named(text, folders) if path not in paths]
            assert not gone, f"{page.relative_to(ROOT)}: {gone}"


OUTPUTS = {"ground_truth", "lidar", "camera", "ros", "kalibr"}
"""Folders of datasets that are called as ours."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_dotted_names_exist(page: Path) -> None:
    """Names such as `recorder.replay` are public, or modules that a text explains."""
    if page.name == "CHANGELOG.md":
        return
    for name in re.findall(r"(?<![/\w.])(?:carlaloc_env|recorder)(?:\.\w+)+(?![\w/])", TEXT[page]):
        package, *rest = name.split(".")
        is_public = len(rest) == 1 and rest[0] in PUBLIC[package]
        assert is_public or name.endswith(".py") or find_spec(name) is not None, name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_python_blocks_import_what_exists(page: Path) -> None:
    for block in re.findall(r"```python\n(.*?)```", TEXT[page], re.DOTALL):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PUBLIC:
                for alias in node.names:
                    assert hasattr(importlib.import_module(node.module), alias.name), alias.name


def test_named_options_exist() -> None:
    """Options in docs are those of `carlaloc`, of our scripts, or of programs of others that are listed."""
    scripts = "\n".join(
        path.read_text(encoding="utf-8")
        for folder in ("benchmarks", "docs", "examples", "maps")
        for path in (ROOT / folder).rglob("*.py")
    )
    ours = options_named(scripts)
    ours |= {option for _, parser in all_commands() for option in options_of(parser)}
    for page, text in TEXT.items():
        unknown = options_named(text) - ours.union(*FOREIGN.values())
        assert not unknown or page.name == "CHANGELOG.md", f"{page.relative_to(ROOT)}: {unknown}"


def test_docs_name_every_option() -> None:
    """Each option stands in docs, or in the list of those that `--help` alone explains."""
    named = set().union(*map(options_named, TEXT.values()))
    commands: dict[str, set[str]] = {"": options_of(make_parser())}
    for path, parser in all_commands():
        commands.setdefault(path[0], set()).update(options_of(parser))
    unnamed = {name: options - named for name, options in commands.items() if options - named}
    assert unnamed == HELP_ALONE


def test_every_command_has_a_public_function() -> None:
    """The table of commands names functions that are public and that the command itself uses."""
    table = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `carlaloc (\w+).*\| ([^|]+) \|$", table, re.MULTILINE)
    assert tuple(name for name, _ in rows) == COMMANDS
    for command, cell in rows:
        functions = re.findall(r"`(\w+)`", cell)
        assert functions or command == "completion", command
        (module,) = (ROOT / "recorder" / "cli").rglob(f"commands/**/{command}.py")
        tree = ast.parse(module.read_text(encoding="utf-8"))
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        used = {alias.name for node in imports for alias in node.names}
        assert set(functions) <= PUBLIC["recorder"] & used, module.name


SCRIPTS = sorted([*(ROOT / "examples").rglob("*.py"), *(ROOT / "docs" / "tutorials").glob("*.py")])


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_tutorials_and_examples_use_public_names(script: Path) -> None:
    """They import from the packages themselves, never from their modules."""
    for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if (
            isinstance(node, ast.ImportFrom)
            and node.module
            and not node.module.startswith("carlaloc_env.maps")
        ):
            if node.module.split(".")[0] in PUBLIC:
                names = {alias.name for alias in node.names}
                assert names <= PUBLIC.get(node.module, set()), f"{node.module}: {names}"
        elif isinstance(node, ast.Import):
            for alias in node.names:
                assert alias.name in PUBLIC or alias.name.split(".")[0] not in PUBLIC, alias.name
