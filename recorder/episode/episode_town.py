"""Finds the town that an episode was driven in: by its name, or the user's choice; its hash decides."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from carlaloc_env.core.errors import EpisodeError, MapError, is_name
from carlaloc_env.map.sources import TownId, find_town, identify_town, known_towns
from recorder.episode.episode import Episode

if TYPE_CHECKING:
    from carlaloc_env.town.town import Town


def town_id_of(episode: Episode, chosen: str | Path | None = None) -> TownId:
    """Name and file of an episode's town; nothing is built, and nothing heavy is imported.

    Files come from others: an episode may name a town, but only the user may name a file.

    Args:
        episode: The drive.
        chosen: Town or OpenDRIVE file that the user gave; None: that of the episode.

    Raises:
        MapError: there is no such file.
        EpisodeError: the town is not towns by a name, or the user gave the name of another one.
    """
    name = episode.header.map_name
    if chosen is not None:
        town, towns = identify_town(chosen), known_towns()
        if town.name != name and name in towns and town.source in towns.values():
            raise EpisodeError(f"{episode.path} was driven in {name}, not in {town.name}; leave out --map")
        return town
    if not is_name(name):
        raise EpisodeError(f"{episode.path} was driven on a map file; give that file with --map FILE.xodr")
    try:
        return identify_town(find_town(name))
    except MapError as error:
        raise EpisodeError(
            f"{episode.path}: {error}; if it was driven on a file, give that with --map FILE.xodr"
        ) from error


def town_of(episode: Episode, chosen: str | Path | None = None) -> Town:
    """The town of an episode, built or from the cache.

    Args:
        episode: The drive.
        chosen: Town or OpenDRIVE file that the user gave; None: that of the episode.

    Raises:
        MapError: there is no such file, or it cannot be used.
        EpisodeError: the town is not known by a name, or it is another one than was driven in.
    """
    # Here, since what loads towns takes a second to import.
    from carlaloc_env.town.build import load_town

    source = town_id_of(episode, chosen)
    town = load_town(source.source)
    _check(episode, source, town.town_hash)
    return town


def check_kept_town(episode: Episode, town: TownId) -> None:
    """Refuse a drive whose town is another one now, if that is known without building it.

    Raises:
        EpisodeError: the cache holds the town, and it is another one than was driven in. A town that has not
            been built here is compared by `town_of`.
    """
    from carlaloc_env.town.build import kept_town_hash

    kept = kept_town_hash(town)
    if kept is not None:
        _check(episode, town, kept)


def _check(episode: Episode, town: TownId, town_hash: str) -> None:
    """Refuse a drive whose path may no longer lie on the roads.

    Raises:
        EpisodeError: the town is another one than was driven in.
    """
    header = episode.header
    if header.town_hash and header.town_hash != town_hash:
        where = town.name if town.source.name == "town.xodr" else str(town.source)
        anew = ["record", "--map", where, "--device", header.device or "scripted", "--seed", str(header.seed)]
        raise EpisodeError(
            f"{episode.path} was driven in another version of {town.name} ({header.town_hash[:12]}, now "
            f"{town_hash[:12]}); give its map with --map, or record it anew: carlaloc {shlex.join(anew)} "
            "--out NEW.mcap"
        )
