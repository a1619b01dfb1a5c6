"""Repairs, sealed cracks, seams, tyre marks, manhole covers and drains, as rare as on real roads."""

from collections.abc import Callable, Sequence

import numpy as np

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.road.road_events import no_events
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.fast_roads import FAST_DETAILS, FAST_SURFACE, is_fast
from carlaloc_env.scenery.roads.lane_surfaces import casting_ends
from carlaloc_env.scenery.roads.repairs import (
    COLLAR_GREY,
    COLLAR_M,
    COLLARS,
    COVER_M,
    COVER_RADIUS_M,
    PATCH_M,
    SEAL_M,
    SEAL_WIDTH_M,
    SQUARE,
    cover_rings,
    lay_cover,
    repair_surface,
)
from carlaloc_env.scenery.roads.road_events import felt_on
from carlaloc_env.scenery.roads.road_markings import beside

Interval = tuple[float, float]
"""From and to [m]."""
Spans = list[Interval]
"""From and to along the road [m]."""
Rectangle = tuple[float, float, float, float]
"""From and to along the road [m], from and to across a lane or sidewalk from its right edge [m]."""

PATCH_STEP_M, COVER_STEP_M, DRAIN_STEP_M = 110.0, 90.0, 22.0
"""Mean distances of repairs and covers on one lane, and of drains along a kerb [m]."""
CRACK_STEP_M = 80.0
"""Mean distance of sealed cracks on one lane [m]."""
SEAM_WIDTH_M, SEAM_SHARE = 0.03, 0.6
"""Width of a seam where one casting ends and the next begins [m], and share of the ends that have one."""
TYRE_MARKS = 0.15
"""Mean number of tyre marks at one end of a lane."""
TYRE_MARK_M, TYRE_WIDTH_M, TRACK_M = 30.0, 0.19, 1.5
"""Length before a road's end on which cars brake, width of a tyre's mark, and distance of the two [m]."""
CRACK_M = 0.0022
"""Height of cracks and tyre marks above the road [m]."""


def add_road_details(out: MeshBuilder, strips: Sequence[Strip], roads: Sequence[Road], seed: int) -> Array:
    """Details of all roads outside junctions; those that wheels feel, shape (N, 7)."""
    events = [no_events()]
    for strip in strips:
        if strip.junction_id is not None or strip.s_m[-1] - strip.s_m[0] < 8.0:
            continue
        draw = clock.stream(seed, f"details/{strip.road_id}/{strip.section}")
        fast = is_fast(roads[strip.road])
        painted = _painted_spans(roads[strip.road])
        bands, ends = _Bands(strip, seed), casting_ends(strip, seed)
        for lane in range(len(strip.lanes)):
            wear = _LaneWear(bands, strip, lane, painted, draw, fast=fast)
            driven = strip.lanes[lane].type == "driving"
            if strip.kind(lane) == "roadway" and driven and not strip.unpaved(lane):
                if not fast:
                    wear.covers()
                wear.patches()
                wear.cracks()
                wear.seams(ends)
                wear.tyre_marks()
            wear.drains()
        bands.lay(out)
        events += bands.events
    return np.concatenate(events)


class _Bands:
    """Thin bands and plates on one strip, gathered so that the road's table is looked at once per edge."""

    def __init__(self, strip: Strip, seed: int) -> None:
        self._strip = strip
        self._draw = clock.stream(seed, f"felt/{strip.road_id}/{strip.section}")
        self.events: list[Array] = []
        """Their events for the wheels, (1, 7) each."""
        self._found: list[tuple[int, Array, Array, Callable[[MeshBuilder, Array], None]]] = []

    def add(self, edge: int, s: Array, offset_m: Array, lay: Callable[[MeshBuilder, Array], None]) -> None:
        """Points at stations (K,), `offset_m` (K,) to the left of an edge; `lay` gets them (K, 3)."""
        self._found.append((edge, s, offset_m, lay))

    def feel(self, edge: int, kind: str, span_m: Interval, across_m: Interval) -> None:
        """Let wheels feel a rectangle, from and to along the road and to the left of an edge."""
        self.events.append(felt_on(self._strip, edge, kind, span_m, across_m, self._draw))

    def lay(self, out: MeshBuilder) -> None:
        """Lay everything in the order in which it came."""
        points: dict[int, Array] = {}
        for edge in {edge for edge, *_ in self._found}:
            parts = zip(*((s, offset) for other, s, offset, _ in self._found if other == edge), strict=True)
            points[edge] = beside(self._strip, edge, *(np.concatenate(part) for part in parts))
        used = dict.fromkeys(points, 0)
        for edge, s, _, lay in self._found:
            first = used[edge]
            used[edge] += len(s)
            lay(out, points[edge][first : used[edge]])


class _LaneWear:
    """Wear of one lane, placed at random; distances across count from its right edge."""

    def __init__(
        self, bands: _Bands, strip: Strip, lane: int, painted: Spans, draw: np.random.Generator, *, fast: bool
    ) -> None:
        self._bands, self._strip, self._lane, self._painted = bands, strip, lane, painted
        self._draw, self._share, self._surface = (
            draw,
            FAST_DETAILS if fast else 1.0,
            FAST_SURFACE if fast else None,
        )
        self._taken: list[Rectangle] = []

    def patches(self) -> None:
        """Repairs, some of them with sealed edges."""
        draw, end_m = self._draw, self._strip.s_m[-1] - 0.5
        for start in self._places(PATCH_STEP_M / self._share):
            length, width = float(draw.uniform(0.8, 6.0)), float(draw.uniform(0.7, 2.2))
            room = self._room(start, start + length) - width - 0.5
            side = 0.25 + float(draw.random()) * max(room, 0.0)
            material, grey, sealed = repair_surface(draw, self._surface)
            if room <= 0.0 or start + length > end_m or self._is_painted(start, start + length):
                continue
            span, across = (start, start + length), (side, side + width)
            rim = (span[0] - SEAL_WIDTH_M, span[1] + SEAL_WIDTH_M)
            wide = (across[0] - SEAL_WIDTH_M, across[1] + SEAL_WIDTH_M)
            if not self._take((*rim, *wide)):
                continue
            if sealed:
                self._sheet(rim, wide, SEAL_M, Material.PLAIN, 7.0)
            self._sheet(span, across, PATCH_M, material, grey)
            self._bands.feel(self._lane + 1, "patch", span, across)

    def covers(self) -> None:
        """Round covers, some of them set in a square of younger asphalt."""
        draw, bands, edge, s_m = self._draw, self._bands, self._lane + 1, self._strip.s_m
        half, lid = 0.5 * COLLAR_M, COVER_RADIUS_M * SQUARE
        for start in self._places(COVER_STEP_M):
            room = self._room(start - 0.5, start + 0.5)
            across = float(draw.uniform(0.35, 0.65)) * room
            inside = s_m[0] + 1.0 < start < s_m[-1] - 1.0
            if room < 2.0 or self._is_painted(start - 0.4, start + 0.4) or not inside:
                continue
            span, sides = (start - half, start + half), (across - half, across + half)
            if not self._take((*span, *sides)):
                continue
            rings = cover_rings()
            bands.add(edge, start + rings[:, 0], across + rings[:, 1], lay_cover)
            bands.feel(edge, "cover", (start - lid, start + lid), (across - lid, across + lid))
            if draw.random() < COLLARS and half + 0.1 < across < room - half - 0.1:
                self._sheet(span, sides, PATCH_M, Material.ASPHALT, float(draw.uniform(*COLLAR_GREY)))

    def cracks(self) -> None:
        """Cracks sealed with bitumen, wandering along the lane."""
        draw = self._draw
        for start in self._places(CRACK_STEP_M / self._share):
            length, width = float(draw.uniform(2.0, 9.0)), float(draw.uniform(0.035, 0.075))
            room = self._room(start, start + length)
            side = float(draw.uniform(0.15, 0.85)) * room
            steps = np.linspace(0.0, length, max(4, int(length / 0.6)))
            wander = np.cumsum(draw.normal(0.0, 0.09, len(steps)))
            if room > 2.0 and start + length < self._strip.s_m[-1] - 0.3:
                across = np.clip(side + wander, 0.12, room - 0.12)
                self._ribbon(start + steps, across, width, Material.PLAIN, 6.0)

    def seams(self, ends_m: Array) -> None:
        """Seams across the lane between castings."""
        for start in ends_m[self._draw.random(len(ends_m)) < SEAM_SHARE]:
            room = self._room(start - 0.3, start + 0.3)
            if room > 2.0:
                span = (start - 0.5 * SEAM_WIDTH_M, start + 0.5 * SEAM_WIDTH_M)
                self._sheet(span, (0.02, room - 0.02), CRACK_M, Material.PLAIN, 12.0)
                self._bands.feel(self._lane + 1, "seam", span, (0.02, room - 0.02))

    def tyre_marks(self) -> None:
        """Pairs of dark streaks where cars brake before the road's end."""
        draw, strip = self._draw, self._strip
        for _ in range(int(draw.poisson(TYRE_MARKS))):
            length, gone = float(draw.uniform(5.0, 14.0)), float(draw.uniform(1.0, TYRE_MARK_M - 14.0))
            ahead = strip.forward(self._lane)
            start = strip.s_m[-1] - gone - length if ahead else strip.s_m[0] + gone
            if start < strip.s_m[0] + 0.5 or start + length > strip.s_m[-1] - 0.5:
                continue
            room = self._room(start, start + length)
            if room < TRACK_M + 1.0:
                continue
            side = 0.5 * (room - TRACK_M) + float(draw.uniform(-0.25, 0.25))
            steps = np.linspace(0.0, length, max(4, int(length / 2.0)))
            veer = float(draw.normal(0.0, 0.12)) * (steps / length) ** 2
            grey = float(draw.uniform(105.0, 150.0))
            for offset in (0.0, TRACK_M):
                across = np.clip(side + offset + veer, 0.12, room - 0.12)
                self._ribbon(start + steps, across, TYRE_WIDTH_M, self._surface or Material.ASPHALT, grey)

    def drains(self) -> None:
        """Gratings in the roadway along kerbs."""
        strip, lane = self._strip, self._lane
        if strip.kind(lane) != "roadway" or strip.unpaved(lane):
            return
        width = (strip.t_m[lane] - strip.t_m[lane + 1]).min()
        for other, left in ((lane - 1, True), (lane + 1, False)):
            if not 0 <= other < len(strip.lanes) or strip.kind(other) != "sidewalk" or width < 0.25:
                continue
            low, high = (width - 0.38, width - 0.04) if left else (0.04, 0.38)
            across = (max(low, 0.02), min(high, width - 0.02))
            for start in self._places(DRAIN_STEP_M):
                if start + 0.6 < strip.s_m[-1] - 0.5:
                    self._sheet((start, start + 0.55), across, COVER_M, Material.PLAIN, 13.0)

    def _ribbon(self, s: Array, across_m: Array, width_m: float, material: Material, grey: float) -> None:
        """A thin band along the lane, whose middle lies at `across_m` (N,)."""
        sides = (across_m - 0.5 * width_m, across_m + 0.5 * width_m)
        uv = np.stack([np.stack([offset, s], axis=-1) for offset in sides], axis=1)
        self._band(s, sides, CRACK_M, material, uv, grey)

    def _sheet(
        self, span_m: Interval, across_m: Interval, height_m: float, material: Material, grey: float
    ) -> None:
        """A thin rectangle on the lane."""
        s_m = self._strip.s_m
        inner = s_m[(s_m > span_m[0] + 1e-3) & (s_m < span_m[1] - 1e-3)]
        s = np.concatenate([[span_m[0]], inner, [span_m[1]]])
        uv = np.stack(np.broadcast_arrays(np.array(across_m)[None] + 0.7, s[:, None] + 0.4), axis=-1)
        sides = (np.full(len(s), across_m[0]), np.full(len(s), across_m[1]))
        self._band(s, sides, height_m, material, uv, grey)

    def _band(
        self,
        s: Array,
        sides_m: tuple[Array, Array],
        lift_m: float,
        material: Material,
        uv: Array,
        grey: float,
    ) -> None:
        def lay(out: MeshBuilder, points: Array) -> None:
            rows = np.stack([points[: len(s)], points[len(s) :]], axis=1)
            rows[..., 2] += lift_m
            out.grid(rows, material=material, tag=Tag.ROAD, uv_m=uv, colour=(grey, grey, grey))

        self._bands.add(self._lane + 1, np.concatenate([s, s]), np.concatenate(sides_m), lay)

    def _places(self, step_m: float) -> Array:
        """Stations about one per `step_m`, at random."""
        start, length = self._strip.s_m[0], self._strip.s_m[-1] - self._strip.s_m[0]
        count = int(self._draw.poisson(length / step_m))
        places: Array = np.sort(start + 0.5 + self._draw.random(count) * (length - 1.0))
        return places

    def _room(self, start: float, end: float) -> float:
        """Least width of the lane between two stations [m]."""
        strip, lane = self._strip, self._lane
        at = [start, 0.5 * (start + end), end]
        return float(np.interp(at, strip.s_m, strip.t_m[lane] - strip.t_m[lane + 1]).min())

    def _take(self, place: Rectangle) -> bool:
        """Whether a place is free; it is taken from now on."""
        s0, s1, t0, t1 = place
        free = not any(a < s1 and s0 < b and c < t1 and t0 < d for a, b, c, d in self._taken)
        if free:
            self._taken.append(place)
        return free

    def _is_painted(self, start: float, end: float) -> bool:
        return any(low < end and start < high for low, high in self._painted)


def _painted_spans(road: Road) -> Spans:
    """Stations [m] of crosswalks, stop lines and arrows, whose paint needs the bare road."""
    return [
        (item.s_m - item.length_m / 2 - 0.6, item.s_m + item.length_m / 2 + 0.6)
        for item in road.objects
        if item.type in ("crosswalk", "roadMark", "-1")
    ]
