"""Town10: a skyscraper city on a headland, of boulevards with medians and left-turn pockets.

    y  164            ╭─ Theatre St ─╮
       105  ╭── TN ── N ─ Opera Bd ─ TE ──╮       N: staggered crossing
            │Tin Lane │                   │
        62  TW ───────╯                   │
         0  W ─ Market Bd ─ C ─ Market Bd ─ E     C: protected left turns; E: slip round an island
            │               │             │
      -105  ╰─ Harbour Dr ─ S ──── P ─────╯       P: lights for walkers alone
    water   ~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~~

The drive's loop runs clockwise in the right lane: once round the town and once round its south-west block.
"""

from carlaloc_env.authoring.elements.cross_sections import CrossSection

from .authoring.auxiliary_lanes import ExtraLane
from .authoring.plan import TownPlan

PROJECTION = "+proj=tmerc +lat_0=34.0 +lon_0=-118.2 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
"""Projection of the map: transverse Mercator about its origin."""

BOULEVARD = CrossSection(lanes=2, lane_m=3.5, median_m=3.0, sidewalk_m=5.0)
"""Boulevards with a median."""
HARBOUR = CrossSection(lanes=2, lane_m=3.5, median_m=3.0, sidewalk_m=9.0, left_sidewalk_m=5.0)
"""The harbour road with its promenade."""
STREET = CrossSection(lanes=1, lane_m=3.5, sidewalk_m=3.0)
"""Streets."""
LANE = CrossSection(lanes=1, lane_m=3.2, sidewalk_m=2.0)
"""Lanes."""

LIMIT_KMH = 30
"""Speed limit [km/h]: with junctions every 105 m, slower traffic flows better."""
PITCH = 105.8
"""Distance of the three rows and columns [m], chosen for a drive of 1115 m."""
BEND = (22.0, 12.0)
"""Radius and clothoids of the town's corners [m]."""
SOUTH_Z, MIDDLE_Z, NORTH_Z = 0.0, 0.4, 0.9
"""Heights of the three rows [m]."""
SLIP_M = 42.0
"""Length of the lane for those who turn right at E, its taper included [m]."""
ALLEY_X, ALLEY_Y = -50.0, 62.0
"""The bend of Tin Lane [m]."""
THEATRE_X, THEATRE_Y, STAGGER = 58.0, 164.0, 9.0
"""The bends round the theatre, and how far they are staggered [m]."""


def plan() -> TownPlan:
    """Nodes and roads of the town."""
    town = TownPlan(name="Town10", projection=PROJECTION)
    _nodes(town)
    _boulevards(town)
    _harbour(town)
    _lanes(town)
    return town


def _nodes(town: TownPlan) -> None:
    p = PITCH
    town.node("C", 0.0, 0.0, MIDDLE_Z, corner_m=9.0)
    town.node("N", 0.0, p, NORTH_Z, corner_m=12.0)
    town.node("E", p, 0.0, MIDDLE_Z, slips=(("Exchange Av", "Market Bd 2"),))
    town.node("S", 0.0, -p, SOUTH_Z)
    town.node("W", -p, 0.0, MIDDLE_Z)
    town.node("P", 62.0, -p, SOUTH_Z, control="walkers")
    town.node("TE", THEATRE_X, p, NORTH_Z, control="yield", corner_m=7.5, crosswalks="minor")
    town.node("TN", ALLEY_X, p, NORTH_Z, control="yield", corner_m=7.5, crosswalks="minor")
    town.node("TW", -p, ALLEY_Y, 0.65, control="yield", corner_m=7.5, crosswalks="minor")


def _boulevards(town: TownPlan) -> None:
    p, bd = PITCH, BOULEVARD
    pocket = {"taper_m": 16.0, "stores_m": (24.0, 24.0)}
    town.road("Market Bd 1", "W", "C", bd, LIMIT_KMH, ends=("plain", "pocket"), **pocket)
    town.road("Market Bd 2", "C", "E", bd, LIMIT_KMH, ends=("pocket", "plain"), **pocket)
    town.road("Central Bd 1", "S", "C", bd, LIMIT_KMH, ends=("plain", "pocket"), **pocket)
    town.road("Central Bd 2", "C", "N", bd, LIMIT_KMH, ends=("pocket", "plain"), **pocket)
    slip = ExtraLane(side="L", last_m=SLIP_M, taper_m=16.0, width_m=3.25, name="slip")
    town.road("Exchange Av", "E", "TE", bd, LIMIT_KMH, bends=((p, p, *BEND),), extra=(slip,))
    town.road("Opera Bd 1", "TE", "N", bd, LIMIT_KMH)
    town.road("Opera Bd 2", "N", "TN", bd, LIMIT_KMH)
    town.road("Mint Av 1", "TN", "TW", bd, LIMIT_KMH, bends=((-p, p, *BEND),))
    town.road("Mint Av 2", "TW", "W", bd, LIMIT_KMH)


def _harbour(town: TownPlan) -> None:
    """Along the water, with the promenade on the right."""
    p, bd = PITCH, HARBOUR
    pocket = {"taper_m": 16.0, "stores_m": (24.0, 24.0)}
    town.road(
        "Harbour Dr 1", "W", "S", bd, LIMIT_KMH, bends=((-p, -p, *BEND),), ends=("plain", "pocket"), **pocket
    )
    town.road("Harbour Dr 2", "S", "P", bd, LIMIT_KMH)
    town.road(
        "Harbour Dr 3", "P", "E", bd, LIMIT_KMH, bends=((p, -p, *BEND),), ends=("plain", "pocket"), **pocket
    )


def _lanes(town: TownPlan) -> None:
    town.road("Tin Lane", "TW", "TN", LANE, LIMIT_KMH, bends=((ALLEY_X, ALLEY_Y, 16.0, 8.0),))
    corners = ((THEATRE_X, THEATRE_Y, 15.0, 8.0), (STAGGER, THEATRE_Y, 15.0, 8.0))
    beside = ((0.0, 0.0), (STAGGER, 0.0))
    town.road("Theatre St", "TE", "N", STREET, LIMIT_KMH, bends=corners, shifts=beside)
