"""The container's recipe, against `.ci/system-libraries`; the image runs where one can be built."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RECIPE = (ROOT / "Dockerfile").read_text()


def _installed() -> set[str]:
    found = re.search(r"apt-get install -y --no-install-recommends([^&]*)&&", RECIPE)
    assert found is not None
    return set(found[1].replace("\\\n", " ").split())


def test_container_has_the_libraries_that_setup_installs() -> None:
    script = (ROOT / ".ci/system-libraries").read_text()
    # What `need` names by itself; the packages of Python come with the image.
    needed = set(re.findall(r"need (lib[\w.+-]+)", script))
    assert len(needed) >= 5
    assert _installed() == needed


def test_container_runs_a_python_that_pybullet_has_wheels_for() -> None:
    assert re.search(r"^FROM python:3\.1[01]-slim", RECIPE, re.MULTILINE)


def test_container_installs_extras_that_exist() -> None:
    found = re.search(r"/opt/carlaloc\[([\w,]+)\]", RECIPE)
    assert found is not None
    project = (ROOT / "pyproject.toml").read_text()
    assert all(re.search(rf"^{extra} = \[", project, re.MULTILINE) for extra in found[1].split(","))


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
