"""Adds definitions of standard messages to readers of ROS 2 bags, which lack them until Humble."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.typesys import Stores, get_typestore

from recorder.bags.files import metadata_of

_LOG = logging.getLogger(__name__)
LIKELIEST = "humble"
"""Distribution that is taken where a bag names none: the last one whose bags carry no definitions."""
_OF_VERSION = {
    1: "dashing", 2: "eloquent", 3: "foxy", 4: "foxy", 5: "humble", 6: "iron", 7: "iron", 8: "jazzy",
    9: "jazzy",
}  # fmt: skip
"""First distribution with a version of rosbag2's metadata (bag_metadata.hpp) or a later one."""


def add_definitions(reader: AnyReader, path: Path, bag: Path) -> None:
    """Let a reader of ROS 2, by its first file, know standard messages that the bag does not define."""
    bare = {c.msgtype for c in reader.connections if c.msgdef.format == MessageDefinitionFormat.NONE}
    if not bare - reader.typestore.fielddefs.keys():
        return
    name = _distribution(path)
    store, own = get_typestore(Stores[f"ROS2_{(name or LIKELIEST).upper()}"]), reader.typestore
    if not bare & store.fielddefs.keys():
        return
    if name is None:
        _LOG.warning(
            "%s names no ROS distribution and defines no messages: read with those of %s", bag, LIKELIEST
        )
    for kind in store.fielddefs.keys() - own.fielddefs.keys():
        own.fielddefs[kind], own.types[kind] = store.fielddefs[kind], store.types[kind]


def _distribution(path: Path) -> str | None:
    """Distribution that a bag names, or that wrote its version of the metadata; None: it shows neither."""
    described = metadata_of(path)
    if not path.is_dir():
        inside = (_of_mcap if path.suffix == ".mcap" else _of_sqlite)(path)
        described = {**inside, **{name: value for name, value in described.items() if value}}
    named = str(described.get("ros_distro")).lower()
    if f"ROS2_{named.upper()}" in Stores.__members__:
        return named
    version = described.get("version")
    return _OF_VERSION.get(version) if isinstance(version, int) else None


def _of_mcap(path: Path) -> Mapping[str, Any]:
    """Metadata that rosbag2 wrote into an MCAP file."""
    try:
        with path.open("rb") as file:
            for record in make_reader(file).iter_metadata():
                if record.name == "rosbag2":
                    described = yaml.safe_load(record.metadata.get("serialized_metadata", "")) or {}
                    distribution = record.metadata.get("ROS_DISTRO", described.get("ros_distro"))
                    return {**described, "ros_distro": distribution}
    except (McapError, yaml.YAMLError, AttributeError, TypeError):
        pass
    return {}


def _of_sqlite(path: Path) -> Mapping[str, Any]:
    """Distribution in the table ``schema``, new in Humble; before, topics distinguish Foxy from Eloquent."""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)) as base:
            columns = {row[1] for row in base.execute("PRAGMA table_info(schema)")}
            if "ros_distro" in columns:
                row = base.execute("SELECT ros_distro FROM schema").fetchone()
                return {"ros_distro": row[0]} if row else {}
            if columns:
                return {}
            topics = {row[1] for row in base.execute("PRAGMA table_info(topics)")}
            return {"version": 4 if "offered_qos_profiles" in topics else 2}
    except sqlite3.Error:
        return {}
