"""Header of a drive as it begins: all that rebuilds its world."""

import platform
from dataclasses import asdict
from datetime import datetime, timezone
from typing import Any

from carlaloc_env.core.files.library_versions import library_version
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.envs.task.episode_start import DrivenRoute
from carlaloc_env.timeline.actors import ActorCatalog
from recorder.episode.episode_header import EpisodeHeader

VERSIONED = ("carlaloc", "pybullet", "numpy", "scipy")
"""Distributions whose versions shape a drive."""


def drive_header(
    world: DrivingWorld, driven: DrivenRoute, catalog: ActorCatalog, *, device: str, **more: Any
) -> EpisodeHeader:
    """Header of a drive in a world that is being reset.

    Args:
        world: The living town.
        driven: The route.
        catalog: The actors.
        device: Name of the driver.
        more: Further fields of the header.
    """
    town, versions = world.town, {name: library_version(name) for name in VERSIONED}
    is_own = not driven.points_m and not driven.start and town.config.route is not None
    table_m = town.config.route.length_m if is_own and town.config.route is not None else None
    return EpisodeHeader(
        map_name=town.name,
        town_hash=town.town_hash,
        seed=world.traffic_config.seed,
        catalog=catalog,
        route={**driven.to_mapping(), "table_length_m": table_m},
        traffic=_plain(asdict(world.traffic_config)),
        device=device,
        versions={**versions, "python": platform.python_version()},
        created_utc=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        **more,
    )


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value if isinstance(value, (int, float, str, bool, list)) or value is None else str(value)
