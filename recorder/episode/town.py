"""The town that an episode was driven in: a known one by name, or what the user says; its hash decides."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from carlaloc_env.core.errors import EpisodeError, MapError
from carlaloc_env.core.names import is_name
from carlaloc_env.town.sources import TownId, find_town, identify_town
from recorder.episode.episode import Episode
from recorder.episode.header import WORLD_VERSION

if TYPE_CHECKING:
    from carlaloc_env.town.town import Town


def town_id_of(episode: Episode, chosen: str | Path | None = None) -> TownId:
    """Name, hash and file of an episode's town; nothing is built.

    Files come from others: an episode may name a town, but only the user may name a file.

    Args:
        episode: The drive.
        chosen: Town or OpenDRIVE file that the user gave; None: what the episode says.

    Raises:
        MapError: there is no such file.
        EpisodeError: the town is not known by a name, or its map or the world has changed since the drive.
    """
    header = episode.header
    if header.world_version != WORLD_VERSION:
        raise EpisodeError(
            f"{episode.path} was driven in world version {header.world_version}, this CarlaLoc has version "
            f"{WORLD_VERSION}, whose roads have other heights; record it again, or install the version "
            f"of CarlaLoc it was made with ({header.versions.get('carlaloc-env', 'unknown')})"
        )
    if chosen is not None:
        town = identify_town(chosen)
    elif not is_name(header.map_name):
        raise EpisodeError(f"{episode.path} was driven on a map file; give that file with --map FILE.xodr")
    else:
        try:
            town = identify_town(find_town(header.map_name))
        except MapError as error:
            raise EpisodeError(
                f"{episode.path}: {error}; if it was driven on a file, give that with --map FILE.xodr"
            ) from error
    if header.map_hash and header.map_hash != town.content_hash:
        raise EpisodeError(
            f"{episode.path} was driven in another version of {town.name} ({header.map_hash[:12]}, "
            f"now {town.content_hash[:12]}); give its map with --map, record it again, or install the "
            f"version of CarlaLoc it was made with ({header.versions.get('carlaloc-env', 'unknown')})"
        )
    return town


def town_of(episode: Episode, chosen: str | Path | None = None) -> Town:
    """The town of an episode, built or from the cache.

    Args:
        episode: The drive.
        chosen: Town or OpenDRIVE file that the user gave; None: what the episode says.

    Raises:
        MapError: there is no such file, or it cannot be used.
        EpisodeError: the town is not known by a name, or its map or the world has changed since the drive.
    """
    # Here, since what builds towns takes a second to import.
    from carlaloc_env.town.build import load_town

    return load_town(town_id_of(episode, chosen).source)
