"""Where maps lie, and which one a name means; mistakes are reported before anything is built."""

import importlib.resources
import os
import re
from dataclasses import dataclass
from pathlib import Path

from carlaloc_env.core.errors import MapError, is_name, unknown_name
from carlaloc_env.core.files.array_cache import content_hash

NAME_LIMIT = 80
"""Longest name of a town that is called after its file; names of kept files hold more than it."""
_SUFFIX = re.compile(r"\.[^.]+(\.gz)?$")
FEATURES = "features.geojson"
"""File beside a `town.xodr` that says what stands beside its roads."""
ALIASES = {"Town10HD": "Town10"}
"""Other names of towns."""
MAP_SUFFIXES = (".xodr", ".xodrz", ".xodr.gz")
"""Suffixes of map files; the last two are packed by gzip."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TownId:
    """A town that has not been built."""

    name: str
    """Name of the town."""
    source_hash: str
    """Hash of its map, `town.toml` and features, which names its files in the cache, not the built town."""
    source: Path
    """Its OpenDRIVE file."""
    toml: Path | None
    """Its settings, if it has some."""
    features: Path | None = None
    """Things beside its roads, if they are known."""


def find_town(name: str) -> Path:
    """OpenDRIVE file of a town in `$CARLALOC_MAPS` or among the installed maps.

    Raises:
        MapError: There is no such town; the message names the nearest one.
    """
    wanted = ALIASES.get(name, name)
    towns = known_towns()
    for town, path in towns.items():
        if town.lower() == wanted.lower():
            return path
    raise MapError(unknown_name("town", name, towns))


def known_towns() -> dict[str, Path]:
    """OpenDRIVE files of all towns in `$CARLALOC_MAPS` and among the installed maps, by name."""
    towns: dict[str, Path] = {}
    for folder in _map_folders():
        for town in sorted(folder.iterdir()):
            if (town / "town.xodr").is_file():
                towns.setdefault(town.name, town / "town.xodr")
    return towns


def identify_town(name_or_path: str | Path) -> TownId:
    """A town by name or OpenDRIVE file.

    Args:
        name_or_path: Name of a folder in `maps`, or an .xodr file, beside which a `town.toml` may lie.

    Raises:
        MapError: The town is unknown or its file cannot be read.
    """
    source = _source(name_or_path)
    beside = source.with_name("town.toml")
    toml = beside if source.name == "town.xodr" and beside.is_file() else None
    mapped = source.with_name(FEATURES)
    features = mapped if source.name == "town.xodr" and mapped.is_file() else None
    try:
        parts = [source.read_bytes(), b"" if toml is None else toml.read_bytes()]
        if features is not None:
            parts.append(features.read_bytes())
    except OSError as error:
        raise MapError(f"cannot read {error.filename}: {error.strerror}; give another map") from error
    return TownId(
        name=_name_of(source),
        source_hash=content_hash(*parts),
        source=source,
        toml=toml,
        features=features,
    )


def _source(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.name.lower().endswith(MAP_SUFFIXES) or (path.suffix and path.is_file()):
        if not path.is_file():
            raise MapError(
                f"there is no file {path}; give the path of an OpenDRIVE file or the name of a town"
            )
        return path
    if path.is_dir() and (path / "town.xodr").is_file():
        return path / "town.xodr"
    return find_town(str(name_or_path))


def _name_of(source: Path) -> str:
    """A town's name by that of its folder or file: other characters become ``_``, what is too long is cut."""
    stem = source.absolute().parent.name if source.name == "town.xodr" else _SUFFIX.sub("", source.name)
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", stem)[:NAME_LIMIT]
    return name if is_name(name) else "map"


def _map_folders() -> list[Path]:
    folders = [Path(entry) for entry in os.environ.get("CARLALOC_MAPS", "").split(os.pathsep) if entry]
    folders.append(Path(str(importlib.resources.files("carlaloc_env.maps"))))
    return [folder for folder in folders if folder.is_dir()]
