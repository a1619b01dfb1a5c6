"""The town that an episode was driven in, known to be still the same."""

from __future__ import annotations

from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.town.build import TownId, identify_town, load_town
from carlaloc_env.town.town import Town
from recorder.episode.episode import Episode


def town_id_of(episode: Episode) -> TownId:
    """Name and hash of an episode's town; nothing is built.

    Raises:
        MapError: the town is unknown here.
        EpisodeError: its map has changed since the drive.
    """
    header = episode.header
    town = identify_town(header.map_name)
    if header.map_hash and header.map_hash != town.content_hash:
        raise EpisodeError(
            f"{episode.path} was driven in another version of {town.name} ({header.map_hash[:12]}, "
            f"now {town.content_hash[:12]}); record it again, or install the version of CarlaLoc "
            f"it was made with ({header.versions.get('carlaloc-env', 'unknown')})"
        )
    return town


def town_of(episode: Episode) -> Town:
    """The town of an episode, built or from the cache.

    Raises:
        MapError: the town is unknown here, or its map cannot be used.
        EpisodeError: its map has changed since the drive.
    """
    town_id_of(episode)
    return load_town(episode.header.map_name)
