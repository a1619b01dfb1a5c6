"""Tutorials as notebooks: they run whole in a kernel, show their pictures, and install what they need."""

import re
from pathlib import Path

import pytest
from shared_fixtures.processes.checkout import ROOT
from shared_fixtures.processes.notebooks import TUTORIALS, run_notebook


@pytest.mark.soak
@pytest.mark.parametrize("tutorial", TUTORIALS, ids=lambda tutorial: tutorial.stem)
def test_a_notebook_runs_whole(tutorial: Path, tmp_path: Path) -> None:
    """Where CarlaLoc is installed, the first cell does nothing; every picture of the page is shown."""
    first, *cells = run_notebook(tutorial, tmp_path, CARLALOC_SOURCE="/nowhere")
    assert first.outputs == []
    shown = [output.data for cell in cells for output in cell.outputs if output.output_type == "display_data"]
    pictures = re.findall(r"!\[.*?\]\(", tutorial.read_text(encoding="utf-8"))
    assert ["image/png" in data for data in shown] == [True] * len(pictures)


def test_the_first_cell_names_the_libraries_that_setup_installs() -> None:
    """Those of `.ci/system-libraries`, as the container has them."""
    listed = re.search(
        r'libraries = "([^"]+)"', (ROOT / "docs/site/tutorials.py").read_text(encoding="utf-8")
    )
    assert listed is not None
    needed = re.findall(r"need (lib[\w.+-]+)", (ROOT / ".ci/system-libraries").read_text(encoding="utf-8"))
    assert sorted(listed[1].split()) == sorted(needed)
