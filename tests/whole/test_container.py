"""The container's recipe, against `.ci/system-libraries`; images run where they can be built."""

import json
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


def test_the_development_container_names_what_exists() -> None:
    """Recipe, its stage and user, and the target of make that runs in it."""
    folder = ROOT / ".devcontainer"
    described = json.loads((folder / "devcontainer.json").read_text())
    build = described["build"]
    assert (folder / build["dockerfile"]).resolve() == ROOT / "Dockerfile"
    assert (folder / build["context"]).resolve() == ROOT
    (_, stage) = RECIPE.split(f" AS {build['target']}\n")
    assert re.search(rf"^USER {described['remoteUser']}$", stage.split("\nFROM")[0], re.MULTILINE)
    assert re.search(rf"useradd .*\b{described['remoteUser']}$", RECIPE, re.MULTILINE)
    program, target = described["postCreateCommand"].split()
    assert re.search(rf"install .*\b{program}\b", stage.split("\nFROM")[0])
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE)


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
    for words in (["--target", "development"], ["-t", "carlaloc-test"]):
        subprocess.run(["docker", "build", "-q", *words, str(ROOT)], check=True)
    told = subprocess.run(
        ["docker", "run", "--rm", "carlaloc-test", "list", "rigs"], capture_output=True, text=True, check=True
    )
    assert "paper" in told.stdout
