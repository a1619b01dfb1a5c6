"""Town05: a mid city on a square grid inside a raised ring road.

    y  312        .   ZN ───────────────╮
       260  ╭═════╪═══╪════ ring ═══╪═══╗ ╮      ring: 3+3 lanes, 6.5 m above the streets
       187  ║     ┬───┬─────┬───────NE──╫─╯      (two corners of the grid are bends)
        62  ║     ├───┼─────┼───────┤───╫─ ZE    streets pass under the ring to quays outside
       -62  ╫─────┼───┼─────┼───────┤←ramp║
      -187  ╫─────SW──┴─────┴───────╯   ║
      -260  ╚═══════════════════════════╝

North is the mirror image of east in the diagonal, driven backwards: ramps that leave the ring in the east
join it in the north. West and south are east and north turned by half a circle.
"""

import itertools
import math

from carlaloc_env.authoring.elements.cross_sections import CrossSection
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Piece

from .authoring.curves import fillet
from .authoring.plan import TownPlan
from .authoring.profiles import Profile
from .authoring.ramps import Exit, Gore, Merge, OnRay, ramp_end

PROJECTION = "+proj=tmerc +lat_0=41.88 +lon_0=-87.63 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
"""Projection of the map: transverse Mercator about its origin."""

RING = CrossSection(
    lanes=3, lane_m=3.5, median_m=2.0, inner_shoulder_m=0.5, shoulder_m=1.5, gutter_m=0.0, sidewalk_m=0.0
)
"""The raised ring road."""
RAMP = CrossSection(
    lanes=1, back=0, lane_m=4.0, inner_shoulder_m=0.5, shoulder_m=1.0, gutter_m=0.0, sidewalk_m=0.0
)
"""Ramps of the ring."""
STREET = CrossSection(lanes=2, lane_m=3.5, sidewalk_m=3.0)
"""Streets of the grid."""
QUAY = CrossSection(lanes=1, lane_m=3.5, sidewalk_m=2.5)
"""The quays outside the ring."""
OUTWARD = CrossSection(lanes=2, back=1, lane_m=3.5, sidewalk_m=3.0)
"""Streets that widen outwards."""
INWARD = CrossSection(lanes=1, back=2, lane_m=3.5, sidewalk_m=3.0)
"""Streets that widen inwards."""

EDGE, HEIGHT = 260.0, 6.5
"""Half the extent of the ring, and its height [m]."""
FAR, NEAR = 187.5, 62.5
"""The grid's outer and inner streets [m]."""
OUTSIDE = 298.0
"""The quays [m]."""
INNER_AT, OUTER_AT = 70.0, -108.0
"""Middles of the ring's gores along its eastern side [m]."""
PARALLEL_M = 14.0
"""From where an inner ramp is straight to where it bends to run beside the ring [m]."""
BRIDGE_M = 66.0
"""Length of the bridge of every ramp [m]."""
GORE = {"length_m": 46.0, "aux_m": 120.0, "taper_m": 40.0, "lead_m": 25.0}
"""Measures of every gore."""


def plan() -> TownPlan:
    """Nodes and roads of the town."""
    town = TownPlan(name="Town05", projection=PROJECTION)
    _nodes(town)
    _grid(town)
    ring = _ring_axis()
    gores = _gores(ring)
    bridges = tuple((f"Ring {k + 1}", *at, 2000.0) for k, at in enumerate(_between(ring, gores)))
    flat = Profile(points=((0.0, HEIGHT),), k_m=1.0)
    town.loop("Ring", ring, RING, 70, gores=gores, climb=flat, kind="motorway", bridges=bridges)
    _ramps(town, ring, gores)
    _quays(town)
    return town


def _turned(quarter: int, x: float, y: float) -> tuple[float, float]:
    """A point of the east (quarter 0) in the north, west and south."""
    return ((x, y), (y, x), (-x, -y), (-y, -x))[quarter]


def _name(x: float, y: float) -> str:
    """Name of a grid node: column and row from the south-west, `A1` to `D4`."""
    return "ABCD"[round((x + FAR) / 125)] + str(round((y + FAR) / 125) + 1)


def _nodes(town: TownPlan) -> None:
    rows = (-FAR, -NEAR, NEAR, FAR)
    for x in rows:
        for y in rows:
            if _name(x, y) not in ("D1", "A4"):
                town.node(_name(x, y), x, y)
    for quarter, control in enumerate(("yield", "stop", "yield", "stop")):
        x, y = _turned(quarter, OUTSIDE, NEAR)
        minor = (f"Ramp {quarter} out",) if control == "yield" else (f"Quay {quarter} under",)
        town.node(f"Z{quarter}", x, y, control=control, minor=minor, crosswalks=False)


def _grid(town: TownPlan) -> None:
    rows = (-FAR, -NEAR, NEAR, FAR)
    for across in rows:
        for k in range(3):
            for along, name in ((True, "Street"), (False, "Avenue")):
                a, b = ((rows[k], across), (rows[k + 1], across))
                if not along:
                    a, b = a[::-1], b[::-1]
                if {_name(*a), _name(*b)} & {"D1", "A4"}:
                    continue
                label = f"{name} {rows.index(across) + 1}.{k + 1}"
                ends = tuple("pocket" if abs(x) == abs(y) == NEAR else "plain" for x, y in (a, b))
                town.road(
                    label, _name(*a), _name(*b), STREET, 50, ends=ends, taper_m=16.0, stores_m=(21.0, 21.0)
                )
    for first, last, sign in (("C1", "D2", 1), ("B4", "A3", -1)):
        town.road(f"Corner {first}", first, last, STREET, 40, bends=((sign * FAR, -sign * FAR, 20.0, 10.0),))


def _ring_axis() -> Path:
    """Anticlockwise from the end of the eastern straight, so that no straight is divided."""
    corners = [(EDGE, EDGE), (-EDGE, EDGE), (-EDGE, -EDGE), (EDGE, -EDGE)]
    axis = fillet([(EDGE, 0.0), *corners, (EDGE, 0.0)], [(70.0, 30.0)] * 4)
    first, last = axis.pieces[0], axis.pieces[-1]
    return Path(axis.starts()[1], (*axis.pieces[1:-1], Piece(first.length + last.length)))


def _gores(ring: Path) -> tuple[Gore, ...]:
    """Two on every side: exits in the east and west, merges in the north and south; by station."""
    quarter, begin = 0.25 * ring.length, ring.start.y
    gores: list[Gore] = []
    for k in range(4):
        kind = Exit if k % 2 == 0 else Merge
        sign = 1.0 if k % 2 == 0 else -1.0
        for place, at in (("in", INNER_AT), ("out", OUTER_AT)):
            side = "L" if place == "in" else "R"
            station = (k * quarter + sign * at - begin) % ring.length
            gores.append(kind(name=f"G{k} {place}", at_m=station, side=side, **GORE))
    return tuple(sorted(gores, key=lambda gore: gore.at_m))


def _between(ring: Path, gores: tuple[Gore, ...]) -> list[tuple[float, float]]:
    """Points amid the parts of the ring between its gores."""
    stations = [gore.at_m for gore in gores]
    middles = [0.5 * (a + b) for a, b in itertools.pairwise(stations)]
    middles.append((0.5 * (stations[-1] + stations[0] + ring.length)) % ring.length)
    return [(pose.x, pose.y) for pose in (ring.at(s) for s in middles)]


def _ramps(town: TownPlan, ring: Path, gores: tuple[Gore, ...]) -> None:
    """Four ramps to the grid and four to the quays; lengths of straights are those of the east."""
    ends = {gore.name: ramp_end(gore, ring, True, RING, RAMP).straight(gore.merges) for gore in gores}
    inner, outer = ends["G0 in"], ends["G0 out"]
    aside = (OUTSIDE - outer.x) / math.cos(outer.h)
    beside = inner.x + PARALLEL_M * math.cos(inner.h)
    for k in range(4):
        grid = _name(*_turned(k, FAR, -NEAR))
        turn = (OnRay(PARALLEL_M, 60.0, 10.0), (*_turned(k, beside, -NEAR), 22.0, 10.0))
        for place, node, bends in (("in", grid, turn), ("out", f"Z{k}", (OnRay(aside, 60.0, 10.0),))):
            gore, name, down = f"G{k} {place}", f"Ramp {k} {place}", k % 2 == 0
            middle = ends[gore].ahead(8.0 if down else -8.0)
            bridge = (f"{name} bridge", middle.x, middle.y, BRIDGE_M)
            a, b = (gore, node) if down else (node, gore)
            along = bends if down else bends[::-1]
            town.road(name, a, b, RAMP, 40, bends=along, bridges=(bridge,))


def _quays(town: TownPlan) -> None:
    """Streets that pass under the ring, and the quay that joins two of them outside."""
    for k in range(4):
        grid, corner = _name(*_turned(k, FAR, NEAR)), _name(*_turned(k, FAR, FAR))
        x, y = _turned(k, OUTSIDE, FAR)
        cross = INWARD if k % 2 == 0 else OUTWARD
        town.road(f"Quay {k} under", grid, f"Z{k}", cross, 50)
        town.road(f"Quay {k}", f"Z{k}", corner, QUAY, 40, bends=((x, y, 16.0, 8.0),))
