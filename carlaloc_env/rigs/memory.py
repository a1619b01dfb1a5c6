"""Memory that a rig takes, estimated before any of it is taken, and memory that is free."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.rigs.rig import SensorRig

PIXEL_BYTES = {"low": 200, "medium": 200, "high": 500}
"""Memory of a camera's pixel: G-buffer, light and images [bytes]; 60 and 137 were measured in the peak of the
process, in which freed memory of building the scene hides some."""
EVENT_PIXEL_BYTES = 300
"""Memory of an event camera's pixel besides [bytes]."""
RAY_BYTES = 300
"""Memory of a ray: its ends, what it met, its point [bytes]; 260 were measured."""
SAMPLE_PIXEL_BYTES = 16
"""Memory of a pixel in the samples of each further weather [bytes]."""
RAYS_PER_WIDE_BEAM = 5
"""Rays of a beam that diverges."""
MEMINFO, CGROUP = Path("/proc/meminfo"), Path("/sys/fs/cgroup")


def estimated_bytes(rig: SensorRig, *, quality: str = "medium", weathers: int = 1) -> int:
    """Memory that the sensors of a rig take beside the town [bytes], on the safe side.

    Args:
        rig: The sensors.
        quality: Render quality.
        weathers: Weathers that are measured together.
    """
    return sum(_sensor_bytes(config, quality, weathers) for config in rig.sensors)


def check_memory(rig: SensorRig, *, quality: str = "medium", weathers: int = 1, processes: int = 1) -> None:
    """Refuse a rig for which this machine has too little memory.

    Args:
        rig: The sensors.
        quality: Render quality.
        weathers: Weathers that are measured together.
        processes: Processes that each hold the rig.

    Raises:
        ConfigError: it would not fit; the message has both sizes.
    """
    needed = processes * estimated_bytes(rig, quality=quality, weathers=weathers)
    free = available_bytes()
    if free is not None and needed > free:
        each = f" in {processes} processes" if processes > 1 else ""
        raise ConfigError(
            f"rig '{rig.name}' needs about {needed / 1e9:.1f} GB of memory{each}, and {free / 1e9:.1f} GB "
            "are free; take smaller or fewer sensors, or fewer --workers"
        )


def available_bytes() -> int | None:
    """Memory that may still be taken here [bytes], also inside a container; None where it is not known."""
    free_bytes = [size for size in (_free_of_machine(), _free_of_container()) if size is not None]
    return min(free_bytes, default=None)


def _sensor_bytes(config: Any, quality: str, weathers: int) -> int:
    if config.kind == "camera":
        pixel = PIXEL_BYTES[quality] + SAMPLE_PIXEL_BYTES * weathers
        pixel += EVENT_PIXEL_BYTES * weathers if "events" in config.outputs else 0
        return int(config.pinhole.width_px * config.pinhole.height_px * pixel)
    if config.kind == "lidar":
        rays = RAYS_PER_WIDE_BEAM if config.divergence_mrad > 0 else 2 if config.receiver else 1
        return int(config.rays * RAY_BYTES * rays)
    if config.kind == "radar":
        return int(config.columns * config.rows * RAY_BYTES)
    return 0


def _free_of_machine() -> int | None:
    try:
        lines = MEMINFO.read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    kibibytes = {line.partition(":")[0]: int(line.split()[1]) for line in lines if len(line.split()) > 1}
    if "MemAvailable" not in kibibytes:
        return None
    return 1024 * (kibibytes["MemAvailable"] + kibibytes.get("SwapFree", 0))


def _free_of_container() -> int | None:
    try:
        most = (CGROUP / "memory.max").read_text(encoding="ascii").strip()
        taken = (CGROUP / "memory.current").read_text(encoding="ascii").strip()
        return None if most == "max" else max(int(most) - int(taken), 0)
    except (OSError, ValueError):
        return None
