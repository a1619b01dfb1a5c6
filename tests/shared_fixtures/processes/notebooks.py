"""Notebooks of tutorials, run whole in the kernel of a Python."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from shared_fixtures.processes.checkout import ROOT, script

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.py"))


def run_notebook(tutorial: Path, folder: Path, python: str = sys.executable, **environment: str) -> list[Any]:
    """Make the notebook of a tutorial and run it in a folder; returns its cells of code.

    A Python other than that of the tests needs nbclient and ipykernel.
    """
    for module in ("jupytext", "nbclient", "ipykernel"):
        pytest.importorskip(module, reason="needs the group `docs`")
    import nbformat

    file = folder / f"{tutorial.stem}.ipynb"
    file.write_text(script("docs/site/tutorials.py").notebook_of(tutorial), encoding="utf-8")
    done = subprocess.run(
        [python, "-c", "from nbclient.cli import main; main()", "--inplace", str(file)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    notebook = nbformat.read(file, as_version=4)
    nbformat.validate(notebook)
    return [cell for cell in notebook.cells if cell.cell_type == "code"]
