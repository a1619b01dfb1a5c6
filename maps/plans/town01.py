"""Town01: a small river town of T-junctions; flat, the river runs below four bridges.

    y  163  ╭──── north ring ── N ─────────────────────────────╮
        66  NW ── Mill St ───── M ──── NB ──────── MB ───────── NE
            ≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈ river ≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈≈
       -66  SW ── Market St ────────── SB ── H ──── KB ───────── SE
      -163  ╰──── south ring ─────────────── S ────────────────╯

The drive: Market St westwards, right over the Old Bridge, left into Mill St, right into the ring.
"""

from carlaloc_env.authoring.elements.cross_sections import CrossSection

from .authoring.plan import TownPlan

PROJECTION = "+proj=tmerc +lat_0=49.0 +lon_0=8.0 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
"""Projection of the map: transverse Mercator about its origin."""

STREET = CrossSection(lanes=1, lane_m=4.0, sidewalk_m=4.0)
"""Streets of the town and its ring."""
EAST, NORTH = 198.0, 163.0
"""Half the extent of the ring [m]."""
BANK_Y = 66.0
"""Mill Street runs this far north of the river's middle, Market Street as far south [m]."""
OLD_X, NEW_X = -40.0, 96.0
"""The bridges inside the town [m]."""
MILL_X, HALL_X = -112.0, 30.0
"""The links to the ring [m]."""
BEND = (14.0, 6.0)
"""Radius and clothoids of the ring's corners [m]."""
BRIDGE_M = 32.0
"""Length of the bridges [m]."""


def plan() -> TownPlan:
    """Nodes and roads of the town."""
    town = TownPlan(name="Town01", projection=PROJECTION)
    _nodes(town)
    _ring(town)
    _streets(town)
    return town


def _nodes(town: TownPlan) -> None:
    places = {
        "N": (MILL_X, NORTH), "M": (MILL_X, BANK_Y), "NB": (OLD_X, BANK_Y), "MB": (NEW_X, BANK_Y),
        "S": (HALL_X, -NORTH), "H": (HALL_X, -BANK_Y), "SB": (OLD_X, -BANK_Y), "KB": (NEW_X, -BANK_Y),
        "NW": (-EAST, BANK_Y), "SW": (-EAST, -BANK_Y), "NE": (EAST, BANK_Y), "SE": (EAST, -BANK_Y),
    }  # fmt: skip
    for name, (x, y) in places.items():
        town.node(name, x, y, control="split", corner_m=10.0)


def _ring(town: TownPlan) -> None:
    def corner(x: float, y: float) -> tuple[float, float, float, float]:
        return (x, y, *BEND)

    north_west, south_west = corner(-EAST, NORTH), corner(-EAST, -NORTH)
    north_east, south_east = corner(EAST, NORTH), corner(EAST, -NORTH)
    town.road("Ring NW", "N", "NW", STREET, 30, bends=(north_west,))
    town.road("Ring W", "NW", "SW", STREET, 30, bridges=(("West Bridge", -EAST, 0.0, BRIDGE_M),))
    town.road("Ring SW", "SW", "S", STREET, 30, bends=(south_west,))
    town.road("Ring SE", "S", "SE", STREET, 30, bends=(south_east,))
    town.road("Ring E", "SE", "NE", STREET, 30, bridges=(("East Bridge", EAST, 0.0, BRIDGE_M),))
    town.road("Ring NE", "NE", "N", STREET, 30, bends=(north_east,))


def _streets(town: TownPlan) -> None:
    town.road("Mill St 1", "NW", "M", STREET, 30)
    town.road("Mill St 2", "M", "NB", STREET, 30)
    town.road("Mill St 3", "NB", "MB", STREET, 30)
    town.road("Mill St 4", "MB", "NE", STREET, 30)
    town.road("Market St 1", "SW", "SB", STREET, 30)
    town.road("Market St 2", "SB", "H", STREET, 30)
    town.road("Market St 3", "H", "KB", STREET, 30)
    town.road("Market St 4", "KB", "SE", STREET, 30)
    town.road("Old Bridge St", "SB", "NB", STREET, 30, bridges=(("Old Bridge", OLD_X, 0.0, BRIDGE_M),))
    town.road("New Bridge St", "KB", "MB", STREET, 30, bridges=(("New Bridge", NEW_X, 0.0, BRIDGE_M),))
    town.road("Mill Lane", "N", "M", STREET, 30)
    town.road("Hall Lane", "H", "S", STREET, 30)
