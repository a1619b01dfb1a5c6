"""The side one drives on in an extract: by roundabouts and pairs of carriageways, else by country."""

import itertools
import math
from collections.abc import Iterable

from carlaloc_env.openstreetmap.countries import Country
from carlaloc_env.openstreetmap.extract import Extract

_NEAR_M = 45.0
_PAIRED = ("motorway", "trunk", "primary", "secondary", "tertiary")


def drives_left(extract: Extract, country: Country) -> tuple[bool, str]:
    """Whether traffic keeps to the left, and what says so.

    Rings of roundabouts and pairs of one-way carriageways of one name show it; without both, the country.
    """
    rings = sum(_ring_votes(extract))
    if rings:
        return rings > 0, "roundabouts"
    pairs = _pair_votes(extract)
    if abs(pairs) > 100.0:
        return pairs > 0, "dual carriageways"
    return country.left, f"country {country.code}" if country.code else "no country is known here"


def _ring_votes(extract: Extract) -> Iterable[int]:
    """1 for each clockwise ring, −1 for each anticlockwise one."""
    for way in extract.ways.values():
        if way.tags.get("junction") == "roundabout" and len(way.nodes) > 3 and way.nodes[0] == way.nodes[-1]:
            line = extract.line(way.nodes)
            x, y = line[:-1].T
            area = float((x * line[1:, 1] - line[1:, 0] * y).sum())
            yield (1 if area < 0 else -1) * (-1 if way.tags.get("oneway") == "-1" else 1)


def _pair_votes(extract: Extract) -> float:
    """Metres of one-way streets whose other carriageway lies on the right, less those with it on the left."""
    pieces: dict[str, list[tuple[float, float, float, float, float]]] = {}
    for way in extract.ways.values():
        tags = way.tags
        name = tags.get("ref") or tags.get("name")
        if not name or tags.get("oneway") != "yes" or tags.get("highway") not in _PAIRED:
            continue
        line = extract.line(way.nodes)
        for (x0, y0), (x1, y1) in itertools.pairwise(line):
            length = math.hypot(x1 - x0, y1 - y0)
            if length > 1.0:
                u, v = (x1 - x0) / length, (y1 - y0) / length
                pieces.setdefault(name, []).append(((x0 + x1) / 2, (y0 + y1) / 2, u, v, length))
    votes = 0.0
    for parallel in pieces.values():
        for x, y, u, v, length in parallel:
            against = [
                (math.hypot(p - x, q - y), u * (q - y) - v * (p - x))
                for p, q, c, s, _ in parallel
                if u * c + v * s < -0.9 and math.hypot(p - x, q - y) < _NEAR_M
            ]
            if against:
                votes += math.copysign(length, -min(against)[1])
    return votes
