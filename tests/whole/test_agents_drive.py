"""From an agent in an environment to a score in fog: its drive is one like any other, and teaches another."""

import re
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import need_opengl

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from recorder import BenchmarkConfig, RecordDrive, run_benchmark
from recorder.cli.main import main
from recorder.evaluation.trajectory_files import read_tum
from recorder.writers.base import DEFAULT_EPOCH_NS

ROOT = Path(__file__).parents[2]
VILLAGE = ROOT / "tests" / "data" / "village.xodr"
RIG = """\
name: few
sensors:
- {kind: lidar, name: lidar, columns: 300, mount: {position_m: [0.0, 0.0, 1.8]}}
- {kind: imu}
"""


def test_an_agent_drives_and_a_system_is_scored_in_fog(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The truth of the replay is where the environment's car was, and GICP stays near it."""
    pytest.importorskip("small_gicp", reason="needs small_gicp")
    env = gymnasium.make(
        "CarlaLoc-v0", map=VILLAGE, rig="state", action="ackermann", route="random", info=("truth",),
        traffic="dynamic,vehicles=6,walkers=2", task={"standing_limit_s": 30.0},
    )  # fmt: skip
    env = RecordDrive(env, tmp_path / "agent.mcap")
    seen, info = env.reset(seed=4)
    position_m = {info["stamp_ns"]: info["truth"].position_m}
    for _ in range(120):
        action = np.clip([-2.0 * seen[5] - 1.5 * seen[6], -0.4], -1.0, 1.0)
        seen, *_, info = env.step(action.astype(np.float32))
        position_m[info["stamp_ns"]] = info["truth"].position_m
    env.close()
    drive, rig, data = (
        tmp_path / f"agent-{info['drive_seed']}-0.mcap",
        tmp_path / "rig.yaml",
        tmp_path / "set",
    )
    rig.write_text(RIG)
    assert main(["info", str(drive)]) == 0
    assert "agent" in capsys.readouterr().out
    words = ["--rig", str(rig), "--weather", "FoggyNoon", "--format", "rosbag1", "--workers", "1"]
    words += ["--map", str(VILLAGE), "--no-preview", "--out", str(data)]
    assert main(["replay", str(drive), *words]) == 0
    (truth,) = data.rglob("base_link.tum")
    told = read_tum(truth)
    of_stamp = dict(zip((told.stamp_ns - DEFAULT_EPOCH_NS).tolist(), told.position_m, strict=True))
    shared = sorted(of_stamp.keys() & position_m.keys())
    assert len(shared) > 110
    driven = np.array([position_m[stamp] for stamp in shared])
    assert np.linalg.norm(driven[-1] - driven[0]) > 10.0
    np.testing.assert_allclose([of_stamp[stamp] for stamp in shared], driven, atol=2e-6)
    config = BenchmarkConfig(data=data, out=tmp_path / "scores", methods=("small_gicp",), clouds=("raw",))
    (score,) = run_benchmark(config).scores
    assert (score.weather, score.failed) == ("FoggyNoon", None)
    assert score.coverage > 0.95
    assert score.ape_m < 0.3


def test_the_page_learns_from_a_drive_in_fog(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its lines give a driver that repeats what the driver did where it has looked: throttle, then brake."""
    need_opengl()
    env = RecordDrive(CarlaLocEnv(straight_map, "state", traffic="empty"), tmp_path / "mine.mcap")
    _, info = env.reset(seed=1)
    for number in range(40):
        env.step(np.array([0.0, 0.8 if number < 30 else -0.6], np.float32))
    env.close()
    text = (ROOT / "docs" / "environments.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"<!-- imitation -->\n```python\n(.*?)```", text, re.DOTALL)
    make = gymnasium.make

    def smaller(name: str, **settings: Any) -> Any:
        assert settings["weather"] == "FoggyNoon"
        drive = tmp_path / f"mine-{info['drive_seed']}-0.mcap"
        return make(name, **settings | {"episode": drive, "map": straight_map, "quality": "low"})

    monkeypatch.setattr(gymnasium, "make", smaller)
    names: dict[str, Any] = {}
    exec(compile(block, "environments.md", "exec"), names)
    env, driver = names["env"], names["driver"]
    for start_s, pedal in ((0.4, 0.8), (1.8, -0.6)):
        seen, _ = env.reset(options={"start_s": start_s})
        action = driver(seen)
        did = env.step(None)[-1]["action"]
        np.testing.assert_allclose(did, (0.0, pedal), atol=1e-6)
        np.testing.assert_allclose(action, did, atol=0.2)
    env.close()
