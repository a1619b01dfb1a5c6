"""An episode read by the libraries with which Foxglove opens MCAP files."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode

ROOT = Path(__file__).parents[2]
PACKAGES = (
    "@mcap/core",
    "@mcap/nodejs",
    "@mcap/support",
    "@foxglove/rosmsg",
    "@foxglove/rosmsg2-serialization",
)


@pytest.fixture(scope="module")
def modules() -> Path:
    """Folder with Foxglove's packages."""
    folder = Path(os.environ.get("CARLALOC_NODE_MODULES", ROOT / ".foxglove" / "node_modules"))
    if shutil.which("node") is None or not all((folder / name).is_dir() for name in PACKAGES):
        pytest.skip(f"needs node and: npm install --prefix .foxglove {' '.join(PACKAGES)}")
    return folder


def test_foxglove_reads_an_episode(modules: Path, tmp_path: Path) -> None:
    out = tmp_path / "drive.mcap"
    record(RecordConfig(map="Town03", out=out, duration_s=4.0, traffic="0.2"))
    script = Path(__file__).with_name("read_mcap.mjs")
    command = ["node", str(script), str(out), str(modules)]
    answer = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert answer.returncode == 0, answer.stderr
    found, episode = json.loads(answer.stdout), Episode.load(out)
    ego = found["/ego/state"]
    assert ego["count"] == len(episode.ego)
    assert ego["last_ns"] == int(episode.ego["tick"][-1]) * 5_000_000
    for name in ("position_m", "quat_xyzw", "speed_mps", "throttle", "wheel_spin_radps"):
        np.testing.assert_array_equal(ego["last"][name], episode.ego[name][-1])
    actors = found["/actors"]
    assert len(actors["last"]["x_tile"]) == len(episode.header.catalog.id)
    assert found["/events"]["last"]["kind"] == "end"
    assert json.loads(found["/events"]["last"]["json"])["route_m"] > 0.0
