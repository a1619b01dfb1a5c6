"""The container's recipe, against `.ci/system-libraries`; the image runs where one can be built."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RECIPE = (ROOT / "Dockerfile").read_text()


def test_container_has_the_libraries_that_setup_installs() -> None:
    installed = re.search(r"apt-get install -y --no-install-recommends([^&]*)&&", RECIPE)
    assert installed is not None
    script = (ROOT / ".ci/system-libraries").read_text()
    # What `need` names by itself; the packages of Python come with the image.
    needed = set(re.findall(r"need (lib[\w.+-]+)", script))
    assert len(needed) >= 5
    assert set(installed[1].replace("\\\n", " ").split()) == needed


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_image_is_built_and_runs() -> None:
    if (
        shutil.which("docker") is None
        or subprocess.run(["docker", "info"], capture_output=True, check=False).returncode
    ):
        pytest.skip("no docker daemon here")
    pull = subprocess.run(["docker", "pull", "python:3.11-slim-bookworm"], capture_output=True, check=False)
    if pull.returncode:
        pytest.skip("the image of Python cannot be pulled here")
    subprocess.run(["docker", "build", "-q", "-t", "carlaloc-test", str(ROOT)], check=True)
    told = subprocess.run(
        ["docker", "run", "--rm", "carlaloc-test", "list", "rigs"], capture_output=True, text=True, check=True
    )
    assert "paper" in told.stdout
