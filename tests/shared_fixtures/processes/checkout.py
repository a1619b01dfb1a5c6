"""Scripts of the checkout as modules, a copy of it for tests that install it, and pip."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[3]


def script(path: str) -> ModuleType:
    """A Python file of the checkout as a module."""
    name = Path(path).stem
    spec = importlib.util.spec_from_file_location(name, ROOT / path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def copy_of_checkout(folder: Path) -> Path:
    """All that a source distribution is made of, without what git ignores; returns the folder."""
    for name in ("carlaloc_env", "recorder", "maps"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / name)
    return folder


def run_pip(
    *words: str, python: str = sys.executable, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run pip, quietly; skip the test where pip reaches no index."""
    done = subprocess.run(
        [python, "-m", "pip", *words, "--quiet"],
        env=os.environ | (environment or {}),
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    unreachable = ("onnection", "resolv", "No matching distribution found for setuptools")
    if done.returncode and any(word in done.stderr for word in unreachable):
        pytest.skip("pip cannot reach an index for the build's own setuptools")
    return done
