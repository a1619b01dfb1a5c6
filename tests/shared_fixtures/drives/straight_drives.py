"""A drive of two seconds on a map that stands in a moment, a rig of small sensors, and commands over them."""

import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from shared_fixtures.processes.made_once import made_once

from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from recorder.drive.record import RecordConfig, record
from recorder.replaying.options import ReplayConfig

RIG = """\
name: small
sensors:
- {kind: lidar, name: lidar, columns: 200, outputs: [cloud, semantic], mount: {position_m: [0.0, 0.0, 1.8]}}
- {kind: imu}
- {kind: gnss}
- kind: camera
  name: left
  mount: {position_m: [0.3, 0.2, 1.6], axes: optical}
  pinhole: {width_px: 160, height_px: 90, fx_px: 80, fy_px: 80, cx_px: 80, cy_px: 45}
  outputs: [rgb, depth, semantic, events]
- kind: camera
  name: right
  mount: {position_m: [0.3, -0.2, 1.6], axes: optical}
  pinhole: {width_px: 160, height_px: 90, fx_px: 80, fy_px: 80, cx_px: 80, cy_px: 45}
  outputs: [rgb]
"""
STATE_RIG = "name: few\nsensors:\n- {kind: imu}\n- {kind: gnss}\n"


MakeEnv = Callable[..., CarlaLocEnv]


@dataclass(frozen=True)
class StraightDrive:
    """Files of the drive."""

    episode: Path
    town: Path
    rig: Path
    state_rig: Path

    def config(self, out: Path, **changes: Any) -> ReplayConfig:
        """A replay by the rig without cameras, in four units of one traffic level."""
        settings: dict[str, Any] = {
            "episode": self.episode, "map": self.town, "rig": str(self.state_rig), "out": out,
            "formats": ("rosbag1", "euroc"), "unit_s": 0.5, "workers": 1, "quality": "low",
        }  # fmt: skip
        return ReplayConfig(**{**settings, **changes})

    def command(self, out: Path, *words: str, rig: Path | None = None) -> list[str]:
        """The command for the same."""
        return [
            sys.executable, "-m", "recorder.cli.main", "replay", str(self.episode), "--out", str(out),
            "--map", str(self.town), "--rig", str(rig or self.state_rig), "--unit", "0.5",
            "--quality", "low", *words,
        ]  # fmt: skip


@pytest.fixture(scope="session")
def straight_drive(tmp_path_factory: pytest.TempPathFactory, straight_map: Path) -> StraightDrive:
    """Two seconds among a few others; never write to these files."""

    def make(folder: Path) -> None:
        drive = files(folder)
        shutil.copy(straight_map, drive.town)
        traffic = "dynamic,vehicles=5,walkers=0"
        record(RecordConfig(map=str(drive.town), out=drive.episode, duration_s=2.0, seed=5, traffic=traffic))
        drive.rig.write_text(RIG)
        drive.state_rig.write_text(STATE_RIG)

    def files(folder: Path) -> StraightDrive:
        names = ("drive.mcap", "straight.xodr", "rig.yaml", "state_rig.yaml")
        return StraightDrive(*(folder / name for name in names))

    return files(made_once(tmp_path_factory, "straight_drive", make))


@pytest.fixture
def make_env(straight_map: Path) -> Iterator[MakeEnv]:
    """Makes environments, closed in the end: of the straight map, without traffic, `state`, if not said."""
    usual: dict[str, Any] = {"map": straight_map, "rig": "state", "traffic": "empty"}
    with ExitStack() as made:
        yield lambda **settings: made.enter_context(closing(CarlaLocEnv(**usual | settings)))
