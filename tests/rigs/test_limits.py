"""Sensors beyond all measure are refused by name, at once, and before memory is taken."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.rigs import memory
from carlaloc_env.rigs.memory import available_bytes, check_memory, estimated_bytes
from carlaloc_env.rigs.presets import RIGS, rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.limits import LIMITS, SENSORS_MAX
from carlaloc_env.sensors.registry import SENSOR_KINDS
from carlaloc_env.sensors.vehicle import SpeedConfig

CASES = [(kind, name) for kind, table in LIMITS.items() for name in table if name != "rays"]


def changed(config: Any, name: str, value: float) -> Any:
    """The configuration with another value, or a tuple of as many entries."""
    head, _, rest = name.partition(".")
    old = getattr(config, head)
    if rest:
        return dataclasses.replace(config, **{head: changed(old, rest, value)})
    if isinstance(old, tuple):
        return dataclasses.replace(config, **{head: tuple(k * 1e-3 for k in range(int(value)))})
    return dataclasses.replace(config, **{head: type(old)(value)})


@pytest.mark.parametrize(("kind", "name"), CASES, ids=lambda value: str(value))
def test_just_beyond_a_limit_is_refused(kind: str, name: str) -> None:
    """And the limit itself is not, unless together with others it is too much."""
    limit = LIMITS[kind][name]
    config = SENSOR_KINDS[kind]()  # type: ignore[call-arg]  # every kind has a default name
    with pytest.raises(ConfigError, match=rf"{name}.*|needs|must|thresholds"):
        changed(config, name, limit.high * 1.001 + 1)
    with pytest.raises(ConfigError, match=rf"{name} is .*; give .* to "):
        changed(config, name, limit.high * 1.001 + 1)
    if name != "columns" or kind != "lidar":
        changed(config, name, limit.high)


def test_rays_count_together() -> None:
    """Beams and columns are within their limits, their product is not."""
    beams = tuple(k * 0.1 for k in range(200))
    with pytest.raises(ConfigError, match="rays is"):
        LidarConfig(columns=36_000, elevations_deg=beams)


def test_too_many_sensors() -> None:
    SensorRig(sensors=tuple(SpeedConfig(name=f"s{k}") for k in range(SENSORS_MAX)))
    with pytest.raises(ConfigError, match=f"at most {SENSORS_MAX}"):
        SensorRig(sensors=tuple(SpeedConfig(name=f"s{k}") for k in range(SENSORS_MAX + 1)))


def test_estimate_grows_with_pixels_and_rays() -> None:
    """Twice the pixels, twice the memory; the named rigs fit into a small machine."""

    def camera(width_px: int) -> SensorRig:
        return SensorRig(sensors=(CameraConfig(pinhole=Pinhole(width_px=width_px)),))

    assert estimated_bytes(camera(2000)) == 2 * estimated_bytes(camera(1000))
    lidar = SensorRig(sensors=(LidarConfig(),))
    assert estimated_bytes(lidar) == 2078 * 32 * memory.RAY_BYTES
    assert estimated_bytes(camera(1000), weathers=6) > estimated_bytes(camera(1000))
    assert all(estimated_bytes(rig_by_name(name), weathers=6) < 6e9 for name in RIGS)


def test_too_little_memory_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The free memory of machine and container, whichever is less."""
    info = tmp_path / "meminfo"
    info.write_text("MemTotal: 8000000 kB\nMemAvailable: 1000000 kB\nSwapFree: 0 kB\n")
    monkeypatch.setattr(memory, "MEMINFO", info)
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    assert available_bytes() == 1_024_000_000
    (tmp_path / "memory.max").write_text("500000000\n")
    (tmp_path / "memory.current").write_text("400000000\n")
    assert available_bytes() == 100_000_000
    with pytest.raises(ConfigError, match=r"about \d\.\d GB .* 0\.1 GB are free"):
        check_memory(rig_by_name("paper"))
    check_memory(rig_by_name("state"))
