"""A town's `town.toml`: everything about it that OpenDRIVE does not say."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.geodesy import GeoReference

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

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
FEATURE_KINDS = (
    "filling_station",
    "monument",
    "viaduct",
    "building",
    "car_park",
    "bus_stop",
    "fountain",
    "farm",
    "barn",
    "silo",
    "billboard",
    "gantry",
    "construction_site",
    "pier",
    "gatehouse",
)
"""Single things that can be asked for at a place."""

Point = tuple[float, float]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficConfig:
    """How many others there are when the traffic is dynamic."""

    vehicles: int = 50
    """Number of vehicles besides the ego."""
    walkers: int = 10
    """Number of people on foot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalConfig:
    """Phase times of the traffic lights."""

    green_s: float = 18.0
    """Green of one group [s]."""
    yellow_s: float = 3.0
    """Yellow after green [s]."""
    all_red_s: float = 2.0
    """Red for everybody between two groups [s]."""
    offset_s: float = 0.0
    """How much later the cycles of all junctions begin [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Zone:
    """An area with one kind of scenery."""

    kind: str
    """One of `ZONE_KINDS`."""
    polygon: tuple[Point, ...]
    """Corners [m], world x and y."""

    def __post_init__(self) -> None:
        if self.kind not in ZONE_KINDS:
            raise ConfigError(unknown_name("zone kind", self.kind, ZONE_KINDS))
        if len(self.polygon) < 3:
            raise ConfigError(f"zone '{self.kind}' needs at least three corners in polygon")


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """A single thing at a place."""

    kind: str
    """One of `FEATURE_KINDS`."""
    position: Point
    """Where it stands [m], world x and y."""
    heading_deg: float = 0.0
    """Where its front looks [deg], anticlockwise from east."""
    size: tuple[float, ...] = ()
    """Viaduct, gantry, pier: length [m]; building, gatehouse: width [m], depth [m], storeys; car park, farm,
    barn, construction site: width [m], depth [m]; silo: diameter [m], height [m]; billboard: width [m],
    height [m]; empty for the usual ones."""

    def __post_init__(self) -> None:
        if self.kind not in FEATURE_KINDS:
            raise ConfigError(unknown_name("feature kind", self.kind, FEATURE_KINDS))


@dataclass(frozen=True, slots=True, kw_only=True)
class TownConfig:
    """A whole `town.toml`."""

    name: str = "town"
    """Name of the town."""
    description: str = ""
    """One line for lists of towns."""
    default_zone: str = "small_town"
    """Scenery outside all zones, one of `ZONE_KINDS`."""
    scenery_seed: int | None = None
    """Number from which houses, trees and all else are drawn; None: the hash of the map and its town.toml."""
    geo: GeoReference | None = None
    """Geodetic position of the world origin; None: the map's own."""
    route: RouteConfig = field(default_factory=RouteConfig)
    """The ego's route."""
    traffic: TrafficConfig = field(default_factory=TrafficConfig)
    """Numbers of others."""
    signals: SignalConfig = field(default_factory=SignalConfig)
    """Phase times."""
    zones: tuple[Zone, ...] = ()
    """Areas of scenery; where two overlap the later one holds."""
    features: tuple[Feature, ...] = ()
    """Single things."""

    def __post_init__(self) -> None:
        if self.default_zone not in ZONE_KINDS:
            raise ConfigError(unknown_name("zone kind", self.default_zone, ZONE_KINDS))

    @staticmethod
    def from_toml(source: Path) -> TownConfig:
        """Configuration in a file.

        Raises:
            ConfigError: The file is no TOML, or a key is unknown; the message names the nearest valid key.
        """
        try:
            content = tomllib.loads(source.read_text(encoding="utf-8"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ConfigError(f"{source}: {error}; correct this line") from error
        try:
            return TownConfig.from_mapping(content)
        except ConfigError as error:
            raise ConfigError(f"{source}: {error}") from error

    @staticmethod
    def from_mapping(content: Mapping[str, Any]) -> TownConfig:
        """Configuration in nested mappings, with the sections of `town.toml`."""
        sections = ("town", "geo", "route", "traffic", "signals", "zone", "feature")
        for key in content:
            if key not in sections:
                raise ConfigError(unknown_name("section", key, sections))
        town = _checked(
            "town", content.get("town", {}), ("name", "description", "default_zone", "scenery_seed")
        )
        return TownConfig(
            **town,
            geo=_section(GeoReference, "geo", content["geo"]) if "geo" in content else None,
            route=_section(RouteConfig, "route", content.get("route", {})),
            traffic=_section(TrafficConfig, "traffic", content.get("traffic", {})),
            signals=_section(SignalConfig, "signals", content.get("signals", {})),
            zones=tuple(_section(Zone, "zone", entry) for entry in content.get("zone", [])),
            features=tuple(_section(Feature, "feature", entry) for entry in content.get("feature", [])),
        )


def _section(kind: type[Any], name: str, values: Mapping[str, Any]) -> Any:
    try:
        return kind(**_checked(name, values, [item.name for item in fields(kind)]))
    except TypeError as error:
        raise ConfigError(f"[{name}] is not complete: {error}") from error


def _checked(name: str, values: Mapping[str, Any], known: tuple[str, ...] | list[str]) -> dict[str, Any]:
    for key in values:
        if key not in known:
            raise ConfigError(unknown_name(f"key of [{name}]", key, known))
    return {key: _frozen(value) for key, value in values.items()}


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
