"""Small files of OpenStreetMap, drawn in metres."""

from __future__ import annotations

import gzip
from pathlib import Path
from xml.sax.saxutils import quoteattr

from carlaloc_env.core.geodesy import GeoReference

VIENNA = (48.2, 16.37)
"""Latitude and longitude [deg] of most sketches; in a country that drives on the right."""
OXFORD = (51.75, -1.26)
"""The same of one in a country that drives on the left."""


class Sketch:
    """Nodes, ways and relations, with ids from 1 on."""

    def __init__(self, place: tuple[float, float] = VIENNA) -> None:
        self.geo = GeoReference(latitude_deg=place[0], longitude_deg=place[1])
        self.nodes: dict[tuple[float, float], int] = {}
        self.degrees: dict[int, tuple[float, float]] = {}
        self._tags: dict[int, dict[str, str]] = {}
        self._ways: list[tuple[int, list[int], dict[str, str]]] = []
        self._relations: list[tuple[int, list[tuple[str, int, str]], dict[str, str]]] = []
        self._next = 0

    def node(self, x: float, y: float, **tags: str) -> int:
        """The node at a place [m]; its tags are added."""
        if (x, y) not in self.nodes:
            self._next += 1
            lat, lon, _ = self.geo.enu_to_geodetic([x, y, 0.0])
            self.nodes[x, y] = self._next
            self.degrees[self._next] = (round(float(lon), 7), round(float(lat), 7))
        number = self.nodes[x, y]
        self._tags.setdefault(number, {}).update(_keys(tags))
        return number

    def way(self, *points: tuple[float, float], **tags: str) -> int:
        """A way through places [m]; `__` in a key stands for `:`."""
        nodes = [self.node(*point) for point in points]
        self._next += 1
        self._ways.append((self._next, nodes, _keys(tags)))
        return self._next

    def block(self, x: float, y: float, width: float, depth: float, **tags: str) -> int:
        """A closed rectangle by its low corner."""
        corners = [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth), (x, y)]
        return self.way(*corners, **(tags or {"building": "yes"}))

    def relation(self, *members: tuple[str, int, str], **tags: str) -> int:
        """A relation of (kind, id, role)."""
        self._next += 1
        self._relations.append((self._next, list(members), _keys(tags)))
        return self._next

    def text(self) -> str:
        """Content of an .osm file."""
        lines = ["<?xml version='1.0' encoding='UTF-8'?>", '<osm version="0.6">']
        for number, (lon, lat) in self.degrees.items():
            lines.append(f'<node id="{number}" lon="{lon}" lat="{lat}">{_tags(self._tags[number])}</node>')
        for number, nodes, tags in self._ways:
            refs = "".join(f'<nd ref="{node}"/>' for node in nodes)
            lines.append(f'<way id="{number}">{refs}{_tags(tags)}</way>')
        for number, members, tags in self._relations:
            words = "".join(f'<member type="{k}" ref="{ref}" role="{role}"/>' for k, ref, role in members)
            lines.append(f'<relation id="{number}">{words}{_tags(tags)}</relation>')
        return "\n".join([*lines, "</osm>"])

    def write(self, path: Path) -> Path:
        """Write the file, packed if its name ends in .gz."""
        data = self.text().encode()
        path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
        return path


def _keys(tags: dict[str, str]) -> dict[str, str]:
    return {key.replace("__", ":"): value for key, value in tags.items()}


def _tags(tags: dict[str, str]) -> str:
    return "".join(f"<tag k={quoteattr(key)} v={quoteattr(value)}/>" for key, value in tags.items())


def village(place: tuple[float, float] = VIENNA) -> Sketch:
    """A cross of two streets, a side street of one way, houses, a tree and a pond."""
    sketch = Sketch(place)
    sketch.way((-200, 0), (-60, 0), (0, 0), (80, 0), (220, 10), highway="secondary", name="High Street")
    sketch.way((0, -150), (0, 0), (0, 90), (20, 180), highway="residential", name="Mill Lane")
    sketch.way((-60, 0), (-60, 60), (0, 90), highway="residential", oneway="yes", name="Back Lane")
    sketch.node(0, 0, highway="traffic_signals")
    for k in range(8):
        sketch.block(-180 + 45 * k, 12, 14, 10)
        sketch.block(-180 + 45 * k, -24, 14, 10)
    sketch.node(30, 40, natural="tree")
    sketch.block(60, 60, 40, 30, natural="water")
    return sketch


def bridge() -> Sketch:
    """A street over another one, and streets that join both on two sides."""
    sketch = Sketch()
    sketch.way((-260, 0), (260, 0), highway="secondary")
    sketch.way((0, -260), (0, -25), highway="tertiary")
    sketch.way((0, -25), (0, 25), highway="tertiary", bridge="yes", layer="1")
    sketch.way((0, 25), (0, 260), highway="tertiary")
    sketch.way((-260, 0), (-260, 260), (0, 260), highway="residential")
    sketch.way((-260, 0), (-260, -260), (0, -260), highway="residential")
    return sketch
