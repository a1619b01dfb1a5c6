"""From make to close: nothing is held afterwards, nothing is printed, and a closed environment says so."""

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import RIG as SMALL
from shared_fixtures.drives.straight_drives import MakeEnv
from shared_fixtures.processes.lifecycles import growth

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import ClosedError, ConfigError, RenderError
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig

REST = np.array([0.0, -1.0], np.float32)
RIGS = {
    "state": rig_by_name("state"),
    "LiDAR": SensorRig(name="lidar", sensors=(LidarConfig(),)),
    "camera": SensorRig(name="camera", sensors=(CameraConfig(pinhole=Pinhole.from_fov(160, 96, 90.0)),)),
}
SILENT = """
import gymnasium, numpy, carlaloc_env
env = gymnasium.make("CarlaLoc-v0", map={map!r}, rig={rig!r}, traffic="static")
env.reset(seed=0)
env.step(env.action_space.sample())
env.close()
"""


def live(rig: str | SensorRig, **settings: Any) -> Callable[[int], None]:
    """One life of an environment: make, reset, step, close."""

    def cycle(seed: int) -> None:
        env = gymnasium.make("CarlaLoc-v0", rig=rig, **settings)
        env.reset(seed=seed)
        env.step(REST)
        env.close()

    return cycle


def test_a_closed_town_is_let_go() -> None:
    """Town03's collision mesh alone is 30 MB, of which two lives would leave 60."""
    assert growth(live("state", map="Town03", traffic="static"), 5, 3).memory_mb < 30.0


@pytest.mark.soak
@pytest.mark.timeout(36_000)
@pytest.mark.parametrize("name", RIGS)
def test_lives_in_a_row(
    name: str, straight_map: Path, record_property: Callable[[str, object], None]
) -> None:
    """20 kB each would show."""
    try:
        grown = growth(live(RIGS[name], map=straight_map, traffic="0.5"), 1000, 20)
    except RenderError as error:
        pytest.skip(str(error))
    record_property("what", f"make, reset, step, close; rig with {name}")
    record_property("inputs", 1000)
    record_property("growth", f"{max(grown.memory_mb, 0.0):.1f} MB")
    assert grown.memory_mb < 20.0
    assert grown.handles <= 0


@pytest.mark.soak
@pytest.mark.timeout(36_000)
def test_ten_thousand_resets(straight_map: Path, record_property: Callable[[str, object], None]) -> None:
    """2 kB each would show."""
    env = CarlaLocEnv(map=straight_map, rig="state", traffic="0.5")

    def cycle(seed: int) -> None:
        env.reset(seed=seed)
        env.step(REST)

    grown = growth(cycle, 10_000, 100)
    env.close()
    record_property("what", "reset and step, rig state")
    record_property("inputs", 10_000)
    record_property("growth", f"{max(grown.memory_mb, 0.0):.1f} MB")
    assert grown.memory_mb < 20.0
    assert grown.handles <= 0


@pytest.fixture
def closed(straight_map: Path) -> gymnasium.Env[Any, Any]:
    """An environment that has been closed, twice."""
    env: gymnasium.Env[Any, Any] = gymnasium.make(
        "CarlaLoc-v0", map=straight_map, rig="state", traffic="static", render_mode="rgb_array"
    )
    env.reset(seed=0)
    env.close()
    env.close()
    return env


@pytest.mark.parametrize("call", ["reset", "step", "render"])
def test_a_closed_environment_says_so(closed: gymnasium.Env[Any, Any], call: str) -> None:
    """One line with the next step, not PyBullet's complaint about a missing server."""
    arguments = (REST,) if call == "step" else ()
    with pytest.raises(ClosedError, match=rf"^{call} after close; .*gymnasium\.make\(\)$"):
        getattr(closed, call)(*arguments)


def test_bad_resets_are_refused_before_anything_moves(make_env: MakeEnv) -> None:
    """Seeds below zero, and seeds that are no whole numbers."""
    env = make_env(traffic="static")
    env.reset(seed=1)
    env.step(REST)
    for seed in (-1, 0.5, "3", True):
        with pytest.raises(ConfigError, match=r"^reset: the seed is .*; give a whole number of 0 or more"):
            env.reset(seed=seed)  # type: ignore[arg-type]
    assert env.world.now_ns == 50_000_000
    env.reset(seed=np.int64(3), options={})


@pytest.mark.parametrize("rig", ["state", "small"])
def test_nothing_is_printed(rig: str, straight_map: Path, tmp_path: Path) -> None:
    """Neither by us nor by the libraries below; the small rig has cameras and a LiDAR."""
    if rig == "small":
        (tmp_path / "small.yaml").write_text(SMALL)
        rig = str(tmp_path / "small.yaml")
    code = SILENT.format(map=str(straight_map), rig=rig)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    if b"RenderError" in done.stderr:
        pytest.skip("no OpenGL")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


def test_what_others_write_while_pybullet_is_imported_is_passed_on() -> None:
    code = "import os, sys, threading\n"
    code += "threading.Thread(target=lambda: [os.write(2, b'line\\n') for _ in range(20000)]).start()\n"
    code += "import carlaloc_env.physics.world"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout == b""
    assert done.stderr == b"line\n" * 20_000


def test_information_of_a_step_fits_a_screen(make_env: MakeEnv) -> None:
    """24 lines of 80 characters; programs read from it what they did, also after a copy."""
    env = make_env(map="Town03", rig=rig_by_name("state"), traffic="dynamic")
    env.reset(seed=0)
    info = env.step(REST)[-1]
    assert len(repr(info)) < 24 * 80
    assert "\n" not in repr(info["samples"]) + repr(info["objects"])
    assert [sample.sensor for sample in info["samples"]].count("imu") == 10
    assert len(info["objects"].id) == len(env.world.timeline.catalog) > 100
    assert f"{len(info['samples'])} samples: 10 imu" in repr(info["samples"])
    for copied in (copy.deepcopy(info), pickle.loads(pickle.dumps(info))):
        assert copied["samples"] == info["samples"]
        assert type(copied["samples"]) is type(info["samples"])
        assert copied["objects"] == info["objects"]
