"""Record a drive: a device drives the ego through a living town, every tick goes to the episode."""

from __future__ import annotations

import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.clock import TICK_HZ
from carlaloc_env.controls import Controls
from carlaloc_env.driving import DrivingWorld
from carlaloc_env.errors import ConfigError
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoState
from carlaloc_env.timeline import ActorCatalog, ActorFrame
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.world import traffic_of_town
from recorder.devices.base import Device
from recorder.devices.registry import open_device
from recorder.episode import EgoRow, EpisodeHeader, EpisodeWriter

Progress = Callable[[float, float], None]
"""Called with seconds driven and metres along the route."""

VERSIONED = ("carlaloc-env", "pybullet", "numpy", "scipy")
"""Distributions whose versions shape a drive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordConfig:
    """What to drive, how long, and where to."""

    map: str = "Town03"
    """Town, or path of an OpenDRIVE file."""
    out: Path = Path("drive.mcap")
    """Episode to write."""
    device: str = "scripted"
    """Input device."""
    duration_s: float | None = None
    """Length of the drive [s]; None: until the route has been driven once."""
    seed: int = 0
    """Seed of the traffic and of the scripted driver."""
    traffic: str = "dynamic"
    """Share of the town's traffic: ``static``, ``dynamic`` or a fraction."""
    overwrite: bool = False
    """Whether an older episode of this name is replaced."""

    def __post_init__(self) -> None:
        if self.duration_s is not None and not 0.0 < self.duration_s <= 86400.0:
            raise ConfigError(f"duration {self.duration_s:g} s; give more than 0 and at most 86400 s")


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordResult:
    """What was recorded."""

    path: Path
    """The episode."""
    duration_s: float
    """Length of the drive [s]."""
    length_m: float
    """Distance along the route [m]."""
    collisions: int
    """Number of collisions."""


class _EpisodeListener:
    """Writes all that happens in a driving world to an episode."""

    def __init__(self, begin: Callable[[ActorCatalog], EpisodeWriter]) -> None:
        self._begin = begin
        self._touching: set[str] = set()
        self._seen: set[str] = set()
        self.collisions = 0

    def on_start(self, catalog: ActorCatalog) -> None:
        self.writer = self._begin(catalog)

    def on_tick(self, tick: int, state: EgoState, controls: Controls) -> None:
        self._touching, self._seen = self._seen, set()
        self.writer.ego(
            tick,
            EgoRow(
                position_m=state.position_m,
                quat_xyzw=state.quat_xyzw,
                velocity_world_mps=state.velocity_world_mps,
                omega_body_radps=state.omega_body_radps,
                controls=controls,
                road_wheel_rad=state.road_wheel_rad,
                speed_mps=state.speed_mps,
            ),
        )

    def on_step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        self.writer.step(step, frame, signals)

    def on_contact(self, tick: int, contact: Contact) -> None:
        what = str(contact.actor_id) if contact.actor_id is not None else "static"
        self._seen.add(what)
        if what not in self._touching:
            self.collisions += 1
            self.writer.event(tick, "collision", {"with": what, "impulse_ns": contact.impulse_ns})


def record(
    config: RecordConfig, *, device: Device | None = None, progress: Progress | None = None
) -> RecordResult:
    """Drive and record until the duration or the route is over.

    Args:
        config: What to drive.
        device: Who drives; opened by its name when left out.
        progress: Told four times a second how far the drive is.

    Raises:
        ConfigError: unknown town, device or traffic level.
        EpisodeError: the episode exists already or cannot be written.
    """
    town = load_town(config.map)
    traffic = traffic_of_town(town, config.traffic, config.seed)
    driver = device or open_device(config.device, config.seed)
    world = DrivingWorld(town, traffic)
    try:
        return _drive(config, town, world, driver, progress)
    finally:
        driver.close()
        world.close()


def _drive(
    config: RecordConfig, town: Town, world: DrivingWorld, driver: Device, progress: Progress | None
) -> RecordResult:
    def begin(catalog: ActorCatalog) -> EpisodeWriter:
        return EpisodeWriter(
            config.out, _header(config, town, world, driver, catalog), overwrite=config.overwrite
        )

    listener = _EpisodeListener(begin)
    world.reset(config.seed, listener)
    with listener.writer as writer:
        end_tick = round((config.duration_s or 86400.0) * TICK_HZ)
        while world.tick_count < end_tick:
            world.tick(driver.read(world.driver_view()))
            if progress is not None and world.tick_count % 50 == 0:
                progress(world.tick_count / TICK_HZ, world.route_s_m)
            if config.duration_s is None and _arrived(world):
                break
        writer.event(world.tick_count, "end", {"route_m": world.route_s_m})
    return RecordResult(
        path=config.out,
        duration_s=world.tick_count / TICK_HZ,
        length_m=world.route_s_m,
        collisions=listener.collisions,
    )


def _arrived(world: DrivingWorld) -> bool:
    finish_m = world.route.length_m
    if world.route.closed:
        return world.route_s_m >= finish_m
    return world.route_s_m >= finish_m - 8.0 and world.state.speed_mps < 0.05


def _header(
    config: RecordConfig, town: Town, world: DrivingWorld, driver: Device, catalog: ActorCatalog
) -> EpisodeHeader:
    versions = {name: version(name) for name in VERSIONED}
    return EpisodeHeader(
        map_name=config.map,
        map_hash=town.content_hash,
        seed=config.seed,
        catalog=catalog,
        route={"length_m": world.route.length_m, "closed": world.route.closed},
        traffic=_plain(asdict(world.traffic_config)),
        device=driver.name,
        versions={**versions, "python": platform.python_version()},
        created_utc=datetime.now(timezone.utc).isoformat(timespec="seconds"),
    )


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value if isinstance(value, (int, float, str, bool, list)) or value is None else str(value)
