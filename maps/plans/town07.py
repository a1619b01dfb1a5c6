"""Town07: arable land; narrow lanes round fields, a hamlet, a lake in the east and a hill in the north-west.

    y  182    ╭── T1 ──────── T2 ──────── T3 ──╮
       110  hill  P6 ──────── Q5 ──────── R4 ── E3
        60  W3 ── P5          │    lake         │
        18  │     P4 ──────── Q4        · ───── K2
       -28  W2 ── P3          Q3 ──────── R3 ── E2
       -80  K1·   P2 ──────── Q2 ──────── R2    │        Q2: the hamlet's lights
      -128  W1 ── P1          Q1 ──────── R1 ── E1
      -182    ╰── B1 ──────── B2 ──────── B3 ──╯

The drive: north through the hamlet, along the lake, between the fields and over the hill.
"""

import math

from carlaloc_env.authoring.elements.cross_sections import CrossSection

from .authoring.plan import TownPlan

PROJECTION = "+proj=tmerc +lat_0=49.0 +lon_0=8.1 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
"""Projection of the map: transverse Mercator about its origin."""

ROAD = CrossSection(lanes=1, lane_m=3.5, gutter_m=0.5, sidewalk_m=0.0, marks="edge", gutter_surface="gravel")
"""The roads round the fields."""
LANE = CrossSection(lanes=1, lane_m=3.1, gutter_m=0.6, sidewalk_m=0.0, marks="none", gutter_surface="gravel")
"""Lanes without marks."""
HAMLET = CrossSection(lanes=1, lane_m=3.2, gutter_m=0.5, sidewalk_m=2.0, marks="none")
"""The street of the hamlet."""
LAKESIDE = CrossSection(lanes=1, lane_m=3.2, gutter_m=0.5, sidewalk_m=1.6, marks="edge")
"""The road along the lake."""
TRACK = CrossSection(lanes=1, lane_m=3.1, gutter_m=0.5, sidewalk_m=0.0, marks="none", surface="gravel")
"""Gravel tracks."""

LAND_M = 0.4
"""Height of the plain [m]."""
HILLS = ((8.5, -82.0, 138.0, 96.0), (2.6, 112.0, -160.0, 60.0), (-1.85, 86.0, 40.0, 58.0))
"""Height [m], x, y, width [m] of the Gaussian hills, of which the last is the lake's hollow."""
STEEPEST_JUNCTION = 0.042
"""Steepest plane in which a junction lies."""

POSITIONS = {
    "T1": (-60.0, 184.0), "T2": (14.0, 180.0), "T3": (86.0, 176.0),
    "B1": (-66.0, -184.0), "B2": (6.0, -178.0), "B3": (72.0, -184.0),
    "W1": (-136.0, -122.0), "W2": (-144.0, -32.0), "W3": (-138.0, 58.0), "K1": (-141.0, -78.0),
    "E1": (136.0, -122.0), "E2": (144.0, -44.0), "E3": (140.0, 104.0), "K2": (150.0, 28.0),
    "P1": (-70.0, -128.0), "P2": (-62.0, -84.0), "P3": (-66.0, -32.0),
    "P4": (-60.0, 14.0), "P5": (-66.0, 62.0), "P6": (-58.0, 114.0),
    "Q1": (10.0, -132.0), "Q2": (6.0, -80.0), "Q3": (12.0, -24.0), "Q4": (8.0, 20.0), "Q5": (14.0, 108.0),
    "R1": (76.0, -128.0), "R2": (72.0, -78.0), "R3": (80.0, -26.0), "R4": (84.0, 108.0),
}  # fmt: skip
"""Nodes [m]."""
STOP = ("T1", "T2", "T3", "B1", "B2", "B3", "E1", "E2", "E3", "W1", "W3")
"""Nodes with stop signs."""


def land(x: float, y: float) -> tuple[float, tuple[float, float]]:
    """Height of the land [m], and its gradient as far as a junction may lean."""
    z, east, north = LAND_M, 0.0, 0.0
    for height, x0, y0, width in HILLS:
        bump = height * math.exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2 * width**2))
        z += bump
        east -= bump * (x - x0) / width**2
        north -= bump * (y - y0) / width**2
    share = min(1.0, STEEPEST_JUNCTION / math.hypot(east, north))
    return round(z, 3), (round(share * east, 4), round(share * north, 4))


def plan() -> TownPlan:
    """Nodes and roads of the land."""
    town = TownPlan(name="Town07", projection=PROJECTION)
    _nodes(town)
    _outer_road(town)
    _lanes(town)
    _hamlet(town)
    return town


def _nodes(town: TownPlan) -> None:
    for name, (x, y) in POSITIONS.items():
        z, grade = land(x, y)
        options: dict[str, object] = {"control": "stop" if name in STOP else "yield", "corner_m": 7.0}
        if name == "Q2":
            options = {"control": "signals", "corner_m": 8.0, "crosswalks": True}
        elif name in ("R1", "R3"):
            options["control"] = "all_stop"
        elif name == "Q5":
            options |= {"control": "stop", "minor": ("Hill Lane 2", "North Lake Lane")}
        town.node(name, x, y, z, grade=grade, **({"crosswalks": False} | options))
    for name, x, y in (("Farm", -107.0, -79.5), ("Boathouse", 123.0, 29.5)):
        z, _ = land(x, y)
        town.node(name, x, y, z, control="bulb", bulb_m=11.0, crosswalks=False)


def _outer_road(town: TownPlan) -> None:
    town.road("North Road 1", "T1", "T2", ROAD, 40)
    town.road("North Road 2", "T2", "T3", ROAD, 50)
    town.road("North Road 3", "T3", "E3", ROAD, 40, bends=((142.0, 173.0, 26.0, 12.0),))
    town.road("East Road 1", "E3", "K2", ROAD, 50)
    town.road("East Road 2", "K2", "E2", ROAD, 50)
    town.road("East Road 3", "E2", "E1", ROAD, 60)
    town.road("South Road 1", "E1", "B3", ROAD, 40, bends=((138.0, -178.0, 24.0, 12.0),))
    town.road("South Road 2", "B3", "B2", ROAD, 50)
    town.road("South Road 3", "B2", "B1", ROAD, 60)
    town.road("South Road 4", "B1", "W1", ROAD, 40, bends=((-138.0, -182.0, 30.0, 14.0),))
    town.road("West Road 1", "W1", "K1", ROAD, 50)
    town.road("West Road 2", "K1", "W2", ROAD, 50)
    town.road("West Road 3", "W2", "W3", ROAD, 50)
    crest = ((-140.0, 150.0, 36.0, 14.0), (-105.0, 186.0, 36.0, 14.0))
    town.road("Crest Road", "W3", "T1", ROAD, 40, bends=crest)


def _lanes(town: TownPlan) -> None:
    for k, (a, b) in enumerate((("B1", "P1"), ("P1", "P2"), ("P2", "P3"), ("P3", "P4"))):
        town.road(f"Barley Lane {k + 1}", a, b, LANE, 40, speed_signs=k == 0)
    for k, (a, b) in enumerate((("P4", "P5"), ("P5", "P6"), ("P6", "T1"))):
        town.road(f"Windmill Lane {k + 1}", a, b, LANE, 30, speed_signs=k == 2)
    plain = {"speed_signs": False}
    town.road("Rye Lane", "W1", "P1", LANE, 40, **plain)
    town.road("Oat Lane", "W2", "P3", LANE, 30, **plain)
    town.road("Hill Lane 1", "W3", "P5", LANE, 30, **plain)
    town.road("Hill Lane 2", "P6", "Q5", LANE, 30, **plain)
    town.road("Wheat Lane", "P4", "Q4", LANE, 30, **plain)
    town.road("Mere Lane 1", "Q3", "Q4", LANE, 40, **plain)
    town.road("Mere Lane 2", "Q4", "Q5", LANE, 30)
    town.road("Mere Lane 3", "Q5", "T2", LANE, 30, **plain)
    town.road("North Lake Lane", "Q5", "R4", LANE, 30, **plain)
    town.road("North Lake Lane 2", "R4", "E3", LANE, 30, **plain)
    town.road("Orchard Lane", "R4", "T3", LANE, 30, **plain)
    town.road("Clover Lane 1", "B3", "R1", LANE, 40, **plain)
    town.road("Clover Lane 2", "R1", "E1", LANE, 40, **plain)
    town.road("Farm Track", "K1", "Farm", TRACK, 30, **plain)
    town.road("Boathouse Track", "K2", "Boathouse", TRACK, 30, **plain)


def _hamlet(town: TownPlan) -> None:
    plain = {"speed_signs": False}
    town.road("Hamlet Road 1", "B2", "Q1", HAMLET, 40)
    town.road("Hamlet Road 2", "Q1", "Q2", HAMLET, 40, **plain)
    town.road("Hamlet Road 3", "Q2", "Q3", HAMLET, 40, **plain)
    town.road("Church Lane 1", "P2", "Q2", HAMLET, 40, **plain)
    town.road("Church Lane 2", "Q2", "R2", HAMLET, 40, **plain)
    town.road("Forge Lane", "Q1", "R1", HAMLET, 40, **plain)
    town.road("Pond Lane 1", "R1", "R2", HAMLET, 40, **plain)
    town.road("Pond Lane 2", "R2", "R3", LAKESIDE, 40, **plain)
    town.road("Lake Road 1", "Q3", "R3", LAKESIDE, 40, **plain)
    town.road("Lake Road 2", "R3", "E2", LAKESIDE, 40)
