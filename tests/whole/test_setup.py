"""`make setup` finds a Python from 3.10 to 3.13; without one, a line names the next step."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from shared_fixtures.processes.checkout import ROOT

PYTHON = sys._base_executable  # type: ignore[attr-defined]
"""The Python of these tests, outside of any environment."""
TOOLS = ("sh", "dirname", "id", "env")
"""What `.ci/find-python` calls besides Pythons."""
VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A folder for PATH with the shell's tools and neither Python, compiler, apt nor uv."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in TOOLS:
        (folder / name).symlink_to(str(shutil.which(name)))
    return folder


def add(folder: Path, name: str, body: str = f'exec "{PYTHON}" "$@"') -> None:
    """Write a Python into a folder; a script, as a link would hide where its library is."""
    (folder / name).write_text(f"#!/bin/sh\n{body}\n")
    (folder / name).chmod(0o755)


def find_python(bare: Path, *, python: str = "") -> subprocess.CompletedProcess[str]:
    """Run `.ci/find-python` in a copy without .venv, with nothing on PATH but this folder."""
    checkout = bare.parent / "checkout"
    shutil.copytree(ROOT / ".ci", checkout / ".ci", dirs_exist_ok=True)
    hidden = ("PYENV_ROOT", "CC", "CXX", "PIP_CACHE_DIR", "XDG_CACHE_HOME")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    environment |= {"PATH": str(bare), "HOME": str(bare.parent), "PYTHON": python}
    return subprocess.run(
        [str(checkout / ".ci" / "find-python")], env=environment, capture_output=True, text=True, check=False
    )


def test_the_python_of_these_tests_serves(bare: Path) -> None:
    """Whether it is `python3` or has its version in its name, and without a word."""
    for name in ("python3", f"python{VERSION}"):
        add(bare, name)
        done = find_python(bare)
        assert (done.stdout.strip(), done.stderr) == (str(bare / name), "")


def test_a_name_that_does_not_start_is_passed_over(bare: Path) -> None:
    """pyenv puts python3.11 on PATH for a version that is not chosen, and exits with 127 when called."""
    for name in ("python3.11", "python3.10"):
        add(bare, name, "exit 127")
    add(bare, "python3")
    assert find_python(bare).stdout.strip() == str(bare / "python3")


def test_pyenvs_are_found_that_are_not_on_path(bare: Path) -> None:
    """A version that was installed but never chosen."""
    folder = bare.parent / ".pyenv" / "versions" / f"{VERSION}.99" / "bin"
    folder.mkdir(parents=True)
    add(folder, "python")
    assert find_python(bare).stdout.strip() == str(folder / "python")


def test_no_python_and_a_wrong_one_end_in_one_line(bare: Path) -> None:
    """Both name the next step; 3.14, which PyBullet has no wheel for, is a wrong one."""
    add(bare, "python3", '[ "$1" = -c ] && exit 1')  # as 3.14 answers
    done = find_python(bare)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("no Python 3.10 to 3.13 here. Install")
    wrong = find_python(bare, python="/bin/false")
    assert (wrong.returncode, wrong.stdout) == (1, "")
    assert (
        wrong.stderr == "/bin/false is no 64-bit CPython 3.10 to 3.13. Run:  make setup PYTHON=python3.11\n"
    )
