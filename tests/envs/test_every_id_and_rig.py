"""Gymnasium's own checks, warnings fatal: both classes of environments, every rig; every id in the soak."""

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env
from shared_fixtures.worlds.render_scenes import need_opengl

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.rigs.presets import RIGS, rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.camera_config import CameraConfig

SLOW = ("paper", "real", "flu", "dsec")
"""Rigs whose pictures take ten seconds and more here."""
REPLAY = "CarlaLoc-Replay-v0"
"""It needs a drive: `tests/episode_env` checks it."""
IDS = sorted(name for name in gymnasium.registry if name.startswith("CarlaLoc-") and name != REPLAY)
QUICK = ("CarlaLoc-v0", "CarlaLoc-AnyTown-v0")
"""The default, and the one of another class; `test_env.py` holds all others to differ by their map alone."""
ALL_RIGS = (*RIGS, "bev", "sensors of state")


def _check(name: str, rig: str, **settings: Any) -> None:
    """`make` warns of newer versions and of what its own checker finds, `check_env` of the rest."""
    used: str | SensorRig = rig_by_name("state") if rig == "sensors of state" else rig
    if rig in RIGS and any(isinstance(sensor, CameraConfig) for sensor in rig_by_name(rig).sensors):
        need_opengl()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(name, rig=used, quality="low", **settings)
        check_env(env.unwrapped, skip_render_check=True)
        env.reset(seed=0)
        env.step(env.action_space.sample())
    env.close()


@pytest.mark.parametrize("name", QUICK)
def test_ids_of_both_classes_as_an_agent_has_them(name: str, straight_map: Path) -> None:
    """Town03, and a town drawn of one."""
    settings = {"towns": (straight_map,)} if "AnyTown" in name else {"traffic": "static"}
    _check(name, "state", **settings)


@pytest.mark.parametrize("rig", [pytest.param(r, marks=[pytest.mark.soak] * (r in SLOW)) for r in ALL_RIGS])
def test_every_rig_on_a_small_map(rig: str, straight_map: Path) -> None:
    _check("CarlaLoc-v0", rig, map=str(straight_map), traffic="dynamic,vehicles=3,walkers=0")


@pytest.mark.soak
@pytest.mark.parametrize("rig", ALL_RIGS)
@pytest.mark.parametrize("name", IDS)
def test_every_id_with_every_rig(name: str, rig: str) -> None:
    """All towns as they come; AnyTown draws among two."""
    _check(name, rig, **({"towns": ("Town01", "Town03")} if "AnyTown" in name else {}))
