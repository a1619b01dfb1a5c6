"""Town03: a mid city with a two-lane roundabout, an underpass, a hill and a residential quarter.

    y  200  NW ── north ring ── N ─────────────── H ──╮  hill, +8 m
       110  DW ── Station St ── J ── Station St ─ BD ─╯ Hill St
        10  W ── West Bd ────── R ══ East Bd (dips to −6 m under Bridge St) ══ E
      -100  CW ── Garden St ─── F ── Garden St ── BC ── EC ── CE      (cul-de-sac K north of EC)
      -200  ── south ring ───── S ────────────── BS ──────────

The drive's loop: R → E → hill → H → N → J → R, always in the left lane.
"""

from carlaloc_env.authoring.elements.cross_sections import CrossSection

from .authoring.plan import TownPlan
from .authoring.profiles import Climb, Dip
from .authoring.roundabouts import RoundaboutShape

PROJECTION = "+proj=tmerc +lat_0=49.0 +lon_0=8.43 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
"""Projection of the map: transverse Mercator about its origin."""

BOULEVARD = CrossSection(lanes=2, lane_m=3.5, median_m=3.0, sidewalk_m=3.0)
"""Boulevards with a median."""
RING = CrossSection(lanes=2, lane_m=3.5, sidewalk_m=2.5)
"""The ring."""
STREET = CrossSection(lanes=1, lane_m=3.5, sidewalk_m=2.5)
"""Streets."""
LANE = CrossSection(lanes=1, lane_m=3.2, sidewalk_m=2.0)
"""Residential lanes."""

EDGE = 200.0
"""Half the extent of the ring [m]."""
X, Y = -84.0, 15.0
"""The roundabout [m]."""
BRIDGE_X = 66.0
"""Bridge Street [m]."""
HILL_X = 128.0
"""Hill Street [m]."""
PARK_X, LOW_Y = -12.0, -152.0
"""Streets of the residential quarter [m]."""
STATION_Y, GARDEN_Y = 115.0, -100.0
"""The station junction and Garden Street [m]."""
BEND = (40.0, 24.0)
"""Radius and clothoids of the ring's corners [m]."""


def plan() -> TownPlan:
    """Nodes and roads of the town."""
    town = TownPlan(name="Town03", projection=PROJECTION)
    _nodes(town)
    _boulevards(town)
    _ring(town)
    _streets(town)
    _residential(town)
    return town


def _nodes(town: TownPlan) -> None:
    town.node("R", X, Y, roundabout=RoundaboutShape())
    town.node("N", X, EDGE, control="split")
    town.node("E", EDGE, Y)
    town.node("S", X, -EDGE)
    town.node("W", -EDGE, Y)
    town.node("J", X, STATION_Y, corner_m=10.0)
    town.node("F", X, GARDEN_Y)
    town.node("H", HILL_X, EDGE, 8.0, control="stop")
    town.node("DW", -EDGE, STATION_Y, control="stop")
    town.node("BD", BRIDGE_X, STATION_Y, 1.5, control="all_stop")
    town.node("CW", -EDGE, GARDEN_Y, control="stop")
    town.node(
        "BC", BRIDGE_X, GARDEN_Y, 0.6, control="stop", minor=("Bridge St 1", "Bridge St 2"), corner_m=7.5
    )
    town.node("BS", BRIDGE_X, -EDGE, control="stop")
    town.node("EC", 130.0, GARDEN_Y, 1.2, control="yield", corner_m=7.5, minor=("Elm Close", "Elm Lane"))
    town.node("CE", EDGE, GARDEN_Y, control="stop")
    town.node("GB", BRIDGE_X, LOW_Y, 0.0, control="stop", corner_m=7.5, minor=("Elm Lane", "Park Lane"))
    town.node("PG", PARK_X, GARDEN_Y, 0.5, control="stop", corner_m=7.5, minor=("Ash Close", "Park Lane"))
    town.node("K", 130.0, -42.0, 2.2, control="bulb")
    town.node("L", PARK_X, -40.0, 0.5, control="bulb")


def _boulevards(town: TownPlan) -> None:
    bd = BOULEVARD
    dip = Dip(bottom_m=-6.0, grade=0.078, k_m=4.2, x=BRIDGE_X, y=Y)
    town.road("East Bd", "R", "E", bd, 40, climb=dip, tunnel=("Bridge St underpass", 60.0))
    town.road("West Bd", "W", "R", bd, 50)
    town.road("North Bd 1", "R", "J", bd, 50, ends=("plain", "pocket"), taper_m=15, stores_m=(0.0, 24.0))
    town.road("North Bd 2", "J", "N", bd, 50, ends=("pocket", "plain"), taper_m=15)
    town.road("South Bd 1", "F", "R", bd, 50, ends=("pocket", "plain"), taper_m=15)
    town.road("South Bd 2", "S", "F", bd, 50, ends=("plain", "pocket"), taper_m=15)


def _ring(town: TownPlan) -> None:
    def corner(x: float, y: float) -> tuple[float, float, float, float]:
        return (x, y, *BEND)

    wide = {"taper_m": 32.0, "stores_m": (30.0, 30.0)}
    up = Climb(grade=0.07, k_m=6.5, centre=0.44)
    down = Climb(grade=0.07, k_m=6.5)
    town.road(
        "Ring NE", "E", "H", RING, 50, bends=(corner(EDGE, EDGE),), ends=("median", "plain"), climb=up, **wide
    )
    town.road("Ring N", "H", "N", RING, 50, climb=down)
    town.road("Ring NW", "N", "DW", RING, 50, bends=(corner(-EDGE, EDGE),))
    town.road("Ring W 1", "DW", "W", RING, 50, ends=("plain", "pocket"), taper_m=32.0, stores_m=(30.0, 25.0))
    town.road("Ring W 2", "W", "CW", RING, 50, ends=("median", "plain"), taper_m=32.0, stores_m=(25.0, 30.0))
    town.road("Ring SW", "CW", "S", RING, 50, bends=(corner(-EDGE, -EDGE),), ends=("plain", "pocket"), **wide)
    town.road("Ring S 1", "S", "BS", RING, 50, ends=("median", "plain"), **wide)
    town.road("Ring SE", "BS", "CE", RING, 50, bends=(corner(EDGE, -EDGE),))
    town.road("Ring E", "CE", "E", RING, 50, ends=("plain", "pocket"), taper_m=32.0, stores_m=(30.0, 25.0))


def _streets(town: TownPlan) -> None:
    both = {"taper_m": 32.0, "stores_m": (25.0, 25.0)}
    town.road("Station St 1", "DW", "J", STREET, 40, ends=("plain", "pocket"), **both)
    town.road("Station St 2", "J", "BD", STREET, 40, ends=("pocket", "plain"), **both)
    hill = Climb(grade=0.08, k_m=2.4)
    town.road("Hill St", "BD", "H", STREET, 30, bends=((HILL_X, STATION_Y, 24.0, 12.0),), climb=hill)
    town.road("Bridge St 1", "BD", "BC", STREET, 40)


def _residential(town: TownPlan) -> None:
    town.road("Garden St 1", "CW", "F", STREET, 40)
    town.road("Garden St 2", "F", "PG", LANE, 30)
    town.road("Garden St 3", "PG", "BC", LANE, 30)
    town.road("Garden St 4", "BC", "EC", LANE, 30)
    town.road("Garden St 5", "EC", "CE", LANE, 30)
    town.road("Bridge St 2", "BC", "GB", LANE, 30)
    town.road("Bridge St 3", "GB", "BS", LANE, 30)
    town.road("Elm Lane", "EC", "GB", LANE, 30, bends=((130.0, LOW_Y, 18.0, 8.0),))
    town.road("Elm Close", "EC", "K", LANE, 30)
    town.road("Ash Close", "PG", "L", LANE, 30)
    town.road("Park Lane", "PG", "GB", LANE, 30, bends=((PARK_X, LOW_Y, 18.0, 8.0),))
