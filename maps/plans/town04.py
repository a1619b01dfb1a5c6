"""Town04: a figure-of-eight motorway with four lanes each way, two interchanges and a small town in one lobe.

    y  205        ╭──────────────── North Rd ────────────────╮
                  │   ╭───────────╮  Farm  ╭───────────╮     │
                  │  ╱  rest area  ╲      ╱   the town   ╲   │
         0  WX ─ WO ╪ WI ─ V        ╲ ╳  ╱  M1 ── M2 ─ EI ╪ EO ─ EX
                  │  ╲             ╱      ╲             ╱    │
                  │   ╰───────────╯        ╰───────────╯     │
      -205        ╰──────────────── South Rd ────────────────╯

Carriageway A runs from the crossing into the east lobe (anticlockwise) and back through the west lobe; B is A
turned by half a circle. On the line from north-west to south-east both pass over, on the other one under.
The drive is one circuit of A.
"""

import math
from collections.abc import Sequence
from typing import Any

from carlaloc_env.authoring.elements.cross_sections import CrossSection
from carlaloc_env.authoring.geometry.newton import solve
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Piece, Pose

from .authoring.curves import meeting
from .authoring.plan import BARE, TownPlan
from .authoring.profiles import Climb, Profile
from .authoring.ramps import Exit, Gore, Merge, OnRay

PROJECTION = "+proj=tmerc +lat_0=48.99 +lon_0=8.52 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
"""Projection of the map: transverse Mercator about its origin."""

MOTORWAY = CrossSection(lanes=4, back=0, inner_shoulder_m=0.8, shoulder_m=2.5, **BARE)
"""One carriageway of the motorway."""
RAMP = CrossSection(lanes=1, back=0, lane_m=4.0, inner_shoulder_m=0.5, shoulder_m=1.5, **BARE)
"""Slip roads."""
RURAL = CrossSection(lanes=2, lane_m=3.5, gutter_m=0.5, sidewalk_m=0.0)
"""Rural roads."""
LINK = CrossSection(lanes=1, lane_m=3.5, gutter_m=0.5, sidewalk_m=1.8)
"""Roads between motorway and town."""
STREET = CrossSection(lanes=1, lane_m=3.5, sidewalk_m=2.5)
"""Streets of the town."""
LANE = CrossSection(lanes=1, lane_m=3.2, sidewalk_m=1.8)
"""Lanes of the town."""

CIRCUIT_M = 2108.0
"""Length of one circuit of carriageway A [m]."""
SLANT_RAD = math.radians(34.6)
"""Slant of both lines that cross in the middle [rad]."""
LANE_OFFSET_M = 1.8
"""From the middle of the motorway to a carriageway's left lane: half the median, inner shoulder [m]."""
CLOTHOID_M = 70.0
"""Length of the motorway's clothoids [m]."""
TOP_M, BOTTOM_M, LOBE_M = 3.3, -3.3, -2.5
"""Heights at the crossing and round the lobes [m]."""
DECK_M = 3.6
"""Height of the local roads that pass over the lobes' far ends [m]."""

INNER_X, OUTER_X, CROSS_X, EDGE_Y = 348.0, 452.0, 545.0, 205.0
"""Both ends of the lobes' bridges, the links beyond them, and the rural roads [m]."""


def plan() -> TownPlan:
    """Nodes and roads of the town."""
    town = TownPlan(name="Town04", projection=PROJECTION)
    _motorway(town)
    for side, turn in (("East", 1.0), ("West", -1.0)):
        _interchange(town, side, turn)
    _outer_roads(town)
    _small_town(town)
    _rest_area(town)
    return town


def _bend(radius: float, sign: float) -> list[Piece]:
    """Clothoid, arc, clothoid through half a circle and twice the slant."""
    k = sign / radius
    arc = radius * (math.pi + 2 * SLANT_RAD) - CLOTHOID_M
    return [Piece(CLOTHOID_M, 0.0, k), Piece(arc, k, k), Piece(CLOTHOID_M, k, 0.0)]


def _half(radius: float, sign: float) -> tuple[float, list[Piece]]:
    """Straight from the crossing to the bend of a lobe, and the bend."""
    bend = _bend(radius, sign)
    end = Path(Pose(0.0, 0.0, 0.0), tuple(bend)).end
    return -meeting(Pose(0.0, 0.0, 0.0), end)[0], bend


def _circuit(radius: float) -> list[Piece]:
    """Pieces of carriageway A: the outer way round the east lobe, the inner way round the west lobe."""
    first, east = _half(radius + LANE_OFFSET_M, 1.0)
    second, west = _half(radius - LANE_OFFSET_M, -1.0)
    return [Piece(first), *east, Piece(first + second), *west, Piece(second)]


def carriageway(turned: bool) -> Path:
    """Left border of the left lane of carriageway A, or of B."""

    def miss(unknown: Sequence[float]) -> list[float]:
        return [math.fsum(p.length for p in _circuit(unknown[0])) - CIRCUIT_M]

    radius = round(solve(miss, [145.0])[0], 9)
    x, heading = -LANE_OFFSET_M / math.sin(SLANT_RAD), -SLANT_RAD
    start = Pose(-x, 0.0, heading + math.pi) if turned else Pose(x, 0.0, heading)
    return Path(start, tuple(_circuit(radius))).settled()


def _motorway(town: TownPlan) -> None:
    path = carriageway(False)
    lengths = [piece.length for piece in path.pieces]
    outer = lengths[0] + 0.5 * math.fsum(lengths[1:4])
    inner = math.fsum(lengths[:5]) + 0.5 * math.fsum(lengths[5:8])
    middle, total = math.fsum(lengths[:4]) + lengths[0], path.length
    run = (TOP_M - LOBE_M) / 0.04
    points = (
        (70.0, TOP_M), (70.0 + run, LOBE_M),
        (middle - 100.0, LOBE_M), (middle - 45.0, BOTTOM_M),
        (middle + 45.0, BOTTOM_M), (middle + 100.0, LOBE_M),
        (total - 70.0 - run, LOBE_M), (total - 70.0, TOP_M),
    )  # fmt: skip
    profile = Profile(points, 18.5)
    for name, turned, far, near in (("A", False, "East", "West"), ("B", True, "West", "East")):
        gores: tuple[Gore, ...] = (
            Exit(name=f"{far} outer exit", at_m=outer - 165.0),
            Merge(name=f"{far} outer entry", at_m=outer + 165.0),
            Exit(name=f"{near} inner exit", at_m=inner - 198.0),
            Merge(name=f"{near} inner entry", at_m=inner + 198.0),
        )
        town.loop(
            f"Motorway {name}", carriageway(turned), MOTORWAY, 80, kind="motorway", climb=profile, gores=gores
        )


def _interchange(town: TownPlan, side: str, turn: float) -> None:
    """A local road over the far end of a lobe, and four ramps; `turn` −1 turns it by half a circle."""
    tag = side[0]
    town.node(f"{tag}I", turn * INNER_X, 0.0, DECK_M, crosswalks=False)
    town.node(f"{tag}O", turn * OUTER_X, 0.0, DECK_M, crosswalks=False)
    town.node(f"{tag}X", turn * CROSS_X, 0.0, DECK_M, control="signals", corner_m=11.0)
    town.road(
        f"{side} Bridge", f"{tag}I", f"{tag}O", LINK, 50,
        bridges=((f"{side} Bridge", turn * 0.5 * (INNER_X + OUTER_X), 0.0, 60.0),),
    )  # fmt: skip
    town.road(f"{side} Link", f"{tag}O", f"{tag}X", LINK, 40)
    town.road(
        f"{side} outer off", f"{side} outer exit", f"{tag}O", RAMP, 50, bends=(OnRay(52.0, 55.0, 25.0),)
    )
    town.road(
        f"{side} outer on", f"{tag}O", f"{side} outer entry", RAMP, 50, bends=(OnRay(52.0, 55.0, 25.0),)
    )
    town.road(
        f"{side} inner off", f"{side} inner exit", f"{tag}I", RAMP, 40, bends=(OnRay(40.0, 45.0, 20.0),)
    )
    town.road(
        f"{side} inner on", f"{tag}I", f"{side} inner entry", RAMP, 40, bends=(OnRay(40.0, 45.0, 20.0),)
    )


def _outer_roads(town: TownPlan) -> None:
    """Country roads north and south of the motorway."""
    town.node("NF", 0.0, EDGE_Y, 0.0, control="stop", crosswalks=False)
    town.node("SF", 0.0, -EDGE_Y, 0.0, control="stop", crosswalks=False)
    town.node("FN", 0.0, 110.0, 0.5, control="bulb")
    town.node("FS", 0.0, -110.0, -0.5, control="bulb")
    for name, sign in (("North", 1.0), ("South", -1.0)):
        tag = name[0]
        corner = (sign * CROSS_X, sign * EDGE_Y, 70.0, 40.0)
        other = (-sign * CROSS_X, sign * EDGE_Y, 70.0, 40.0)
        first, last = ("EX", "WX") if sign > 0 else ("WX", "EX")
        gentle = Climb(grade=0.03, k_m=14.0)
        options: dict[str, Any] = {
            "kind": "rural",
            "climb": gentle,
            "taper_m": 32.0,
            "stores_m": (35.0, 35.0),
        }
        start, end = ("median", "plain"), ("plain", "pocket")
        town.road(f"{name} Rd 1", first, f"{tag}F", RURAL, 70, bends=(corner,), ends=start, **options)
        town.road(f"{name} Rd 2", f"{tag}F", last, RURAL, 70, bends=(other,), ends=end, **options)
    town.road("South Farm", "SF", "FS", LANE, 30)
    town.node("FT", 0.0, 155.0, 0.0, control="stop", crosswalks=False, corner_m=8.0)
    town.node("FW", -80.0, 155.0, 0.0, control="bulb")
    town.road("North Farm 1", "NF", "FT", LANE, 30)
    town.road("North Farm 2", "FT", "FN", LANE, 30)
    town.road("Orchard Lane", "FT", "FW", LANE, 30)


def _small_town(town: TownPlan) -> None:
    """Streets round two blocks in the east lobe; the main street climbs to the bridge."""
    row, west, middle, east = 74.0, 162.0, 236.0, 292.0
    town.node("M1", west, 0.0, control="stop", corner_m=8.0)
    town.node("M2", middle, 0.0, control="stop", corner_m=8.0, minor=("North St", "South St"))
    town.road("Main St 1", "M1", "M2", STREET, 40)
    town.road("Main St 2", "M2", "EI", STREET, 40, climb=Climb(grade=0.075, k_m=4.7))
    for tag, sign in (("N", 1.0), ("S", -1.0)):
        name = "North" if sign > 0 else "South"
        town.node(f"{tag}2", middle, sign * row, control="stop", corner_m=7.5)
        town.node(f"{tag}E", east, sign * row, 0.0, control="bulb")
        town.road(f"{name} Row", "M1", f"{tag}2", LANE, 30, bends=((west, sign * row, 18.0, 8.0),))
        town.road(f"{name} Close", f"{tag}2", f"{tag}E", LANE, 30)
        town.road(f"{name} St", "M2", f"{tag}2", STREET, 40)


def _rest_area(town: TownPlan) -> None:
    """A street with a turning circle behind the western interchange."""
    town.node("V", -190.0, 0.0, control="bulb", bulb_m=15.0)
    town.road("Rest Area Rd", "V", "WI", LINK, 40, climb=Climb(grade=0.07, k_m=4.7))
