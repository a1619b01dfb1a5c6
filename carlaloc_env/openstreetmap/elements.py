"""Elements of a file of OpenStreetMap, .osm, packed or not, and .osm.pbf, in the order of the file."""

from __future__ import annotations

import bz2
import gzip
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import MapError

Tags = Mapping[str, str]
"""Keys and values of one element."""
_BEGINNINGS = {b"\x1f\x8b": "osm.gz", b"BZh": "osm.bz2", b"OSMHeader": "osm.pbf"}
"""Bytes among a file's first ones, and its format as osmium calls it; others are bare XML."""
_OTHERS = {
    b"pk\x03\x04": "a ZIP archive; unpack it by unzip",
    b"7z\xbc\xaf": "a 7z archive; unpack it by 7z x",
    b"\xfd7zxz": "packed by xz; unpack it by unxz",
    b"\x28\xb5\x2f\xfd": "packed by Zstandard; unpack it by zstd -d",
    b"\xff\xe0\x04o5m": "an .o5m file; convert it by osmconvert to .osm.pbf",
    b"{": "JSON; ask Overpass for [out:xml], or give an .osm file",
    b"<!doctype html": "a web page; download the extract again",
    b"<html": "a web page; download the extract again",
    b"<osmchange": "a list of changes; apply it to an extract by osmium apply-changes",
    b"<opendrive": "an OpenDRIVE map; give it to --map as it is",
}
"""Beginnings of files that are no extracts, in lower case and without an XML declaration."""
LANELET2 = "a Lanelet2 map, no extract of OpenStreetMap; give an extract, or its OpenDRIVE to --map"
_DELETED = re.compile(
    rb"<(way|relation|node)\s(?=[^>]*\baction=[\"']delete[\"'])[^>]*?\bid=[\"'](-?\d+)[\"']"
)
_BLOCK_BYTES = 1 << 24


@dataclass(frozen=True, slots=True)
class Way:
    """A line or ring of nodes."""

    id: int
    nodes: tuple[int, ...]
    tags: Tags


@dataclass(frozen=True, slots=True)
class Relation:
    """Members with their kind (`n`, `w`, `r`), id and role."""

    id: int
    members: tuple[tuple[str, int, str], ...]
    tags: Tags


def read_elements(path: Path) -> Iterator[tuple[str, Any]]:
    """Nodes as (id, lon, lat, tags), ways and relations that were not deleted; names of those that were."""
    # Here, since few commands need it.
    import osmium
    from osmium import osm

    try:
        with path.open("rb") as file:
            begin = file.read(1024)
    except OSError as error:
        raise MapError(f"cannot read {path}: {error.strerror}; give an .osm or .osm.pbf file") from error
    head = re.sub(rb"^(\xef\xbb\xbf)?\s*(<\?[^>]*>\s*|<!--.*?-->\s*)*", b"", begin, flags=re.DOTALL)
    other = next((other for first, other in _OTHERS.items() if head.lower().startswith(first)), None)
    if other or b"local_x" in begin:
        raise MapError(f"{path} is {other or LANELET2}")
    kind = next((kind for sign, kind in _BEGINNINGS.items() if sign in begin[:16]), "osm")
    try:
        deleted = set() if kind == "osm.pbf" else _deleted(path, kind)
        for item in osmium.FileProcessor(osmium.io.File(str(path), kind)):
            if isinstance(item, osm.Area | osm.Changeset) or not item.visible:
                continue
            tags = dict(item.tags) if item.tags else {}
            sort = item.type_str()
            if (sort, item.id) in deleted:
                if sort != "n" and tags:
                    yield "deleted", f"{'way' if sort == 'w' else 'relation'}/{item.id}"
            elif isinstance(item, osm.Way):
                yield "way", Way(item.id, tuple(node.ref for node in item.nodes), tags)
            elif isinstance(item, osm.Relation):
                members = tuple((member.type, member.ref, member.role) for member in item.members)
                yield "relation", Relation(item.id, members, tags)
            elif item.location.valid():
                yield "node", (item.id, item.location.lon, item.location.lat, tags)
    except (ValueError, osmium.InvalidLocationError) as error:
        raise MapError(
            f"{path} has no number where one belongs: {error}; download the extract again"
        ) from error
    except (RuntimeError, OSError, EOFError, zlib.error) as error:
        raise MapError(
            f"cannot read {path}: no whole .{kind} file ({error}); download the extract again"
        ) from error


def _deleted(path: Path, kind: str) -> set[tuple[str, int]]:
    """Kinds (`n`, `w`, `r`) and ids of elements marked as deleted by an editor; osmium passes no marks on.

    Raises:
        MapError: the server that made the file gave up before its end.
    """
    openers: dict[str, Any] = {"osm.gz": gzip.open, "osm.bz2": bz2.open, "osm": open}
    names, rest = set[tuple[str, int]](), b""
    with openers[kind](path, "rb") as file:
        while block := file.read(_BLOCK_BYTES):
            text = rest + block
            names |= {(sort[:1].decode(), int(number)) for sort, number in _DELETED.findall(text)}
            rest = text[max(text.rfind(b"<"), 0) :]
            if remark := re.search(rb"<remark>([^<]*error[^<]*)", text):
                why = remark[1].decode(errors="replace").strip()
                raise MapError(f"{path} is not whole: {why}; ask for a smaller box")
    return names
