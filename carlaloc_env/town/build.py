"""Building and caching towns."""

from __future__ import annotations

from pathlib import Path

from carlaloc_env.core.files.array_cache import Arrays, cached
from carlaloc_env.core.geometry.geodesy import GeoReference
from carlaloc_env.core.road.road_profile import Relief, Roughness
from carlaloc_env.scene import mesh_arrays
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.default_traffic import choose_traffic
from carlaloc_env.town.default_zones import choose_zones
from carlaloc_env.town.lanes.build_network import build_network
from carlaloc_env.town.lanes.kept_tables import kept_tables
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.opendrive.reader import read_opendrive
from carlaloc_env.town.roads.road_classes import road_levels
from carlaloc_env.town.routing.default_route import choose_route
from carlaloc_env.town.routing.route import Route, plan_route
from carlaloc_env.town.sources import identify_town
from carlaloc_env.town.town import Town
from carlaloc_env.town.town_scenery import TownScenery

KEPT_FILES = 4
"""Cached files kept of each town."""


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
    xodr = read_opendrive(town.source)
    if town.toml is None:
        smooth = build_network(xodr)
        config = choose_traffic(smooth, choose_zones(smooth, TownConfig(name=name)))
    else:
        config = TownConfig.from_toml(town.toml)
    seed = int(key[:12], 16) if config.scenery_seed is None else config.scenery_seed
    levels = road_levels(xodr.roads, config)
    network = build_network(
        xodr,
        None if levels is None else Relief(seed, levels),
        keep=kept_tables(name, module=__name__, content=key, kept_files=KEPT_FILES, folder=cache_dir),
    )
    route = _route(network, config)
    scenery = cached(
        name,
        "town",
        module=__name__,
        make=lambda: _build(network, config, route, seed),
        to_arrays=_to_arrays,
        from_arrays=_from_arrays,
        content=key,
        kept_files=KEPT_FILES,
        folder=cache_dir,
    )
    return Town(
        name=name,
        network=network,
        config=config,
        route=route,
        geo=_geo(network, config),
        chunks=scenery.chunks,
        collision_vertices_m=scenery.collision_vertices_m,
        collision_triangles=scenery.collision_triangles,
        collision_tags=scenery.collision_tags,
        lenses=scenery.lenses,
        lamps_m=scenery.lamps_m,
        roughness=None if levels is None else Roughness(seed, levels, scenery.road_events),
        content_hash=key,
    )


def _build(network: LaneNetwork, config: TownConfig, route: Route | None, seed: int) -> TownScenery:
    # Here, since what builds takes a fifth of a second to import, and a town from the cache needs none of it.
    from carlaloc_env.town.scenery import build_scenery

    route_m = None if route is None else route.position_m[:, :2]
    return build_scenery(network, config, seed, route_m)


def _to_arrays(scenery: TownScenery) -> Arrays:
    arrays: Arrays = {
        "collision_vertices_m": scenery.collision_vertices_m,
        "collision_triangles": scenery.collision_triangles,
        "road_events": scenery.road_events,
        "collision_tags": scenery.collision_tags,
        "lamps_m": scenery.lamps_m,
        "lens_signal": scenery.lenses.signal,
        "lens_state": scenery.lenses.state,
        "T_world_lens": scenery.lenses.T_world_lens,
    }
    if scenery.lenses.instance is not None:
        arrays["lens_instance"] = scenery.lenses.instance
    return arrays | mesh_arrays.to_arrays(scenery.chunks)


def _from_arrays(arrays: Arrays) -> TownScenery:
    return TownScenery(
        chunks=mesh_arrays.from_arrays(arrays),
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


def _route(network: LaneNetwork, config: TownConfig) -> Route | None:
    wanted = config.route
    if not wanted.points:
        return choose_route(network)
    route = plan_route(network, wanted.points, loop=wanted.loop, length_m=wanted.length_m, for_car=True)
    return route.starting_at(wanted.start) if wanted.start is not None else route


def _geo(network: LaneNetwork, config: TownConfig) -> GeoReference:
    """What town.toml says, else the map's own reference, else the equator at Greenwich's meridian."""
    from_map = network.xodr.geodetic_origin()
    return config.geo or from_map or GeoReference(latitude_deg=0.0, longitude_deg=0.0)
