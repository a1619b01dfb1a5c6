"""The page of public names, what the packages lend, and what importing them costs."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import carlaloc_env
import recorder

ROOT = Path(__file__).parents[2]
"""Libraries that nobody pays for who only registers the environments."""


def listed() -> list[tuple[str, str]]:
    """Package and name of every item of docs/api.md."""
    package, rows = "", []
    for line in (ROOT / "docs" / "api.md").read_text(encoding="utf-8").splitlines():
        if heading := re.fullmatch(r"## (\w+)", line):
            package = heading[1]
        elif row := re.match(r"\* (`\w+`(?:, `\w+`)*): ", line):
            rows += [(package, name) for name in re.findall(r"\w+", row[1])]
    return rows


@pytest.mark.parametrize(("package", "name"), listed(), ids=lambda part: part)
def test_every_name_of_the_page_can_be_imported(package: str, name: str) -> None:
    """It is the very object of the module that defines it, and is documented there."""
    value = getattr(importlib.import_module(package), name)
    home = getattr(value, "__module__", None)
    if isinstance(value, type) or callable(value):
        assert value.__doc__, name
        assert getattr(importlib.import_module(str(home)), name) is value


def test_the_page_lists_all_that_is_lent_and_no_more() -> None:
    for package in (carlaloc_env, recorder):
        names = set(package.__all__) - {"TOWNS", "__version__"}
        assert names == {name for owner, name in listed() if owner == package.__name__}
    assert len(listed()) == len(set(listed()))


def test_unknown_names_are_refused_as_python_does() -> None:
    with pytest.raises(AttributeError, match="module 'carlaloc_env' has no attribute 'load_twon'"):
        carlaloc_env.load_twon  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'nothing'"):
        exec("from recorder import nothing")


LOADED = {"carlaloc_env", "recorder", "numpy", "gymnasium", "farama_notifications", "typing_extensions"}
"""All that an import may load beside Python's own: what registering the environments needs."""
CODE = """
import sys
before = set(sys.modules)
import {package}
print(*sorted(name for name in set(sys.modules) - before if "." not in name))
print(*sorted(name for name in sys.modules if name.startswith(("carlaloc_env.", "recorder."))))
"""


@pytest.mark.parametrize("package", ["carlaloc_env", "recorder"])
def test_importing_a_package_loads_nothing_heavy(package: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE.format(package=package)], capture_output=True, text=True, check=True
    )
    loaded, ours = done.stdout.splitlines()
    foreign = {name for name in loaded.split() if name not in sys.stdlib_module_names}
    assert {name for name in foreign if not re.match("_|cython_runtime", name)} <= LOADED
    assert set(ours.split()) == {"carlaloc_env.core", "carlaloc_env.core.lazy_names"}
