"""`make setup` finds a Python that PyBullet comes for, and where none is, one line says what to do."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from shared_fixtures.processes.checkout import ROOT, copy_of_checkout, run_pip

TOOLS = ("sh", "dirname", "tr", "grep", "id", "env")
"""What `.ci/find-python` calls besides Pythons."""


def version_of(python: Path | str) -> str:
    """Major and minor version of a Python that starts, else nothing: pyenv's shims may stand for none."""
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    try:
        done = subprocess.run([str(python), "-c", code], capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip()


def python_of(*versions: str) -> str:
    """A Python of the machine of one of these versions, outside of any environment, or a skip."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for version in versions:
        names = (shutil.which(f"python{version}"), *pyenv.glob(f"{version}.*/bin/python"))
        for path in filter(None, names):
            if version_of(path) == version:
                found = [str(path), "-c", "import sys; print(sys._base_executable)"]
                return subprocess.run(found, capture_output=True, text=True, check=True).stdout.strip()
    pytest.skip(f"no Python {' or '.join(versions)} on this machine")


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A folder for PATH with the shell's tools and neither Python, compiler, apt nor uv."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in TOOLS:
        (folder / name).symlink_to(str(shutil.which(name)))
    return folder


def add(folder: Path, name: str, python: str) -> None:
    """Give a Python a name in a folder; a script, as a link would hide where its library is."""
    (folder / name).write_text(f'#!/bin/sh\nexec "{python}" "$@"\n')
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


def test_a_python_with_wheels_is_taken_before_a_newer_one(bare: Path) -> None:
    """Also when `python3` is the newer one, as on Debian 13, and without a word."""
    add(bare, "python3", python_of("3.12", "3.13", "3.14"))
    add(bare, "python3.10", python_of("3.10"))
    done = find_python(bare)
    assert (done.stdout.strip(), done.stderr) == (str(bare / "python3.10"), "")
    add(bare, "python3.11", python_of("3.11"))
    assert find_python(bare).stdout.strip() == str(bare / "python3.11")


def test_a_newer_python_is_taken_with_a_word_on_what_a_build_takes(bare: Path) -> None:
    """Without a compiler the Debian package that lacks is named, too."""
    python = python_of("3.12", "3.13", "3.14")
    add(bare, f"python{version_of(python)}", python)
    done = find_python(bare)
    assert done.stdout.strip() == str(bare / f"python{version_of(python)}")
    (line,) = done.stderr.splitlines()
    assert "about 12 minutes on two cores" in line
    assert "lacks g++" in line


def test_no_python_and_a_wrong_one_end_in_one_line(bare: Path) -> None:
    """Both say what to do next."""
    done = find_python(bare)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("no Python 3.10 to 3.14 here. Install")
    assert len(done.stderr.splitlines()) == 1
    wrong = find_python(bare, python="/bin/false")
    assert (wrong.returncode, wrong.stdout) == (1, "")
    assert "/bin/false is no 64-bit CPython" in wrong.stderr


def test_pip_without_wheel_and_compiler_ends_in_one_line(bare: Path, tmp_path: Path) -> None:
    """`pip install .` stops before it loads anything; for another machine, the wheel can be built."""
    python = python_of("3.12", "3.13", "3.14")
    subprocess.run([python, "-m", "venv", "--without-pip", str(tmp_path / "venv")], check=True)
    inside = ("--python", str(tmp_path / "venv" / "bin" / "python"), "install")
    source = str(copy_of_checkout(tmp_path / "source"))
    alone = {"PATH": str(bare), "CC": "", "CXX": "", "PIP_CACHE_DIR": str(tmp_path / "cache")}
    done = run_pip(*inside, source, environment=alone)
    assert done.returncode != 0
    (line,) = [line for line in done.stderr.splitlines() if "PyBullet" in line]
    assert "lacks g++: use Python 3.11" in line
    assert "Traceback" not in done.stderr
    unchecked = ("--dry-run", "--no-deps", "-C", "pybullet=unchecked")
    assert run_pip(*inside, *unchecked, source, environment=alone).returncode == 0


def test_a_second_setup_starts_at_once() -> None:
    """Once .venv is ready, make finds nothing to do, not even a Python to look for."""
    if not (ROOT / ".venv" / "ready").is_file() or shutil.which("make") is None:
        pytest.skip("no environment made by `make setup` here")
    needs = [ROOT / "pyproject.toml", ROOT / ".ci" / "system-libraries"]
    if any(path.stat().st_mtime > (ROOT / ".venv" / "ready").stat().st_mtime for path in needs):
        pytest.skip("`make setup` is due here")
    done = subprocess.run(["make", "-q", "setup"], cwd=ROOT, capture_output=True, check=False)
    assert done.returncode == 0
