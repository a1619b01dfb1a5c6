"""A town's `town.toml`: everything about it that OpenDRIVE does not say."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.files import config_files
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.road.rough_surface import ROAD_CLASSES

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")
"""A dataclass of a section."""

ZONE_KINDS = (
    "downtown",
    "residential",
    "skyscraper",
    "small_town",
    "industrial",
    "rural",
    "highway",
    "waterfront",
    "park",
    "water",
)
"""Kinds of scenery that a zone can ask for."""
FEATURE_SIZES = {
    "filling_station": "",
    "monument": "",
    "viaduct": "length [m]",
    "building": "width [m], depth [m], storeys",
    "car_park": "width [m], depth [m]",
    "bus_stop": "",
    "fountain": "",
    "farm": "width [m], depth [m]",
    "barn": "width [m], depth [m]",
    "silo": "diameter [m], height [m]",
    "billboard": "width [m], height [m]",
    "gantry": "length [m]",
    "construction_site": "width [m], depth [m]",
    "pier": "length [m]",
    "gatehouse": "width [m], depth [m], storeys",
    "footbridge": "length [m]",
}
"""Single things that can be asked for at a position, and the numbers that `size` of each may hold."""
FEATURE_KINDS = tuple(FEATURE_SIZES)
"""Kinds of single things."""

Point = tuple[float, float]
"""World x and y [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteConfig:
    """The ego's route through the town."""

    points: tuple[Point, ...] = ()
    """Points [m], world x and y, that the route passes in this order; empty for no route."""
    loop: bool = False
    """Whether the route returns to its start."""
    length_m: float | None = None
    """Length at which the route ends [m]; None for its natural end."""
    start: Point | None = None
    """Where the ego starts [m], world x and y; None for the route's first point."""

    def __post_init__(self) -> None:
        if len(self.points) == 1:
            raise ConfigError("points holds one point; give at least two, or none")
        for point in self.points:
            _check_finite("points", point, "m")
        _check_finite("start", self.start or (), "m")
        if self.length_m is not None:
            _check_positive("length_m", self.length_m, "m")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficCounts:
    """Numbers of vehicles and walkers when the traffic is dynamic."""

    vehicles: int | None = None
    """Number of vehicles besides the ego; None: 50, fewer on small maps."""
    walkers: int | None = None
    """Number of walkers; None: 10, fewer where sidewalks are short, none without."""

    def __post_init__(self) -> None:
        for name, count in (("vehicles", self.vehicles), ("walkers", self.walkers)):
            if count is not None and count < 0:
                raise ConfigError(f"{name} is {count}; give 0 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalTiming:
    """Phase times of the traffic lights, which all junctions of a town share."""

    green_s: float = 18.0
    """Green of each phase [s]."""
    main_green_s: float | None = None
    """Least green of phases that let main streets pass, those of the route [s]; None: like `green_s`. The
    junctions of the route share a cycle, and these phases get the time that it leaves."""
    left_green_s: float = 7.0
    """Green of phases that hold protected left turns alone, at most `green_s` [s]; in left-hand traffic right
    turns."""
    yellow_s: float = 3.0
    """Yellow after green [s]."""
    all_red_s: float = 2.0
    """Red for everybody between two phases [s]."""
    offset_s: float = 0.0
    """How much later the cycles of all junctions begin [s]."""
    green_wave: bool = False
    """Whether the progression of the main streets begins with the drive, as a green wave for the ego; else
    each seed begins at another second of the cycle."""

    def __post_init__(self) -> None:
        _check_positive("green_s", self.green_s, "s")
        if self.main_green_s is not None:
            _check_positive("main_green_s", self.main_green_s, "s")
        _check_positive("left_green_s", self.left_green_s, "s")
        for name, value in (("yellow_s", self.yellow_s), ("all_red_s", self.all_red_s)):
            if not 0.0 <= value < math.inf:
                raise ConfigError(f"{name} is {value:g}; give 0 or more [s]")
        _check_finite("offset_s", (self.offset_s,), "s")


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadsideConfig:
    """Things along country roads and motorways."""

    delineators: bool = True
    """Whether reflecting posts stand along roads of the zones rural and highway."""
    exit_signs: bool = True
    """Whether direction signs and countdown markers lead to the exits of fast roads."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Zone:
    """An area with one kind of scenery."""

    kind: str
    """One of `ZONE_KINDS`."""
    polygon: tuple[Point, ...]
    """Corners [m], world x and y."""
    road_class: str = ""
    """Roughness of its roads, a class of ISO 8608 from `A` (smooth) to `H`; empty: what suits each road."""

    def __post_init__(self) -> None:
        if self.kind not in ZONE_KINDS:
            raise ConfigError(unknown_name("zone kind", self.kind, ZONE_KINDS))
        if self.road_class and self.road_class not in tuple(ROAD_CLASSES):
            raise ConfigError(unknown_name("road class", self.road_class, tuple(ROAD_CLASSES)))
        if len(self.polygon) < 3:
            raise ConfigError(f"zone '{self.kind}' needs at least three corners in polygon")
        for corner in self.polygon:
            _check_finite("polygon", corner, "m")


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """A single thing at a position."""

    kind: str
    """One of `FEATURE_KINDS`."""
    position: Point
    """Where it stands [m], world x and y."""
    heading_deg: float = 0.0
    """Where its front looks [deg], anticlockwise from east."""
    size: tuple[float, ...] = ()
    """Viaduct, gantry, pier, footbridge: length [m]; building, gatehouse: width [m], depth [m], storeys;
    car park, farm, barn, construction site: width [m], depth [m]; silo: diameter [m], height [m]; billboard:
    width [m], height [m]; empty for the usual ones."""

    def __post_init__(self) -> None:
        if self.kind not in FEATURE_KINDS:
            raise ConfigError(unknown_name("feature kind", self.kind, FEATURE_KINDS))
        _check_finite("position", self.position, "m")
        _check_finite("heading_deg", (self.heading_deg,), "deg")
        measures = FEATURE_SIZES[self.kind]
        if len(self.size) > len(measures.split(", ") if measures else ()):
            raise ConfigError(f"size of a {self.kind} holds {measures or 'nothing'}; found {list(self.size)}")
        for number in self.size:
            _check_positive("size", number, "m")


@dataclass(frozen=True, slots=True, kw_only=True)
class TownConfig:
    """A whole `town.toml`."""

    name: str = "town"
    """Name of the town."""
    description: str = ""
    """One line for lists of towns."""
    default_zone: str = "small_town"
    """Scenery outside all zones, one of `ZONE_KINDS`."""
    road_roughness: float = 1.0
    """Factor on the heights of all roads' profiles, 1 as their classes say; 0: roads exactly as the map has
    them."""
    scenery_seed: int | None = None
    """Number from which houses, trees and all else are drawn; None: the source hash."""
    geo: GeoReference | None = None
    """Geodetic position of the world origin; None: the map's own."""
    route: RouteConfig = field(default_factory=RouteConfig)
    """The ego's route."""
    traffic: TrafficCounts = field(default_factory=TrafficCounts)
    """Numbers of others."""
    signals: SignalTiming = field(default_factory=SignalTiming)
    """Phase times."""
    roadside: RoadsideConfig = field(default_factory=RoadsideConfig)
    """Things along country roads and motorways."""
    zones: tuple[Zone, ...] = ()
    """Areas of scenery; where two overlap the later one holds."""
    features: tuple[Feature, ...] = ()
    """Single things."""

    def __post_init__(self) -> None:
        if self.default_zone not in ZONE_KINDS:
            raise ConfigError(unknown_name("zone kind", self.default_zone, ZONE_KINDS))
        if not 0.0 <= self.road_roughness <= 8.0:
            raise ConfigError(f"road_roughness is {self.road_roughness:g}; give 0 (smooth) to 8, 1 is usual")

    @staticmethod
    def from_toml(source: Path) -> TownConfig:
        """Configuration in a file.

        Raises:
            ConfigError: The file is no TOML, a key is unknown or missing, or a value has a wrong type or lies
                out of its range; the message names file and key, and the nearest valid name.
        """
        try:
            content = tomllib.loads(read_text(source, "town.toml"))
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"{source}: {error}; correct this line") from error
        return TownConfig.from_mapping(content, str(source))

    @staticmethod
    def from_mapping(content: Mapping[str, Any], where: str = "town.toml") -> TownConfig:
        """Configuration in nested mappings, with the sections of `town.toml`.

        Args:
            content: Sections by name; those left out keep their defaults.
            where: What messages begin with, such as the file's name.

        Raises:
            ConfigError: A key is unknown or missing, or a value has a wrong type or lies out of its range.
        """
        for key in content:
            if key not in _SECTIONS:
                raise ConfigError(f"{where}: {unknown_name('section', key, _SECTIONS)}")
        town = content.get("town", {})
        for key in town if isinstance(town, Mapping) else ():
            if key not in TOWN_KEYS:
                raise ConfigError(f"{where}: town: {unknown_name('key', key, TOWN_KEYS)}")

        def section(kind: type[T], name: str) -> T:
            return config_files.from_mapping(kind, content.get(name, {}), f"{where}: {name}")

        def tables(kind: type[T], name: str) -> tuple[T, ...]:
            entries = content.get(name, [])
            if not isinstance(entries, list):
                raise ConfigError(f"{where}: {name}: write [[{name}]] above each one, in double brackets")
            names = (f"{where}: {name}[{n}]" for n in range(len(entries)))
            return tuple(config_files.from_mapping(kind, e, w) for e, w in zip(entries, names, strict=True))

        return dataclasses.replace(
            section(TownConfig, "town"),
            geo=section(GeoReference, "geo") if "geo" in content else None,
            route=section(RouteConfig, "route"),
            traffic=section(TrafficCounts, "traffic"),
            signals=section(SignalTiming, "signals"),
            roadside=section(RoadsideConfig, "roadside"),
            zones=tables(Zone, "zone"),
            features=tables(Feature, "feature"),
        )


TOWN_KEYS = ("name", "description", "default_zone", "road_roughness", "scenery_seed")
"""Keys of the section `[town]`."""
_SECTIONS = ("town", "geo", "route", "traffic", "signals", "roadside", "zone", "feature")


def _check_finite(name: str, values: tuple[float, ...], unit: str) -> None:
    if not all(math.isfinite(value) for value in values):
        raise ConfigError(f"{name} holds {list(values)}; give finite numbers [{unit}]")


def _check_positive(name: str, value: float, unit: str) -> None:
    if not 0.0 < value < math.inf:
        raise ConfigError(f"{name} is {value:g}; give more than 0 [{unit}]")
