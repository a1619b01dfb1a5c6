"""PyBullet and its fork, which has wheels for newer Pythons, compute the same drive to the last bit."""

import hashlib
import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from shared_fixtures.processes.checkout import run_pip

OTHER = {"pybullet": "pybullet-arm64", "pybullet-arm64": "pybullet"}
"""The build that is not installed, by the one that is."""


@pytest.fixture(scope="module")
def other_build(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the build of PyBullet that this environment has not, or a skip."""
    here = next(name for name in OTHER if _installed(name))
    folder = tmp_path_factory.mktemp("other")
    words = ("install", "--no-deps", "--only-binary", ":all:", "--target", str(folder), OTHER[here])
    done = run_pip(*words)
    if done.returncode:
        pytest.skip(f"pip finds no wheel of {OTHER[here]} for this Python")
    return folder


def _installed(name: str) -> bool:
    try:
        return bool(importlib.metadata.version(name))
    except importlib.metadata.PackageNotFoundError:
        return False


def carlaloc(*words: str, path: str = "") -> subprocess.CompletedProcess[str]:
    """Run the command with a folder before all others on Python's path."""
    environment = os.environ | {"PYTHONPATH": path}
    command = [sys.executable, "-m", "recorder.cli.main", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def messages_digest(episode: Path) -> str:
    """SHA-256 of all messages of a drive; versions of libraries stand in its header alone."""
    digest = hashlib.sha256()
    with episode.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            digest.update(channel.topic.encode() + message.log_time.to_bytes(8, "little") + message.data)
    return digest.hexdigest()


def test_both_builds_give_the_same_drive(other_build: Path, tmp_path: Path) -> None:
    """Among traffic, of which the nearest cars have bodies."""
    digests = []
    for name, path in (("here", ""), ("other", str(other_build))):
        out = tmp_path / f"{name}.mcap"
        done = carlaloc(
            "record", "--map", "Town03", "--duration", "5", "--seed", "3", "--out", str(out), path=path
        )
        assert done.returncode == 0, done.stderr
        digests.append(messages_digest(out))
    assert digests[0] == digests[1]


def test_doctor_refuses_both_at_once(other_build: Path) -> None:
    """They bring one module, so that the one installed last overwrites the other."""
    done = carlaloc("doctor", path=str(other_build))
    assert done.returncode == 1
    (line,) = [line for line in done.stdout.splitlines() if "are both installed" in line]
    assert "pybullet and pybullet-arm64" in line
