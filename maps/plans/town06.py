"""Town06: long many-lane roads through open country, with exits, turn lanes, Michigan lefts and cul-de-sacs.

    y  255  NW ───── D1 ───────────── North Ave ──── D2 ─────────────────── NE
                      │                              │ (cul-de-sac)          │
        65  CW ───── C1 ═══X══════ Highway ═══════M═════════════════════════ CE
             │  Farm ─┤     ╲                    ╱                           │
      -125  BW ───── B1 ──── B2 ──── Mill Rd ── B3 ─────────── B4 ────────── BE
             │        │        ╲                               │             │
      -265  SW ─ UW ─ A1 ── UE ──╲X══════ Parkway ═══════════ A3 ────────── SE

The drive: eastwards along the highway in its right lane, over into the auxiliary lane and down the exit X.
"""

from typing import Any

from carlaloc_env.authoring.elements.cross_sections import CrossSection

from .authoring.auxiliary_lanes import ExtraLane
from .authoring.plan import BARE, TownPlan
from .authoring.profiles import Profile
from .authoring.ramps import Exit, Merge, OnRay

PROJECTION = "+proj=tmerc +lat_0=49.05 +lon_0=8.3 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
"""Projection of the map: transverse Mercator about its origin."""

PARKWAY = CrossSection(lanes=3, lane_m=3.6, median_m=18.0, shoulder_m=2.0, pocket_m=3.3, **BARE)
"""The parkway."""
PARKWAY_END = CrossSection(lanes=2, lane_m=3.6, median_m=18.0, shoulder_m=2.0, pocket_m=3.3, **BARE)
"""Its ends, a lane narrower."""
HIGHWAY = CrossSection(lanes=3, back=2, lane_m=3.6, median_m=6.0, shoulder_m=2.5, pocket_m=3.3, **BARE)
"""The highway."""
HIGHWAY_END = CrossSection(lanes=2, lane_m=3.6, median_m=6.0, shoulder_m=2.5, pocket_m=3.3, **BARE)
"""Its ends, a lane narrower."""
AVENUE = CrossSection(lanes=2, lane_m=3.6, median_m=4.0, gutter_m=0.4, sidewalk_m=2.0, pocket_m=3.3)
"""Avenues."""
CROSS_ROAD = CrossSection(lanes=2, lane_m=3.5, gutter_m=0.3, sidewalk_m=1.8)
"""Roads across."""
CROSS_ROAD_END = CrossSection(lanes=2, back=1, lane_m=3.5, gutter_m=0.3, sidewalk_m=1.8)
"""Their ends, a lane narrower."""
LANE = CrossSection(lanes=1, lane_m=3.3, gutter_m=0.3, sidewalk_m=1.6)
"""Lanes."""
RAMP = CrossSection(lanes=1, back=0, lane_m=4.2, inner_shoulder_m=0.6, shoulder_m=1.2, **BARE)
"""Slip roads."""

WEST, EAST = -520.0, 520.0
"""Extent of the town along x [m]."""
SOUTH, MILL, HIGH, NORTH = -265.0, -125.0, 65.0, 255.0
"""Its long roads along y [m]."""
K1, OFF, ON, K3, CLOSE = -300.0, 100.0, 190.0, 335.0, 40.0
"""Cross roads, the highway's exit and entry, and a close, along x [m]."""


def plan() -> TownPlan:
    """Nodes and roads of the town."""
    town = TownPlan(name="Town06", projection=PROJECTION)
    _nodes(town)
    _parkway(town)
    _mill_road(town)
    _highway(town)
    _north(town)
    _cross_roads(town)
    return town


def _nodes(town: TownPlan) -> None:
    for name, x, y in (("SW", WEST, SOUTH), ("SE", EAST, SOUTH), ("NW", WEST, NORTH), ("NE", EAST, NORTH)):
        town.node(name, x, y, control="none", corner_m=24.0, crosswalks=False)
    town.node("UW", -415.0, SOUTH, control="none", crosswalks=False, least_m=12.0, u_turns=("Parkway 2",))
    town.node("A1", K1, SOUTH, no_left=("Parkway 2", "County Rd 1"), crosswalks="minor", corner_m=12.0)
    town.node("UE", -110.0, SOUTH, control="none", crosswalks=False, least_m=12.0, u_turns=("Parkway 3",))
    town.node("A3", K3, SOUTH, corner_m=12.0)
    town.node("BW", WEST, MILL, control="stop")
    town.node("B1", K1, MILL)
    town.node("B2", OFF, MILL, control="stop", crosswalks=False, minor=("Mill exit", "Parkway exit"))
    town.node("B3", ON, MILL, control="stop", crosswalks=False)
    town.node("B4", K3, MILL, control="stop")
    town.node("BE", EAST, MILL, control="stop")
    town.node("CW", WEST, HIGH)
    town.node("C1", K1, HIGH, corner_m=12.0)
    town.node("CE", EAST, HIGH)
    town.node("D1", K1, NORTH, corner_m=12.0)
    town.node("D2", CLOSE, NORTH, control="stop", crosswalks="minor", corner_m=12.0)
    town.node("KC", K1, -30.0, control="stop", crosswalks="minor", corner_m=8.0)
    town.node("F", -400.0, -30.0, 0.0, control="bulb")
    town.node("P", CLOSE, 150.0, 0.0, control="bulb")


def _parkway(town: TownPlan) -> None:
    """Three lanes each way between A1 and A3; left turns at A1 by the crossovers UW and UE."""
    third: dict[str, Any] = {"width_m": 3.6, "taper_m": 30.0}
    town.road("Parkway 1", "SW", "UW", PARKWAY_END, 70)
    town.road(
        "Parkway 2", "A1", "UW", PARKWAY_END, 80,
        ends=("plain", "pocket"), taper_m=20.0, stores_m=(0.0, 20.0),
        extra=(ExtraLane(side="L", last_m=60.0, **third),),
    )  # fmt: skip
    town.road(
        "Parkway 3", "A1", "UE", PARKWAY, 90, ends=("plain", "pocket"), taper_m=30.0, stores_m=(0.0, 40.0)
    )
    town.road(
        "Parkway 4", "UE", "A3", PARKWAY, 90, ends=("plain", "pocket"), taper_m=30.0, stores_m=(0.0, 32.0),
        gores=(Exit(name="XP", at_m=314.0, side="L", aux_m=40.0, taper_m=30.0, length_m=56.0, lead_m=34.0),),
    )  # fmt: skip
    town.road(
        "Parkway 5", "A3", "SE", PARKWAY_END, 80,
        extra=(
            ExtraLane(side="R", last_m=85.0, name="third", width_m=3.6, taper_m=45.0),
            ExtraLane(side="L", last_m=65.0, name="turn", **third),
        ),
    )  # fmt: skip
    town.road("Parkway exit", "XP", "B2", RAMP, 40, bends=(OnRay(48.0, 36.0, 18.0),))


def _mill_road(town: TownPlan) -> None:
    both = {"taper_m": 25.0, "stores_m": (28.0, 28.0)}
    town.road("Mill Rd 1", "BW", "B1", AVENUE, 60, ends=("plain", "pocket"), **both)
    town.road("Mill Rd 2", "B1", "B2", AVENUE, 60, ends=("pocket", "plain"), **both)
    town.road(
        "Mill Rd 3", "B2", "B3", AVENUE, 60, ends=("plain", "pocket"), taper_m=15.0, stores_m=(0.0, 15.0)
    )
    town.road("Mill Rd 4", "B3", "B4", AVENUE, 60, ends=("plain", "plain"), **both)
    town.road("Mill Rd 5", "B4", "BE", AVENUE, 60, ends=("pocket", "plain"), **both)


def _highway(town: TownPlan) -> None:
    """The highway rises by 2.6 m over a long wave; an exit to Mill Road and a merge from it."""
    town.road(
        "Highway 1", "CW", "C1", HIGHWAY_END, 80, kind="rural",
        ends=("plain", "pocket"), taper_m=30.0, stores_m=(0.0, 35.0),
        extra=(ExtraLane(side="R", first_m=30.0, width_m=3.6, taper_m=50.0),),
    )  # fmt: skip
    wave = Profile(((90.0, 0.0), (260.0, 2.6), (520.0, 2.6), (700.0, 0.0)), 22.0)
    town.road(
        "Highway 2", "C1", "CE", HIGHWAY, 80, kind="rural", climb=wave,
        ends=("pocket", "plain"), taper_m=30.0, stores_m=(35.0, 0.0),
        gores=(
            Exit(name="X", at_m=282.0, aux_m=100.0, taper_m=50.0),
            Merge(name="M", at_m=612.0, aux_m=None),
        ),
    )  # fmt: skip
    town.road("Mill exit", "X", "B2", RAMP, 50, bends=(OnRay(48.0, 45.0, 22.0),))
    town.road("Mill entry", "B3", "M", RAMP, 50, bends=(OnRay(48.0, 45.0, 22.0),))


def _north(town: TownPlan) -> None:
    turn = ExtraLane(side="R", first_m=-90.0, width_m=3.3, taper_m=30.0)
    town.road("North Ave 1", "NW", "D1", AVENUE, 70, extra=(turn,))
    town.road(
        "North Ave 2", "D1", "D2", AVENUE, 70, ends=("pocket", "plain"), taper_m=25.0, stores_m=(30.0, 0.0),
        extra=(turn,),
    )  # fmt: skip
    town.road(
        "North Ave 3", "D2", "NE", AVENUE, 70, ends=("pocket", "plain"), taper_m=25.0, stores_m=(30.0, 0.0)
    )
    town.road("Orchard Close", "D2", "P", LANE, 30)


def _cross_roads(town: TownPlan) -> None:
    store: dict[str, Any] = {"taper_m": 25.0, "stores_m": (28.0, 28.0)}
    left, right = ("pocket", "plain"), ("plain", "pocket")
    for side, north, south in (("West", left, ("plain", "plain")), ("East", right, right)):
        tag = side[0]
        town.road(f"{side} Rd 1", f"S{tag}", f"B{tag}", AVENUE, 60, ends=south, **store)
        town.road(f"{side} Rd 2", f"B{tag}", f"C{tag}", AVENUE, 60, ends=north, **store)
        last = north if side == "West" else ("plain", "plain")
        town.road(f"{side} Rd 3", f"C{tag}", f"N{tag}", AVENUE, 60, ends=last, **store)
    # Nobody turns left into its northbound carriageway: the second lane begins on the way.
    second = ExtraLane(side="L", last_m=-20.0, taper_m=30.0)
    short: dict[str, Any] = {"taper_m": 24.0, "stores_m": (20.0, 20.0)}
    town.road("County Rd 1", "B1", "A1", CROSS_ROAD_END, 50, extra=(second,), ends=left, **short)
    town.road("County Rd 2", "KC", "B1", CROSS_ROAD, 50, ends=right, **short)
    town.road("County Rd 3", "C1", "KC", CROSS_ROAD, 50, ends=left, **short)
    town.road("County Rd 4", "D1", "C1", CROSS_ROAD, 50, ends=right, **short)
    town.road("Farm Rd", "KC", "F", LANE, 30)
    town.road("School Rd", "B4", "A3", LANE, 40)
