"""Roads as strips of lanes: lane edges in the world at stations as dense as their bends need."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import strip_polygon, union
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.opendrive.records import LaneRecord, Road
from carlaloc_env.map.opendrive.road_surface import RoadSurface

ROADWAY = frozenset(
    {
        "driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane", "bidirectional",
        "stop", "biking", "parking", "shoulder", "bus", "taxi", "HOV", "restricted", "special1", "special2",
        "special3", "mwyEntry", "mwyExit", "tram", "rail", "roadWorks",
    }
)  # fmt: skip
"""Lane types that lie at road level."""
SIDEWALK = frozenset({"sidewalk", "walking", "curb"})
"""Lane types that are raised and paved."""
MEDIAN = frozenset({"median"})
"""Lane types between the carriageways."""

UNPAVED = {
    "gravel": "gravel", "dirt": "soil", "soil": "soil", "earth": "soil", "mud": "soil", "sand": "soil",
    "grass": "grass", "unpaved": "gravel",
}  # fmt: skip
"""Kinds of unpaved surfaces by the names in the map's lane materials."""
KERB_M = 0.15
"""Height of sidewalks and medians above the road where the map does not say [m]."""
CHORD_M = 0.003
"""Largest distance between the surface and the straight edges of its triangles [m]."""
LONGEST_STEP_M, RELIEF_STEP_M = 5.0, 2.5
"""Longest distance between stations, and on relief, whose shortest waves are four times as long [m]."""
OVERLAP_M2 = 2.0
"""Roads of a junction that overlap by less than this lie side by side [m²]."""
PARTING_RAD = 0.6
"""Roads that turn by more than this have corners to be filled [rad]."""
PAVED = ("roadway", "sidewalk", "median")
"""Kinds of lanes that belong to a road's body, which bridges and cuttings carry."""
SAMPLE_M = 0.25
"""Distance of samples along a road, before those on straights are left out [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Strip:
    """One lane section of one road: B lane edges from left to right at N stations."""

    road: int
    """Number of the road in the file."""
    section: int
    """Number of the section in the road."""
    road_id: str
    """Id of the road."""
    junction_id: str | None
    """Junction that the road belongs to."""
    lanes: tuple[LaneRecord, ...]
    """Lanes from left to right, without the centre lane, B − 1 of them."""
    s_m: Array
    """Stations along the road's reference line [m], shape (N,)."""
    t_m: Array
    """Lane edges to the left of the reference line [m], shape (B, N)."""
    edges_m: Array
    """Lane edges on the road surface, world [m], shape (B, N, 3)."""
    raised_m: Array
    """Height of each lane above the road surface at its left and right edge [m], shape (B − 1, 2, N)."""
    left_hand_traffic: bool
    """Whether traffic keeps to the left."""

    def forward(self, lane: int) -> bool:
        """Whether traffic on a lane of the strip runs with growing s."""
        return (self.lanes[lane].id < 0) != self.left_hand_traffic

    def kind(self, lane: int) -> str:
        """Kind of a lane of the strip: roadway, sidewalk, median or none."""
        name = self.lanes[lane].type
        if name in ROADWAY:
            return "roadway"
        if name in SIDEWALK:
            return "sidewalk"
        return "median" if name in MEDIAN else "none"

    def unpaved(self, lane: int) -> str:
        """`gravel`, `soil` or `grass` where no asphalt lies on a lane; empty elsewhere."""
        records = self.lanes[lane].materials
        middle = 0.5 * (self.s_m[0] + self.s_m[-1])
        surfaces = [record.surface for record in records if record.s_m <= middle + 1e-6]
        return UNPAVED.get(surfaces[-1], "") if surfaces else ""

    def lane_edges(self, lane: int, *, top: bool = True) -> tuple[Array, Array]:
        """Left and right edge of a lane [m], (N, 3) each, on its raised top or on the road surface."""
        left, right = self.edges_m[lane].copy(), self.edges_m[lane + 1].copy()
        if top:
            left[:, 2] += self.raised_m[lane, 0]
            right[:, 2] += self.raised_m[lane, 1]
        return left, right

    def span(self, kinds: Sequence[str]) -> tuple[int, int] | None:
        """First and last edge of the lanes of these kinds; None without such lanes."""
        lanes = [lane for lane in range(len(self.lanes)) if self.kind(lane) in kinds]
        return (lanes[0], lanes[-1] + 1) if lanes else None


def road_strips(
    roads: Sequence[Road], surface: RoadSurface, only: Collection[str] | None = None
) -> list[Strip]:
    """Strips of all roads, or of those with these ids, in file order.

    Where the roads of a junction only lie side by side, as at the exits and merges of a motorway, they are
    drawn as plain roads: their strips name no junction.
    """
    strips = []
    for number, road in enumerate(roads):
        for section in range(len(road.sections) if only is None or road.id in only else 0):
            strip = _strip(road, number, section, surface)
            if strip is not None:
                strips.append(strip)
    plain = _partings(strips)
    return [replace(strip, junction_id=None) if strip.junction_id in plain else strip for strip in strips]


def _partings(strips: Sequence[Strip]) -> frozenset[str]:
    """Junctions of several roads that nowhere overlap, and where no sidewalk needs to turn a corner."""
    groups: dict[str, list[Strip]] = {}
    for strip in strips:
        if strip.junction_id is not None:
            groups.setdefault(strip.junction_id, []).append(strip)
    partings = []
    for name, group in groups.items():
        if len(group) < 2 or any(abs(_turn_rad(strip)) > PARTING_RAD for strip in group):
            continue
        areas = []
        for strip in group:
            span = strip.span(("roadway",))
            if span is not None:
                areas.append(strip_polygon(strip.edges_m[span[0]], strip.edges_m[span[1]]))
        total = sum(area.area for area in areas)
        if total - union(areas).area < min(OVERLAP_M2, 0.01 * total):
            partings.append(name)
    return frozenset(partings)


def _turn_rad(strip: Strip) -> float:
    """Heading change between both ends of a strip [rad], without its sign."""
    first, last = strip.edges_m[0, 1] - strip.edges_m[0, 0], strip.edges_m[0, -1] - strip.edges_m[0, -2]
    cosine = float(first[0] * last[0] + first[1] * last[1]) / max(
        float(np.hypot(*first[:2]) * np.hypot(*last[:2])), 1e-12
    )
    return float(elementary.arccos(np.clip(cosine, -1.0, 1.0)))


def _strip(road: Road, number: int, section: int, surface: RoadSurface) -> Strip | None:
    record = road.sections[section]
    start, end = record.s_m, min(record.end_m, road.length_m)
    lanes = tuple(lane for lane in record.lanes if lane.id != 0)
    if end - start < 1e-3 or not lanes:
        return None
    # The very end belongs to the next section's records: stay a hair inside.
    inside = end - min(1e-6, (end - start) * 1e-3)
    ids = np.array([surface.edges.index[number, section, lane.id] for lane in lanes], dtype=np.int64)
    dense = np.linspace(start, inside, max(9, int((end - start) / SAMPLE_M) + 1))
    longest = LONGEST_STEP_M if surface.relief is None else RELIEF_STEP_M
    s = _stations(dense, _edges(number, lanes, ids, dense, surface)[1], longest)
    t, edges = _edges(number, lanes, ids, s, surface)
    return Strip(
        road=number,
        section=section,
        road_id=road.id,
        junction_id=road.junction_id,
        lanes=lanes,
        s_m=s,
        t_m=t,
        edges_m=edges,
        raised_m=_raised(lanes, ids, s, surface),
        left_hand_traffic=road.left_hand_traffic,
    )


def _edges(
    road: int, lanes: tuple[LaneRecord, ...], ids: NDArray[np.int64], s: Array, surface: RoadSurface
) -> tuple[Array, Array]:
    """Lane edges t (B, N) and world points (B, N, 3) at stations."""
    count = len(s)
    outer = surface.edges.outer(np.repeat(ids, count), np.tile(s, len(ids))).t_m.reshape(len(ids), count)
    centre = surface.edges.lane_offset(np.full(count, road), s).t_m
    left = [k for k, lane in enumerate(lanes) if lane.id > 0]
    right = [k for k, lane in enumerate(lanes) if lane.id < 0]
    t = np.concatenate([outer[left], centre[None], outer[right]])
    # Negative widths in a file would fold the surface over itself.
    for k in range(len(left) - 1, -1, -1):
        t[k] = np.maximum(t[k], t[k + 1])
    for k in range(len(left) + 1, len(t)):
        t[k] = np.minimum(t[k], t[k - 1])
    points = surface.position(np.full(t.size, road), np.tile(s, len(t)), t.ravel())
    return t, points.reshape(len(t), count, 3)


def _stations(dense: Array, edges: Array, longest_m: float) -> Array:
    """Stations whose chords stay within `CHORD_M` of every lane edge (sagitta = d²·curvature/8)."""
    step = dense[1] - dense[0]
    bend = np.linalg.norm(edges[:, 2:] - 2.0 * edges[:, 1:-1] + edges[:, :-2], axis=-1).max(axis=0) / step**2
    bend = np.maximum(np.pad(bend, 1, mode="edge"), 8.0 * CHORD_M / longest_m**2)
    bend = np.maximum(bend, np.maximum(np.roll(bend, 1), np.roll(bend, -1)))
    density = np.sqrt(bend / (8.0 * CHORD_M))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * step)])
    count = int(np.ceil(total[-1] - 1e-9)) + 1
    stations = np.interp(np.linspace(0.0, total[-1], max(count, 2)), total, dense)
    stations[0], stations[-1] = dense[0], dense[-1]
    result: Array = stations
    return result


def _raised(lanes: tuple[LaneRecord, ...], ids: NDArray[np.int64], s: Array, surface: RoadSurface) -> Array:
    raised = np.zeros((len(lanes), 2, len(s)))
    for k, lane in enumerate(lanes):
        if lane.heights:
            inner, outer, _, _ = surface.edges.heights(np.full(len(s), ids[k]), s)
            raised[k] = (outer, inner) if lane.id > 0 else (inner, outer)
        elif lane.type in SIDEWALK or lane.type in MEDIAN:
            raised[k] = KERB_M
    return raised
