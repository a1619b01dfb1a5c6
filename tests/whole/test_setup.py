"""`make setup` finds a Python from 3.10 to 3.13; without one, a line names the next step."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from shared_fixtures.processes.checkout import ROOT

TOOLS = ("sh", "dirname", "id", "env")
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


@pytest.mark.parametrize("version", ["3.10", "3.11", "3.12", "3.13"])
def test_every_supported_python_serves(bare: Path, version: str) -> None:
    """Whether it is `python3` or has its version in its name, and without a word."""
    add(bare, "python3", python_of(version))
    done = find_python(bare)
    assert (done.stdout.strip(), done.stderr) == (str(bare / "python3"), "")
    add(bare, f"python{version}", python_of(version))
    assert find_python(bare).stdout.strip() == str(bare / f"python{version}")


def test_a_name_that_does_not_start_is_passed_over(bare: Path) -> None:
    """pyenv puts python3.11 on PATH for a version that is not chosen, and exits with 127 when called."""
    for name in ("python3.11", "python3.10"):
        (bare / name).write_text("#!/bin/sh\nexit 127\n")
        (bare / name).chmod(0o755)
    add(bare, "python3", python_of("3.11", "3.10"))
    assert find_python(bare).stdout.strip() == str(bare / "python3")


def test_pyenvs_are_found_that_are_not_on_path(bare: Path) -> None:
    """A version that was installed but never chosen."""
    folder = bare.parent / ".pyenv" / "versions" / "3.10.99" / "bin"
    folder.mkdir(parents=True)
    add(folder, "python", python_of("3.10"))
    assert find_python(bare).stdout.strip() == str(folder / "python")


def test_no_python_and_a_wrong_one_end_in_one_line(bare: Path) -> None:
    """Both name the next step; 3.14, which PyBullet has no wheel for, is a wrong one."""
    (bare / "python3").write_text('#!/bin/sh\n[ "$1" = -c ] && exit 1\n')  # as 3.14 answers
    (bare / "python3").chmod(0o755)
    done = find_python(bare)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("no Python 3.10 to 3.13 here. Install")
    wrong = find_python(bare, python="/bin/false")
    assert (wrong.returncode, wrong.stdout) == (1, "")
    assert (
        wrong.stderr == "/bin/false is no 64-bit CPython 3.10 to 3.13. Run:  make setup PYTHON=python3.11\n"
    )


def test_a_second_setup_starts_at_once() -> None:
    """Once .venv is ready, make finds nothing to do, not even a Python to look for."""
    if not (ROOT / ".venv" / "ready").is_file() or shutil.which("make") is None:
        pytest.skip("no environment made by `make setup` here")
    needs = [ROOT / "pyproject.toml", ROOT / ".ci" / "system-libraries"]
    if any(path.stat().st_mtime > (ROOT / ".venv" / "ready").stat().st_mtime for path in needs):
        pytest.skip("`make setup` is due here")
    done = subprocess.run(["make", "-q", "setup"], cwd=ROOT, capture_output=True, check=False)
    assert done.returncode == 0
