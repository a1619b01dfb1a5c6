"""Gymnasium's own checks, warnings fatal, for every registered id with every rig that it takes."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env
from shared_fixtures.worlds.render_scenes import need_opengl

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.rigs.presets import RIGS, rig_by_name
from carlaloc_env.sensors.camera.config import CameraConfig

SLOW = ("paper", "real", "flu")
"""Rigs whose pictures take ten seconds and more here."""
IDS = sorted(name for name in gymnasium.registry if name.startswith("CarlaLoc-"))


def _rigs(name: str) -> tuple[str, ...]:
    """Rigs that an id takes."""
    of_agents = gymnasium.spec(name).entry_point != "carlaloc_env.env:CarlaLocEnv"
    return (*RIGS, "bev") if of_agents else tuple(RIGS)


def _check(name: str, rig: str, **settings: Any) -> None:
    if rig != "bev" and any(isinstance(sensor, CameraConfig) for sensor in rig_by_name(rig).sensors):
        need_opengl()
    env = gymnasium.make(name, rig=rig, quality="low", disable_env_checker=True, **settings).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    env.close()


@pytest.mark.parametrize(
    ("name", "rig"),
    [
        pytest.param(name, rig, marks=[pytest.mark.soak] if rig in SLOW else [])
        for name in ("CarlaLoc-v0", "CarlaLoc-v1")
        for rig in _rigs(name)
    ],
)
def test_every_rig_on_a_small_map(name: str, rig: str, straight_map: Path) -> None:
    _check(name, rig, map=str(straight_map), traffic="dynamic,vehicles=3,walkers=0")


@pytest.mark.soak
@pytest.mark.parametrize(("name", "rig"), [(name, rig) for name in IDS for rig in _rigs(name)])
def test_every_id_with_every_rig(name: str, rig: str) -> None:
    """All towns as they come; AnyTown draws among two, since every reset would build another one."""
    _check(name, rig, **({"towns": ("Town01", "Town03")} if "AnyTown" in name else {}))
