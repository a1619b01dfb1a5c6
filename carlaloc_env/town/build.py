"""Builds towns, or reads them from the cache."""

import logging
from collections.abc import Callable
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.files.array_cache import cached
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.opendrive.records import OpenDrive
from carlaloc_env.map.roads import TownRoads, build_roads
from carlaloc_env.map.sources import TownId, identify_town
from carlaloc_env.road.road_profile import Roughness
from carlaloc_env.scene.mesh import Mesh, meshes_from_arrays, meshes_to_arrays
from carlaloc_env.scenery.mapped import read_mapped
from carlaloc_env.scenery.outline import TownOutline, TownScenery
from carlaloc_env.town.town import Town, town_hash

_log = logging.getLogger(__name__)
_PLACE = ("geoReference", "offset", "header")
"""Elements that place a map on the Earth."""
_WHOLE = ("OpenDRIVE", *_PLACE)
"""Elements that concern a whole map."""
KEPT_FILES = 10
"""Cached files kept of each town: its hash, outline, scenery, roads and traffic tables, of two versions."""


def load_town(
    name_or_path: str | Path,
    *,
    cache_dir: Path | None = None,
    progress: Callable[[str], object] = lambda _: None,
) -> Town:
    """A town by name or OpenDRIVE file, from the cache when it was built before.

    Args:
        name_or_path: Name of a folder in `maps`, or an .xodr file, beside which a `town.toml` may lie.
        cache_dir: Where finished towns are kept; `$CARLALOC_CACHE` or `~/.cache/carlaloc` when left out.
        progress: Called with the name of each step that has ended, while the town is built.

    Raises:
        MapError: The town is unknown or its map cannot be used.
        ConfigError: Its `town.toml` is not valid.
    """
    return _TownCache(identify_town(name_or_path), cache_dir, progress).town()


def kept_town_hash(town: TownId, *, cache_dir: Path | None = None) -> str | None:
    """Hash of a built town as `town_hash` makes it, if the cache holds it; nothing is built.

    Args:
        town: The town.
        cache_dir: Where finished towns are kept; `$CARLALOC_CACHE` or `~/.cache/carlaloc` when left out.

    Returns:
        The hash, or None where this code has not built the town here.
    """
    try:
        return _TownCache(town, cache_dir).kept_hash(_not_built)
    except LookupError:
        return None


def _not_built() -> str:
    raise LookupError


class _TownCache:
    """The parts of a town: each from the cache, or made anew and kept there.

    Modules that build are imported where they are needed: a town from the cache needs none of them.
    """

    def __init__(
        self, source: TownId, folder: Path | None, progress: Callable[[str], object] = lambda _: None
    ) -> None:
        self._source, self._progress = source, progress
        self._keep = partial(
            cached,
            source.name,
            module=__name__,
            content=source.source_hash,
            kept_files=KEPT_FILES,
            folder=folder,
        )

    def town(self) -> Town:
        """The town; its meshes are read at first use."""
        roads, outline, levels = self.roads, self.outline, self.roads.levels
        return Town(
            name=self._source.name,
            config=self.config,
            roads=roads,
            outline=outline,
            scenery=lambda: self.chunks,
            roughness=None if levels is None else Roughness(self.seed, levels, outline.road_events),
            town_hash=self.kept_hash(lambda: town_hash(roads, outline)),
        )

    def kept_hash(self, make: Callable[[], str]) -> str:
        """Hash of the town, from a file of its own, so that it can be read before all else."""
        return self._keep(
            "hash",
            make=make,
            to_arrays=lambda made: {"hash": np.frombuffer(made.encode(), np.uint8)},
            from_arrays=lambda arrays: arrays["hash"].tobytes().decode(),
        )

    @cached_property
    def seed(self) -> int:
        """Number from which scenery and relief are drawn."""
        chosen = self.config.scenery_seed
        return int(self._source.source_hash[:12], 16) if chosen is None else chosen

    @cached_property
    def config(self) -> TownConfig:
        """Settings of `town.toml`, or those chosen where there is none."""
        if self._source.toml is not None:
            return TownConfig.from_toml(self._source.toml)
        from carlaloc_env.map.zones import choose_config

        return choose_config(self.xodr, self._source.name)

    @cached_property
    def xodr(self) -> OpenDrive:
        """The map, read long after the town was loaded if the cache sufficed until then."""
        town = self._source
        if identify_town(town.source).source_hash != town.source_hash:
            raise MapError(f"{town.source} has changed since the town was loaded; load it again")
        return read_opendrive(town.source)

    @cached_property
    def roads(self) -> TownRoads:
        """Lanes and surfaces for traffic."""
        return self._keep(
            "lanes",
            make=self._build_roads,
            to_arrays=TownRoads.to_arrays,
            from_arrays=lambda arrays: TownRoads.from_arrays(arrays, lambda: self.xodr, self.seed),
        )

    @cached_property
    def outline(self) -> TownOutline:
        """The part of the scenery that is needed where nothing is drawn."""
        return self._keep(
            "town",
            make=self._build_outline,
            to_arrays=TownOutline.to_arrays,
            from_arrays=TownOutline.from_arrays,
        )

    @cached_property
    def chunks(self) -> tuple[Mesh, ...]:
        """Everything that is seen."""
        return self._keep(
            "scenery",
            make=lambda: self._built.chunks,
            to_arrays=meshes_to_arrays,
            from_arrays=meshes_from_arrays,
        )

    def _build_roads(self) -> TownRoads:
        # Here, since it brings all that knows kerbs, and a route from the cache is fitted already.
        from carlaloc_env.scenery.kerbs.tight_turns import fit_turns

        self._warn_of_notes()
        return build_roads(self.xodr, self.config, self.seed, fit_turns)

    def _warn_of_notes(self) -> None:
        """Log notes on the map as a whole, a line each, and the number of all others."""
        source, rest = self._source.source, 0
        for note in self.xodr.notes:
            if note.element not in _WHOLE:
                rest += 1
            elif note.element not in _PLACE or not self.config.geo:
                _log.warning("%s: %s", source, note.message)
        if rest:
            _log.warning("%s: %d places are odd; list them by: carlaloc maps check FILE", source, rest)

    def _build_outline(self) -> TownOutline:
        # The meshes are kept at once, too: else the next reader would build them again.
        _ = self.chunks
        return self._built

    @cached_property
    def _built(self) -> TownScenery:
        from carlaloc_env.scenery.construction import build_scenery

        roads = self.roads
        route_m = None if roads.route is None else roads.route.position_m[:, :2]
        features = self._source.features
        mapped = None if features is None else read_mapped(features, roads.geo)
        return build_scenery(roads.network, self.config, self.seed, route_m, mapped, self._progress)
