"""Header of an episode: all that a replay needs beside the motion itself."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from carlaloc_env.core.ego import DEFAULT_RIDE
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.timeline.actors import ActorCatalog, empty_catalog

HEADER_RECORD = "carlaloc_episode"
"""Name of the MCAP metadata record that holds the header."""
FORMAT_VERSION, CARS_VERSION = 3, 4
"""Versions of the episode format: drives of one car, of several. 2: actors in fixed point. 3: they lean."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EpisodeHeader:
    """Configuration of a drive; everything but the catalogue consists of JSON values."""

    map_name: str
    """Name of the town; never a path, which only a user may give."""
    town_hash: str = ""
    """Hash of the town as it was built, so that a replay refuses another one; empty: not known."""
    seed: int = 0
    """Seed of traffic and noise."""
    catalog: ActorCatalog = field(default_factory=empty_catalog)
    """The actors of the drive."""
    route: Mapping[str, Any] = field(default_factory=dict)
    """The route driven, as of `DrivenRoute.to_mapping`; without points, the town's own."""
    task: Mapping[str, float] = field(default_factory=dict)
    """Settings of the task that an agent was judged by; empty: its defaults."""
    action: str = ""
    """Kind of the actions of an agent; empty: the device gave controls."""
    rig: Mapping[str, Any] | str = ""
    """Rig of the recording: its name or its whole configuration."""
    traffic: Mapping[str, Any] = field(default_factory=dict)
    """Configuration of the traffic."""
    weather: Mapping[str, Any] | str = ""
    """Weather of the recording; a replay may choose another."""
    device: str = ""
    """Input device that drove."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of CarlaLoc, Python and the libraries that shape the physics."""
    created_utc: str = ""
    """When the recording began, ISO 8601."""
    cars: tuple[Mapping[str, Any], ...] = ()
    """Where several cars are driven, of each: its ``id`` as an actor, its ``device`` and its ``route``."""
    history: tuple[str, ...] = ()
    """How the file came about from others, oldest first."""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Further configuration."""

    @property
    def ride(self) -> str:
        """Answer of the body to the road, one of `physics.params.RIDES`."""
        return str(self.extra.get("ride", DEFAULT_RIDE))

    def to_metadata(self) -> dict[str, str]:
        """One JSON text per field."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "catalog"}
        values["catalog"] = {
            "id": self.catalog.id.tolist(),
            "model": list(self.catalog.model),
            "tag": self.catalog.tag.tolist(),
            "size_m": self.catalog.size_m.tolist(),
            "tint": self.catalog.tint.tolist(),
        }
        values["format_version"] = CARS_VERSION if self.cars else FORMAT_VERSION
        if not self.cars:
            del values["cars"]
        texts = {name: json.dumps(value, ensure_ascii=False) for name, value in values.items()}
        return {**texts, "crc32": str(_checksum(texts))}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> EpisodeHeader:
        """Header of a metadata record; fields of later versions are left out.

        Raises:
            EpisodeError: the record is of another format or damaged.
        """
        try:
            if int(metadata["crc32"]) != _checksum(metadata):
                raise ValueError("checksum differs")
            values = {name: json.loads(text) for name, text in metadata.items()}
            version = int(values["format_version"])
            if version not in (FORMAT_VERSION, CARS_VERSION):
                raise EpisodeError(
                    f"the episode has format {version}, this CarlaLoc reads {FORMAT_VERSION}; "
                    f"use {'a newer' if version > FORMAT_VERSION else 'an older'} one"
                )
            catalog = values["catalog"]
            count = len(catalog["id"])
            values["catalog"] = ActorCatalog(
                id=np.array(catalog["id"], dtype=np.uint32),
                model=tuple(catalog["model"]),
                tag=np.array(catalog["tag"], dtype=np.uint8),
                size_m=np.array(catalog["size_m"], dtype=np.float32).reshape(count, 3),
                tint=np.array(catalog["tint"], dtype=np.uint8).reshape(count, 3),
            )
            values["history"], values["cars"] = (
                tuple(values.get("history", ())),
                tuple(values.get("cars", ())),
            )
            # Older headers have a hash of the map's file, which is no town's: they are refused by name.
            values.setdefault("town_hash", values.get("map_hash", ""))
            names = {f.name for f in fields(cls)}
            return cls(**{name: value for name, value in values.items() if name in names})
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise EpisodeError(f"the episode's header is damaged ({error})") from error


def _checksum(texts: Mapping[str, str]) -> int:
    # MCAP protects chunks by a checksum, but not metadata.
    parts = (f"{name}={text}" for name, text in sorted(texts.items()) if name != "crc32")
    return zlib.crc32("\n".join(parts).encode())
