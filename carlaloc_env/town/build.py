"""Building and caching towns."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.files.array_cache import Arrays, cached
from carlaloc_env.core.road.road_profile import Roughness
from carlaloc_env.scene import mesh_arrays
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.town import town_roads
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.opendrive.reader import read_opendrive
from carlaloc_env.town.opendrive.records import OpenDrive
from carlaloc_env.town.routing.route import Route
from carlaloc_env.town.sources import TownId, identify_town
from carlaloc_env.town.town import Town
from carlaloc_env.town.town_roads import TownRoads
from carlaloc_env.town.town_scenery import TownOutline, TownScenery

KEPT_FILES = 8
"""Cached files kept of each town: outline, scenery, roads and traffic tables, of this version and another."""


def load_town(name_or_path: str | Path, *, cache_dir: Path | None = None) -> Town:
    """A town by name or OpenDRIVE file, from the cache when it was built before.

    Args:
        name_or_path: Name of a folder in `maps`, or an .xodr file, beside which a `town.toml` may lie.
        cache_dir: Where finished towns are kept; `$CARLALOC_CACHE` or `~/.cache/carlaloc` when left out.

    Raises:
        MapError: The town is unknown or its map cannot be used.
        ConfigError: Its `town.toml` is not valid.
    """
    town = identify_town(name_or_path)
    name, key = town.name, town.content_hash
    read = cache(lambda: _read(town))
    config = _config(town, read)
    seed = int(key[:12], 16) if config.scenery_seed is None else config.scenery_seed
    keep = partial(cached, name, module=__name__, content=key, kept_files=KEPT_FILES, folder=cache_dir)
    roads: TownRoads = keep(
        "lanes",
        make=lambda: _build_roads(read(), config, seed),
        to_arrays=town_roads.to_arrays,
        from_arrays=lambda arrays: town_roads.from_arrays(arrays, read, seed),
    )
    network, levels, route = roads.network, roads.levels, roads.route
    outline, look = _kept_scenery(keep, cache(lambda: _build_scenery(network, config, route, seed)))
    return Town(
        name=name,
        network=network,
        config=config,
        route=route,
        geo=roads.geo,
        scenery=look,
        collision_vertices_m=outline.collision_vertices_m,
        collision_triangles=outline.collision_triangles,
        collision_tags=outline.collision_tags,
        lenses=outline.lenses,
        lamps_m=outline.lamps_m,
        roughness=None if levels is None else Roughness(seed, levels, outline.road_events),
        content_hash=key,
    )


def _kept_scenery(
    keep: Callable[..., Any], build: Callable[[], TownScenery]
) -> tuple[TownOutline, Callable[[], tuple[Mesh, ...]]]:
    """What of the scenery is needed where nothing is drawn, and what gives all that is seen.

    Args:
        keep: `cached` for this town.
        build: Builds the scenery, once.
    """
    look = cache(
        lambda: keep(
            "scenery",
            make=lambda: build().chunks,
            to_arrays=mesh_arrays.to_arrays,
            from_arrays=mesh_arrays.from_arrays,
        )
    )

    def make() -> TownOutline:
        # What is seen is kept at once, too: it would be built again for whoever looks next.
        look()
        return build()

    return keep("town", make=make, to_arrays=_to_arrays, from_arrays=_from_arrays), look


def _read(town: TownId) -> OpenDrive:
    """The map of a town, long after the town was loaded if what the cache holds sufficed until then."""
    if identify_town(town.source).content_hash != town.content_hash:
        raise MapError(f"{town.source} has changed since the town was loaded; load it again")
    return read_opendrive(town.source)


def _config(town: TownId, read: Callable[[], OpenDrive]) -> TownConfig:
    if town.toml is not None:
        return TownConfig.from_toml(town.toml)
    from carlaloc_env.town.road_building import choose_config

    return choose_config(read(), town.name)


def _build_roads(xodr: OpenDrive, config: TownConfig, seed: int) -> TownRoads:
    # Here as below, since what builds takes long to import, and a town from the cache needs none of it.
    from carlaloc_env.town.road_building import build_roads

    return build_roads(xodr, config, seed)


def _build_scenery(network: LaneNetwork, config: TownConfig, route: Route | None, seed: int) -> TownScenery:
    from carlaloc_env.town.scenery import build_scenery

    route_m = None if route is None else route.position_m[:, :2]
    return build_scenery(network, config, seed, route_m)


def _to_arrays(outline: TownOutline) -> Arrays:
    arrays: Arrays = {
        "collision_vertices_m": outline.collision_vertices_m,
        "collision_triangles": outline.collision_triangles,
        "road_events": outline.road_events,
        "collision_tags": outline.collision_tags,
        "lamps_m": outline.lamps_m,
        "lens_signal": outline.lenses.signal,
        "lens_state": outline.lenses.state,
        "T_world_lens": outline.lenses.T_world_lens,
    }
    if outline.lenses.instance is not None:
        arrays["lens_instance"] = outline.lenses.instance
    return arrays


def _from_arrays(arrays: Arrays) -> TownOutline:
    return TownOutline(
        collision_vertices_m=arrays["collision_vertices_m"],
        collision_triangles=arrays["collision_triangles"],
        collision_tags=arrays["collision_tags"],
        lenses=SignalLenses(
            signal=arrays["lens_signal"],
            state=arrays["lens_state"],
            T_world_lens=arrays["T_world_lens"],
            instance=arrays.get("lens_instance"),
        ),
        road_events=arrays["road_events"],
        lamps_m=arrays["lamps_m"],
    )
