"""Whether pip can bring PyBullet to this Python: as a wheel, or built from source where a compiler is.

`python pybullet_check.py` says in one line what a build takes, and nothing where a wheel fits;
with `--missing`, it prints the Debian packages that a build lacks.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

VERSION = f"{sys.version_info[0]}.{sys.version_info[1]}"
WHEEL_VERSIONS = ("3.10", "3.11")
"""Versions of CPython that PyPI has wheels of PyBullet 3.2.7 for, on Linux with x86-64."""
BUILD_TIME = "about 12 minutes on two cores"


def missing() -> list[str]:
    """Debian's names of what has to be installed before pip can bring PyBullet; empty if nothing."""
    packages = _missing_for_a_build()
    return [] if not packages or comes_ready() else packages


def refusal() -> str:
    """One line that says what to do where PyBullet can be neither installed nor built; else empty."""
    packages = " ".join(missing())
    if not packages:
        return ""
    return (
        f"PyBullet has no wheel for this Python {VERSION}, and building it lacks {packages}: "
        "use Python 3.11 (`make setup` finds or installs it; or `uv venv --python 3.11`), or run: "
        f"apt-get install {packages}, then this again ({BUILD_TIME})."
    )


def forecast() -> str:
    """One line on what it will take to build PyBullet; empty where it comes as a wheel."""
    if comes_ready():
        return ""
    packages = " ".join(_missing_for_a_build())
    return (
        f"PyBullet has no wheel for this Python {VERSION}: pip builds it once, {BUILD_TIME}"
        + (f", and lacks {packages} for that" if packages else "")
        + ". A Python 3.11 (of uv, for instance) spares it."
    )


def comes_ready() -> bool:
    """Whether PyBullet is installed, or pip finds a wheel: on its index, in PIP_FIND_LINKS, in its cache."""
    if platform.machine() == "x86_64" and sys.platform == "linux" and VERSION in WHEEL_VERSIONS:
        return True
    spec = "import importlib.util, sys; sys.exit(importlib.util.find_spec('pybullet') is None)"
    if _run("-c", spec).returncode == 0:
        return True
    offered = _run(
        *("-m", "pip", "install", "--quiet", "--dry-run", "--no-deps", "--ignore-installed"),
        *("--only-binary", "pybullet", "pybullet>=3.2.5"),
    )
    if offered.returncode == 0:
        return True
    kept = _run("-m", "pip", "cache", "list", "pybullet").stdout
    return f"-cp{VERSION.replace('.', '')}-" in kept


def _run(*words: str) -> subprocess.CompletedProcess[str]:
    # -I: while pip builds, PYTHONPATH hides what is installed, pip included.
    return subprocess.run([sys.executable, "-I", *words], capture_output=True, text=True, check=False)


def _missing_for_a_build() -> list[str]:
    if os.name == "nt":
        return []  # setuptools finds Microsoft's compiler by itself
    packages = []
    if not (_command("CC", "cc") and _command("CXX", "c++")):
        packages.append("g++")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        packages.append(f"python{VERSION}-dev")
    return packages


def _command(variable: str, otherwise: str) -> str | None:
    """Path of the compiler that setuptools will call."""
    line = os.environ.get(variable) or sysconfig.get_config_var(variable) or otherwise
    return shutil.which(shlex.split(line)[0])


if __name__ == "__main__":
    answer = " ".join(missing()) if sys.argv[1:] == ["--missing"] else forecast()
    if answer:
        print(answer)
