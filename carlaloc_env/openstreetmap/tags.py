"""Streets by their tags: lanes, widths, limits, sidewalks; by their class where no tag says it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from carlaloc_env.openstreetmap.countries import Country
from carlaloc_env.openstreetmap.elements import Tags, Way

CLASSES: dict[str, tuple[int, float]] = {
    "motorway": (7, 3.75), "trunk": (6, 3.5), "primary": (5, 3.5), "secondary": (4, 3.25),
    "tertiary": (3, 3.25), "motorway_link": (4, 3.75), "trunk_link": (4, 3.5), "primary_link": (3, 3.5),
    "secondary_link": (3, 3.25), "tertiary_link": (2, 3.25), "unclassified": (2, 3.0),
    "residential": (1, 3.0), "living_street": (0, 2.75),
}  # fmt: skip
"""Rank of every class of street that cars use, and width of its lanes where no tag says it [m]."""
LANE_M = (2.6, 3.75)
"""Narrowest and widest lane that is built [m]; at 2.3 m cars that meet graze each other."""
ALONE_M = 3.5
"""Width of a one-way street's only lane, between two kerbs, where no tag says it [m]; at least."""
MOST_LANES = 6
"""Most lanes of one direction."""
TOWN_CLASSES = ("residential", "living_street")
"""Classes of streets that only towns have."""
_MPH, _KNOT = 1.609344, 1.852
_NUMBER = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(mph|knots|km/h|kmh|kph|m|ft|')?", re.IGNORECASE)
_YES = ("yes", "1", "true")


@dataclass(frozen=True, slots=True, kw_only=True)
class Street:
    """A street by one way, in its own direction of travel."""

    name: str
    rank: int
    oneway: bool
    lanes: tuple[int, int]
    """Lanes along the way and against it."""
    turns: tuple[tuple[str, ...], tuple[str, ...]]
    """Marks of the lanes along it and against it, from the left of their drivers; empty: none tagged."""
    lane_m: float
    speed_kmh: float
    walks: tuple[float, float]
    """Widths of the sidewalks on the left and on the right [m]."""
    bike_m: float
    level: int
    ring: bool
    """Whether the way is part of a roundabout."""
    surface: str
    kind: str
    """Road type of OpenDRIVE."""
    guesses: tuple[str, ...]
    """Names of tags that are missing, so that the class decided."""


def number(text: str | None) -> float | None:
    """First number of a tag in metres, km/h or as it stands; None where it has none."""
    match = _NUMBER.match((text or "").replace(",", "."))
    if not match:
        return None
    unit = (match[2] or "").lower()
    factor = {"mph": _MPH, "knots": _KNOT, "ft": 0.3048, "'": 0.3048}.get(unit, 1.0)
    return float(match[1]) * factor


def for_cars(way: Way) -> bool:
    """Whether cars may use a way that is a street."""
    tags = way.tags
    if tags.get("highway") not in CLASSES or tags.get("area") == "yes" or len(way.nodes) < 2:
        return False
    allowed = next((tags[k] for k in ("motorcar", "motor_vehicle", "vehicle", "access") if k in tags), "yes")
    return allowed not in ("no", "private", "agricultural", "forestry", "delivery", "emergency")


def direction(tags: Tags) -> int:
    """1: one-way along the nodes, −1: against them, 0: two-way."""
    stated = tags.get("oneway", "")
    if stated == "-1" or stated == "reverse":
        return -1
    if stated in _YES:
        return 1
    ring = tags.get("junction") in ("roundabout", "circular")
    fast = tags.get("highway") in ("motorway", "motorway_link")
    return 1 if stated != "no" and (ring or fast) else 0


def read_street(way: Way, country: Country, in_town: bool, *, left: bool) -> Street:
    """The street that a way's tags describe, the rest guessed by its class.

    Args:
        way: A way for cars, whose one-way traffic runs along its nodes.
        country: Rules where no sign stands.
        in_town: Whether houses stand beside it; for its limit its class and tags count, too.
        left: Whether traffic keeps to the left; sides are then mirrored.
    """
    tags, guesses = way.tags, []
    kind = tags["highway"]
    zone = _zone(tags)
    urban = kind in TOWN_CLASSES or "urban" in zone or (in_town and "rural" not in zone)
    rank, lane_m = CLASSES[kind]
    oneway = direction(tags) != 0
    lanes, tagged = _lanes(tags, oneway, kind)
    if not tagged:
        guesses.append("lanes")
    width = number(tags.get("width:carriageway") or tags.get("width"))
    if width is not None and 2.0 <= width <= 60.0:
        lane_m = width / sum(lanes)
    else:
        guesses.append("width")
        lane_m = max(lane_m, ALONE_M) if lanes == (1, 0) else lane_m
    signs = (tags.get(key) for key in ("maxspeed", "maxspeed:forward", "maxspeed:backward"))
    limits = (_limit(text, country) for text in (*signs, zone))
    limit = next((kmh for kmh in limits if kmh is not None), None)
    if limit is None:
        guesses.append("maxspeed")
        limit = _usual_limit(kind, country, urban)
    walks, stated = _walks(tags, kind, limit, in_town)
    if not stated:
        guesses.append("sidewalk")
    if left:
        walks = walks[::-1]
    paths = ("cycleway", "cycleway:both", "cycleway:right", "cycleway:left")
    return Street(
        name=tags.get("name") or tags.get("ref") or kind,
        rank=rank,
        oneway=oneway,
        lanes=lanes,
        turns=_turns(tags, lanes, oneway, left),
        lane_m=min(max(lane_m, LANE_M[0]), LANE_M[1]),
        speed_kmh=limit,
        walks=walks,
        bike_m=1.5 if any(tags.get(key) == "lane" for key in paths) else 0.0,
        level=_level(tags),
        ring=tags.get("junction") in ("roundabout", "circular"),
        surface=_SURFACES.get(tags.get("surface", ""), "asphalt"),
        kind=_kind(kind, urban),
        guesses=tuple(guesses),
    )


def _lanes(tags: Tags, oneway: bool, kind: str) -> tuple[tuple[int, int], bool]:
    def count(key: str) -> int | None:
        value = number(tags.get(key))
        return None if value is None or not 1 <= value <= 2 * MOST_LANES else int(value)

    total, ahead, back = count("lanes"), count("lanes:forward"), count("lanes:backward")
    usual = 2 if kind in ("motorway", "trunk") else 1
    if oneway:
        return (min(total or ahead or usual, MOST_LANES), 0), total is not None or ahead is not None
    if total is not None and ahead is None and back is not None:
        ahead = max(total - back, 1)
    if total is not None and back is None:
        back = max(total - ahead, 1) if ahead is not None else max(total // 2, 1)
    if ahead is None:
        ahead = max((total or 2) - (back or 1), 1)
    return (min(ahead, MOST_LANES), min(back or 1, MOST_LANES)), total is not None


def _turns(
    tags: Tags, lanes: tuple[int, int], oneway: bool, left: bool
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    turns = []
    for k, keys in enumerate((("turn:lanes:forward", "turn:lanes"), ("turn:lanes:backward",))):
        text = next((tags[key] for key in keys if key in tags and (oneway or key != "turn:lanes")), "")
        marks = tuple(text.split("|"))
        if len(marks) != lanes[k] or not text:
            marks = ()
        turns.append(tuple(map(_swapped, reversed(marks))) if left else marks)
    return turns[0], turns[1]


def _swapped(mark: str) -> str:
    return mark.replace("left", "#").replace("right", "left").replace("#", "right")


def _limit(text: str | None, country: Country) -> float | None:
    if not text:
        return None
    text = text.split(";")[0].strip().lower()
    if text == "walk" or text.endswith(":walk") or text.endswith("living_street"):
        return 10.0
    if text == "none":
        return country.motorway_kmh
    for word, limit in (
        ("urban", country.town_kmh), ("nsl_restricted", country.town_kmh), ("rural", country.country_kmh),
        ("nsl_single", country.country_kmh), ("nsl_dual", country.motorway_kmh),
        ("motorway", country.motorway_kmh), ("zone30", 30.0), ("zone:30", 30.0), ("zone20", 20.0),
    ):  # fmt: skip
        if word in text:
            return limit
    value = number(text.rpartition(":")[2])
    return value if value is not None and 5.0 <= value <= 140.0 else None


def _zone(tags: Tags) -> str:
    """Kind of zone or of limit that tags state, such as DE:urban, DE:zone:30."""
    keys = ("maxspeed:type", "source:maxspeed", "zone:maxspeed", "zone:traffic", "maxspeed:source")
    zones = (tags[key] for key in keys if key in tags)
    return next((zone.lower() for zone in zones if ":" in zone), "")


def _usual_limit(kind: str, country: Country, in_town: bool) -> float:
    usual = country.town_kmh if in_town else country.country_kmh
    if kind.endswith("_link"):
        usual = min(country.country_kmh, 60.0)
    return {"living_street": 10.0, "motorway": country.motorway_kmh}.get(kind, usual)


def _walks(tags: Tags, kind: str, limit_kmh: float, in_town: bool) -> tuple[tuple[float, float], bool]:
    width = 2.0
    stated = tags.get("sidewalk") or tags.get("sidewalk:both")
    both = {"both": (True, True), "yes": (True, True), "separate": (True, True), "left": (True, False),
            "right": (False, True), "no": (False, False),
            "none": (False, False)}.get(stated or "")  # fmt: skip
    sides = [tags.get("sidewalk:left"), tags.get("sidewalk:right")]
    if both is None and any(sides):
        both = (sides[0] in ("yes", "separate"), sides[1] in ("yes", "separate"))
    fast = kind.startswith(("motorway", "trunk")) or limit_kmh > 65.0
    left, right = both or (in_town and not fast,) * 2
    return (width * left, width * right), both is not None


def layer(tags: Tags) -> int:
    """The tagged layer, −5 to 5; 0 where there is none."""
    text = tags.get("layer") or ""
    value = number(text.lstrip("-")) or 0.0
    return 0 if value > 5 else int(value) * (-1 if text.startswith("-") else 1)


def _level(tags: Tags) -> int:
    if tags.get("tunnel") == "building_passage":
        return 0
    level = layer(tags)
    if tags.get("tunnel", "no") not in ("no", "culvert"):
        return min(level, -1)
    return max(level, 1) if tags.get("bridge", "no") not in ("no", "boardwalk") else level


def _kind(kind: str, in_town: bool) -> str:
    usual = "town" if in_town else "rural"
    return {"motorway": "motorway", "living_street": "lowSpeed"}.get(kind, usual)


_SURFACES = {
    "concrete": "concrete", "concrete:plates": "concrete", "gravel": "gravel", "fine_gravel": "gravel",
    "compacted": "gravel", "unpaved": "gravel", "pebblestone": "gravel", "dirt": "dirt", "earth": "dirt",
    "ground": "dirt", "mud": "dirt", "sand": "dirt",
}  # fmt: skip


def signed_nodes(extract_tags: Tags) -> str:
    """Kind of sign at a node: `signals`, `stop`, `give_way`, `crossing` or nothing."""
    kind = extract_tags.get("highway", "")
    if kind == "crossing" and extract_tags.get("crossing") == "traffic_signals":
        return "lit crossing"
    signs = {"traffic_signals": "signals", "crossing": "crossing", "stop": "stop", "give_way": "give_way"}
    return signs.get(kind, "")
