"""Header of a drive as it begins: all that rebuilds its world."""

import platform
from collections.abc import Sequence
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
    world: DrivingWorld,
    routes: Sequence[DrivenRoute],
    catalog: ActorCatalog,
    *,
    devices: Sequence[str],
    **more: Any,
) -> EpisodeHeader:
    """Header of a drive in a world that is being reset.

    Args:
        world: The living town.
        routes: The route of each car.
        catalog: The traffic.
        devices: Name of the driver of each car.
        more: Further fields of the header.
    """
    driven, device = routes[0], devices[0]
    cars = [
        {"id": car.body.actor_id, "device": name, "route": route.to_mapping()}
        for car, name, route in zip(world.cars, devices, routes, strict=True)
    ]
    town, versions = world.town, {name: library_version(name) for name in VERSIONED}
    is_own = not driven.points_m and not driven.start and driven.end is None and town.config.route is not None
    table_m = town.config.route.length_m if is_own and town.config.route is not None else None
    return EpisodeHeader(
        map_name=town.name,
        town_hash=town.town_hash,
        seed=world.traffic_config.seed,
        catalog=catalog,
        route={**driven.to_mapping(), "table_length_m": table_m},
        traffic=_plain(asdict(world.traffic_config)),
        device=device,
        cars=tuple(cars) if len(cars) > 1 else (),
        versions={**versions, "python": platform.python_version()},
        created_utc=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        **more,
    )


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value if isinstance(value, (int, float, str, bool, list)) or value is None else str(value)
