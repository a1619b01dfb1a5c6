"""Finding, building and caching towns."""

from __future__ import annotations

import importlib.resources
import os
from dataclasses import dataclass
from pathlib import Path

from carlaloc_env.core.array_cache import Arrays, cached, content_hash
from carlaloc_env.core.errors import MapError, unknown_name
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.scene import mesh_arrays
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.default_traffic import choose_traffic
from carlaloc_env.town.default_zones import choose_zones
from carlaloc_env.town.lanes.build_network import build_network
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.routing.default_route import choose_route
from carlaloc_env.town.routing.route import Route, plan_route
from carlaloc_env.town.scenery import Scenery, build_scenery
from carlaloc_env.town.town import Town

BUILDER_VERSION = 1
"""Raised whenever the same map gives another town, so that cached towns are built again."""
KEPT_FILES = 4
"""Cached files kept of each town."""
ALIASES = {"Town10HD": "Town10"}
"""Other names of towns."""


def find_town(name: str) -> Path:
    """OpenDRIVE file of a town in `$CARLALOC_MAPS` or among the installed maps.

    Raises:
        MapError: There is no such town; the message names the nearest one.
    """
    wanted = ALIASES.get(name, name)
    known = known_towns()
    for town, path in known.items():
        if town.lower() == wanted.lower():
            return path
    raise MapError(unknown_name("town", name, known))


def known_towns() -> dict[str, Path]:
    """OpenDRIVE files of all towns in `$CARLALOC_MAPS` and among the installed maps, by name."""
    found: dict[str, Path] = {}
    for folder in _map_folders():
        for town in sorted(folder.iterdir()):
            if (town / "town.xodr").is_file():
                found.setdefault(town.name, town / "town.xodr")
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class TownId:
    """Which town it is, known without building it."""

    name: str
    """Name of its folder in `maps`, or of its file."""
    content_hash: str
    """Hash of the map, its `town.toml` and the version of the builder, 32 hexadecimal digits."""


def identify_town(name_or_path: str | Path) -> TownId:
    """Name and hash of a town; nothing is built, only its files are read.

    Raises:
        MapError: The town is unknown.
    """
    return _identify(_source(name_or_path))


def load_town(name_or_path: str | Path, *, cache_dir: Path | None = None) -> Town:
    """A town by name or OpenDRIVE file, from the cache when it was built before.

    Args:
        name_or_path: Name of a folder in `maps`, or an .xodr file, beside which a `town.toml` may lie.
        cache_dir: Where finished towns are kept; `$CARLALOC_CACHE` or `~/.cache/carlaloc` when left out.

    Raises:
        MapError: The town is unknown or its map cannot be used.
        ConfigError: Its `town.toml` is not valid.
    """
    source = _source(name_or_path)
    toml, town = _toml(source), _identify(source)
    name, key = town.name, town.content_hash
    config = TownConfig.from_toml(toml) if toml is not None else TownConfig(name=name)
    network = build_network(source)
    if toml is None:
        config = choose_traffic(network, choose_zones(network, config))
    route = _route(network, config)
    scenery = cached(
        name,
        "town",
        module=__name__,
        make=lambda: _build(network, config, route, key),
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
        lenses=scenery.lenses,
        lamps_m=scenery.lamps_m,
        content_hash=key,
    )


def _source(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.suffix == ".xodr":
        if not path.is_file():
            raise MapError(
                f"there is no file {path}; give the path of an OpenDRIVE file or the name of a town"
            )
        return path
    if path.is_dir() and (path / "town.xodr").is_file():
        return path / "town.xodr"
    return find_town(str(name_or_path))


def _toml(source: Path) -> Path | None:
    """The `town.toml` beside an OpenDRIVE file."""
    toml = source.with_name("town.toml")
    return toml if source.name == "town.xodr" and toml.is_file() else None


def _identify(source: Path) -> TownId:
    toml = _toml(source)
    key = content_hash(
        str(BUILDER_VERSION).encode(), source.read_bytes(), toml.read_bytes() if toml is not None else b""
    )
    name = source.parent.name if source.name == "town.xodr" else source.stem
    return TownId(name=name, content_hash=key)


def _map_folders() -> list[Path]:
    folders = [Path(entry) for entry in os.environ.get("CARLALOC_MAPS", "").split(os.pathsep) if entry]
    folders.append(Path(str(importlib.resources.files("carlaloc_env.maps"))))
    return [folder for folder in folders if folder.is_dir()]


def _build(network: LaneNetwork, config: TownConfig, route: Route | None, key: str) -> Scenery:
    route_m = None if route is None else route.position_m[:, :2]
    seed = int(key[:12], 16) if config.scenery_seed is None else config.scenery_seed
    return build_scenery(network, config, seed, route_m)


def _to_arrays(scenery: Scenery) -> Arrays:
    arrays: Arrays = {
        "collision_vertices_m": scenery.collision_vertices_m,
        "collision_triangles": scenery.collision_triangles,
        "lamps_m": scenery.lamps_m,
        "lens_signal": scenery.lenses.signal,
        "lens_state": scenery.lenses.state,
        "T_world_lens": scenery.lenses.T_world_lens,
    }
    if scenery.lenses.instance is not None:
        arrays["lens_instance"] = scenery.lenses.instance
    return arrays | mesh_arrays.to_arrays(scenery.chunks)


def _from_arrays(arrays: Arrays) -> Scenery:
    return Scenery(
        chunks=mesh_arrays.from_arrays(arrays),
        collision_vertices_m=arrays["collision_vertices_m"],
        collision_triangles=arrays["collision_triangles"],
        lenses=SignalLenses(
            signal=arrays["lens_signal"],
            state=arrays["lens_state"],
            T_world_lens=arrays["T_world_lens"],
            instance=arrays.get("lens_instance"),
        ),
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
