"""A town as nodes and roads between them."""

from dataclasses import dataclass, field
from typing import Any

from carlaloc_env.authoring.elements.cross_sections import CrossSection
from carlaloc_env.authoring.geometry.junction_planes import Plane
from carlaloc_env.authoring.geometry.plan_view_curves import Path

from .auxiliary_lanes import ExtraLane
from .profiles import Climb, Dip, Profile
from .ramps import Gore, OnRay
from .roundabouts import RoundaboutShape

BARE: dict[str, Any] = {"gutter_m": 0.0, "sidewalk_m": 0.0}
"""Widths of a `CrossSection` that ends at its carriageway."""


@dataclass(slots=True, kw_only=True)
class Node:
    """A place where roads meet."""

    name: str
    x: float
    y: float
    z: float = 0.0
    control: str = "signals"
    """`signals`, `split` (lights, one leg at a time), `walkers` (lights for one crosswalk between two legs),
    `stop`, `yield`, `all_stop`, `none`, `bulb`."""
    corner_m: float = 9.0
    """Kerb radius of the corners, about [m]."""
    crosswalks: bool | str = True
    """On all legs, on none, or `minor`: only on those that give way."""
    minor: tuple[str, ...] = ()
    """Roads that give way at a `stop` or `yield` node; empty: the legs with no leg straight ahead."""
    roundabout: RoundaboutShape | None = None
    bulb_m: float = 12.0
    """Kerb radius of a cul-de-sac's bulb [m]."""
    least_m: float = 6.0
    """Least distance from the node to the ends of its legs [m]."""
    no_left: tuple[str, ...] = ()
    """Roads from which one may not turn left here."""
    u_turns: tuple[str, ...] = ()
    """Roads whose left-turn pocket leads back beside the median (crossovers of a `Michigan left`)."""
    slips: tuple[tuple[str, str], ...] = ()
    """Pairs of roads between which traffic turns right round an island, from an extra lane of the first."""
    slip_m: float = 34.0
    """Distance from the node to the ends of these legs [m]."""
    grade: tuple[float, float] = (0.0, 0.0)
    """Slope of the land towards east and north: the roads at the node, none of which has a `climb`, lean
    into its plane."""

    @property
    def plane(self) -> Plane:
        """The plane of the land through the node, in which the whole junction lies."""
        return Plane(self.x, self.y, self.z, *self.grade)


@dataclass(slots=True, kw_only=True)
class RoadPlan:
    """A road between two nodes or gores, or a loop of its own."""

    name: str
    a: str
    b: str
    cross: CrossSection
    speed_kmh: float
    bends: tuple[tuple[float, float, float, float] | OnRay, ...] = ()
    """x, y, radius, clothoid length [m] of every bend; `OnRay` next to a gore."""
    ends: tuple[str, str] = ("plain", "plain")
    """Layouts at a and b: `plain`, `pocket`, `median` (sections.road_sections)."""
    taper_m: float = 20.0
    stores_m: tuple[float, float] = (30.0, 30.0)
    climb: Climb | Dip | Profile | None = None
    shifts: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))
    """How far the axis passes beside the nodes a and b [m, east and north], for staggered legs."""
    tunnel: tuple[str, float] | None = None
    """Name and length [m] of the cover over the lowest point of a `Dip`."""
    bridges: tuple[tuple[str, float, float, float], ...] = ()
    """Name, x, y of the middle and length [m] of every bridge; it lies on the road's first straight."""
    speed_signs: bool = True
    """Whether a sign tells the limit where traffic enters."""
    kind: str = "town"
    """Road type of OpenDRIVE: `town`, `rural`, `motorway`, `lowSpeed` …"""
    extra: tuple[ExtraLane, ...] = ()
    """Lanes that exist on a part of the road only; not together with gores."""
    gores: tuple[Gore, ...] = ()
    """Where ramps leave and join, in the order of their stations."""
    path: Path | None = None
    """Axis of a closed road, which has gores but no nodes."""

    @property
    def closed(self) -> bool:
        """Whether the road is a loop."""
        return self.path is not None


@dataclass(slots=True, kw_only=True)
class TownPlan:
    """Collects nodes and roads; `builder.Builder` makes OpenDRIVE text of them."""

    name: str
    projection: str
    nodes: dict[str, Node] = field(default_factory=dict)
    roads: list[RoadPlan] = field(default_factory=list)

    def node(self, name: str, x: float, y: float, z: float = 0.0, **options: object) -> None:
        """Add a node; the options are those of `Node`."""
        self.nodes[name] = Node(name=name, x=x, y=y, z=z, **options)  # type: ignore[arg-type]

    def road(
        self, name: str, a: str, b: str, cross: CrossSection, speed_kmh: float, **options: object
    ) -> None:
        """Add a road; the options are those of `RoadPlan`."""
        self.roads.append(RoadPlan(name=name, a=a, b=b, cross=cross, speed_kmh=speed_kmh, **options))  # type: ignore[arg-type]

    def loop(self, name: str, path: Path, cross: CrossSection, speed_kmh: float, **options: object) -> None:
        """Add a closed road along a path that ends where it begins; it needs at least one gore."""
        self.roads.append(
            RoadPlan(name=name, a="", b="", cross=cross, speed_kmh=speed_kmh, path=path, **options)  # type: ignore[arg-type]
        )
