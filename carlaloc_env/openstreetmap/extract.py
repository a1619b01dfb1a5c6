"""Extracts of OpenStreetMap: .osm, packed or not, and .osm.pbf, read and cut to a box."""

from __future__ import annotations

import bz2
import gzip
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.geodesy import GeoReference

Box = tuple[float, float, float, float]
"""West, south, east, north [deg]."""
Tags = Mapping[str, str]
"""Keys and values of one element."""
NODE_LIMIT = 3_000_000
"""Extracts with more nodes inside the box are refused."""
WIDEST_DEG = 0.5
"""Widest side of a box that is read [deg]."""
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
_LANELET2 = "a Lanelet2 map, no extract of OpenStreetMap; give an extract, or its OpenDRIVE to --map"
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


@dataclass(slots=True)
class Extract:
    """The part of a file that lies in the box; nodes outside it are unknown."""

    source: str
    degrees: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Longitude and latitude of every node [deg]."""
    node_tags: dict[int, Tags] = field(default_factory=dict)
    ways: dict[int, Way] = field(default_factory=dict)
    relations: list[Relation] = field(default_factory=list)
    broken: list[int] = field(default_factory=list)
    """Ways with fewer than two known nodes."""
    deleted: list[str] = field(default_factory=list)
    """Ways and relations that an editor has marked as deleted."""
    geo: GeoReference = field(default_factory=lambda: GeoReference(latitude_deg=0.0, longitude_deg=0.0))
    """The origin of the world, in the middle of the nodes."""
    xy_m: dict[int, tuple[float, float]] = field(default_factory=dict)
    """World x and y of every node [m]: east and north of the origin."""

    def line(self, nodes: tuple[int, ...] | list[int]) -> Array:
        """World points (N, 2) of nodes [m]."""
        return np.array([self.xy_m[node] for node in nodes])


def read_extract(path: Path, box: Box | None = None) -> Extract:
    """Read a file, cut it to a box, and place its nodes on the plane that touches the Earth in the middle.

    Args:
        path: An .osm, .osm.gz, .osm.bz2 or .osm.pbf file.
        box: West, south, east, north [deg]; None: the whole file.

    Raises:
        MapError: The file cannot be read, ends early, holds too much, or has no node in the box.
    """
    if box is not None:
        west, south, east, north = box
        if not (-180 <= west < east <= 180 and -85 <= south < north <= 85):
            raise MapError(f"the box {west:g},{south:g},{east:g},{north:g} is none; give W,S,E,N in degrees")
    extract = Extract(str(path))
    kept: dict[int, tuple[float, float]] = {}
    for kind, item in _elements(path):
        if kind == "node":
            number, lon, lat, tags = item
            kept[number] = (lon, lat)
            if tags:
                extract.node_tags[number] = tags
            if len(kept) > 10 * NODE_LIMIT:
                break
        elif kind == "way":
            extract.ways[item.id] = item
        elif kind == "deleted":
            extract.deleted.append(item)
        else:
            extract.relations.append(item)
    lanelets = any(relation.tags.get("type") == "lanelet" for relation in extract.relations)
    if lanelets and not any("highway" in way.tags for way in extract.ways.values()):
        raise MapError(f"{path} is {_LANELET2}")
    _cut(extract, kept, box)
    if not extract.degrees:
        raise MapError(_elsewhere(path, kept, box))
    span = float(np.ptp(_street_places(extract), axis=0).max())
    if len(extract.degrees) > NODE_LIMIT or span > WIDEST_DEG:
        raise MapError(
            f"{path} has {len(extract.degrees):,} nodes over {span:.2f}°; cut it by --bbox W,S,E,N to 2 km"
        )
    place(extract)
    return extract


def _elements(path: Path) -> Iterator[tuple[str, Any]]:
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
    for first, other in _OTHERS.items():
        if head.lower().startswith(first):
            raise MapError(f"{path} is {other}")
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
            f"{path} is {_LANELET2}"
            if b"local_x" in begin
            else f"{path} has no number where one belongs: {error}; download the extract again"
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
    names: set[tuple[str, int]] = set()
    rest = b""
    with openers[kind](path, "rb") as file:
        while block := file.read(_BLOCK_BYTES):
            text = rest + block
            names |= {(sort[:1].decode(), int(number)) for sort, number in _DELETED.findall(text)}
            rest = text[max(text.rfind(b"<"), 0) :]
            remark = re.search(rb"<remark>([^<]*error[^<]*)", text)
            if remark:
                why = remark[1].decode(errors="replace").strip()
                raise MapError(f"{path} is not whole: {why}; ask for a smaller box")
    return names


def _cut(extract: Extract, kept: dict[int, tuple[float, float]], box: Box | None) -> None:
    """Keep what lies in the box: streets end where they cross it, all else stays whole."""
    # Editors number new elements by -1, -2, …
    fresh = min([0, *kept, *extract.ways]) - 1
    for way in list(extract.ways.values()):
        nodes_inside = [node for node in way.nodes if node in kept]
        if len(nodes_inside) < 2:
            extract.broken.append(way.id)
            del extract.ways[way.id]
            continue
        if "highway" not in way.tags:
            if _meets([kept[node] for node in nodes_inside], box):
                extract.ways[way.id] = Way(way.id, tuple(nodes_inside), way.tags)
                extract.degrees |= {node: kept[node] for node in nodes_inside}
            else:
                del extract.ways[way.id]
            continue
        runs = []
        for run in _runs(way.nodes, kept, box):
            nodes: list[int] = []
            for node in run:
                if isinstance(node, tuple):
                    extract.degrees[fresh] = node
                    node, fresh = fresh, fresh - 1
                nodes.append(node)
            runs.append(tuple(nodes))
        del extract.ways[way.id]
        for k, whole in enumerate(runs):
            key = way.id if k == 0 else fresh
            fresh -= k > 0
            extract.ways[key] = Way(way.id, whole, way.tags)
    extract.degrees |= {node: place for node, place in kept.items() if _inside(place, box)}
    extract.node_tags = {node: tags for node, tags in extract.node_tags.items() if node in extract.degrees}


def _runs(nodes: tuple[int, ...], kept: dict[int, tuple[float, float]], box: Box | None) -> list[list[Any]]:
    """Stretches inside the box: node ids, and places where the street crosses the box."""
    runs: list[list[Any]] = [[]]
    before: int | None = None
    for node in nodes:
        if node not in kept:
            runs.append([])
            before = None
            continue
        inside = _inside(kept[node], box)
        if inside and not runs[-1] and before is not None:
            runs[-1].append(_crossing(kept[node], kept[before], box))
        if inside:
            runs[-1].append(node)
        elif runs[-1]:
            assert before is not None
            runs[-1].append(_crossing(kept[before], kept[node], box))
            runs.append([])
        before = node
    return [run for run in runs if len(run) > 1]


def _meets(places: list[tuple[float, float]], box: Box | None) -> bool:
    """Whether the rectangle round some places meets the box."""
    if box is None:
        return True
    xs, ys = [p[0] for p in places], [p[1] for p in places]
    return min(xs) <= box[2] and max(xs) >= box[0] and min(ys) <= box[3] and max(ys) >= box[1]


def _inside(place: tuple[float, float], box: Box | None) -> bool:
    return box is None or (box[0] <= place[0] <= box[2] and box[1] <= place[1] <= box[3])


def _crossing(inner: tuple[float, float], outer: tuple[float, float], box: Box | None) -> tuple[float, float]:
    """Where the line from a place inside to one outside crosses the box."""
    assert box is not None
    share = 1.0
    for k in (0, 1):
        for limit in (box[k], box[k + 2]):
            if (outer[k] - limit) * (inner[k] - limit) < 0.0:
                share = min(share, (limit - inner[k]) / (outer[k] - inner[k]))
    return (
        round(inner[0] + share * (outer[0] - inner[0]), 8),
        round(inner[1] + share * (outer[1] - inner[1]), 8),
    )


def _street_places(extract: Extract) -> Array:
    """Longitudes and latitudes (N, 2) of the streets' nodes, or of all where there are none."""
    nodes = {node for way in extract.ways.values() if "highway" in way.tags for node in way.nodes}
    return np.array([extract.degrees[node] for node in sorted(nodes) or sorted(extract.degrees)])


def _elsewhere(path: Path, kept: dict[int, tuple[float, float]], box: Box | None) -> str:
    if not kept:
        return f"{path} holds no nodes; give an extract of OpenStreetMap"
    low, high = np.array(list(kept.values())).min(axis=0), np.array(list(kept.values())).max(axis=0)
    limits = ",".join(f"{value:.4f}" for value in (*low, *high))
    return f"{path} has nothing in the box; it covers --bbox {limits}"


def place(extract: Extract, height_m: float = 0.0) -> None:
    """Place the nodes of an extract on the plane that touches the Earth, at a height above the ellipsoid."""
    numbers = list(extract.degrees)
    places = np.array([extract.degrees[number] for number in numbers])
    streets = _street_places(extract)
    middle = np.round((streets.min(axis=0) + streets.max(axis=0)) / 2, 6)
    extract.geo = GeoReference(
        latitude_deg=float(middle[1]), longitude_deg=float(middle[0]), height_m=height_m
    )
    # On the ellipsoid, seen along its normal at the origin: within a millimetre of a flat map for some km.
    geodetic = np.column_stack([places[:, 1], places[:, 0], np.full(len(places), height_m)])
    world = np.round(extract.geo.geodetic_to_enu(geodetic)[:, :2], 4)
    extract.xy_m = {number: (float(x), float(y)) for number, (x, y) in zip(numbers, world, strict=True)}
