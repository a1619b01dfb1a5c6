"""Lids and mended places in sidewalks, as rare as on real ones."""

from collections.abc import Sequence

import numpy as np

from carlaloc_env.core import clock
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.road_wear import Rectangle
from carlaloc_env.scenery.roads.sidewalks import FLARE_M, KERB_STONE_M, raised_runs, run_edges

MENDED_M2, LID_M2 = 160.0, 70.0
"""Area of sidewalk for each mended place and for each lid [m²]."""
SLAB_M = (0.6, 0.4)
"""Slabs across and along the sidewalk [m]; every second row lies half a slab aside."""
LIFT_M = 0.0014
"""Height of all of it above the slabs [m]."""
FRAME_M = 0.045
"""Width of a lid's frame [m]."""
NARROWEST_M = 1.3
"""Narrower sidewalks stay bare [m]."""
SHORTEST_M = 4.0
"""Shorter ones stay bare [m]."""
_FRAME, _IRON = (150.0, 148.0, 140.0), (13.0, 12.5, 12.0)


def add_sidewalk_wear(out: MeshBuilder, strips: Sequence[Strip], roads: Sequence[Road], seed: int) -> None:
    """Details of all sidewalks outside junctions; none where kerbs are dropped."""
    for strip in strips:
        if strip.junction_id is not None:
            continue
        draw = clock.stream(seed, f"pavement details/{strip.road_id}/{strip.section}")
        dropped = [
            (item.s_m - 0.5 * item.length_m - FLARE_M - 0.3, item.s_m + 0.5 * item.length_m + FLARE_M + 0.3)
            for item in roads[strip.road].objects
            if item.type == "crosswalk"
        ]
        for first, last in raised_runs(strip):
            if strip.kind(first) == "sidewalk":
                _Run(strip, first, last, dropped).lay(out, draw)


class _Run:
    """Neighbouring lanes of sidewalk between two lines."""

    def __init__(self, strip: Strip, first: int, last: int, dropped: Sequence[tuple[float, float]]) -> None:
        left, right = run_edges(strip, first, last)
        self._s, self._right, self._across = strip.s_m, right, left - right
        width = np.sqrt(np.sum(self._across[:, :2] ** 2, axis=1))
        self._across /= np.maximum(width, 1e-6)[:, None]
        kerbs = (
            last < len(strip.lanes) - 1 and strip.kind(last + 1) == "roadway",
            first > 0 and strip.kind(first - 1) == "roadway",
        )
        self._low_m = KERB_STONE_M * kerbs[0]
        self._high_m = float(width.min()) - KERB_STONE_M * kerbs[1]
        self._dropped = dropped

    def lay(self, out: MeshBuilder, draw: np.random.Generator) -> None:
        """Lay mended places and lids, none over another."""
        length, width = self._s[-1] - self._s[0], self._high_m - self._low_m
        area = length * width
        if width < NARROWEST_M or length < SHORTEST_M:
            return
        taken: list[Rectangle] = []
        for _ in range(int(draw.poisson(area / LID_M2))):
            lid = self._lid(draw)
            if self._free(lid, taken):
                inner = (lid[0] + FRAME_M, lid[1] - FRAME_M, lid[2] + FRAME_M, lid[3] - FRAME_M)
                self._quad(out, lid, LIFT_M, Material.CONCRETE, _FRAME)
                self._quad(out, inner, LIFT_M + 0.0005, Material.PLAIN, _IRON)
        for _ in range(int(draw.poisson(area / MENDED_M2))):
            grey = float(draw.uniform(85.0, 165.0))
            for slab in self._slabs(draw):
                if self._free(slab, taken):
                    self._quad(out, slab, LIFT_M, Material.ASPHALT, (grey, grey, grey))

    def _lid(self, draw: np.random.Generator) -> Rectangle:
        """Of water, gas, telephone or electricity."""
        sizes = ((0.30, 0.30), (0.45, 0.35), (0.70, 0.50), (0.90, 0.60), (1.20, 0.60))
        long, wide = sizes[int(draw.integers(len(sizes)))]
        s = float(draw.uniform(self._s[0] + 0.3, self._s[-1] - 0.3 - long))
        across = float(draw.uniform(self._low_m + 0.15, self._high_m - 0.15 - wide))
        return s, s + long, across, across + wide

    def _slabs(self, draw: np.random.Generator) -> list[Rectangle]:
        """Up to four neighbouring slabs in two rows, whose place asphalt has taken."""
        first, last = int(self._s[0] / SLAB_M[1]) + 1, int(self._s[-1] / SLAB_M[1]) - 2
        row = int(draw.integers(first, last + 1))
        columns = int((self._high_m - self._low_m) / SLAB_M[0])
        column = int(draw.integers(0, max(columns - 1, 1)))
        slabs = []
        for k in range(int(draw.integers(1, 3))):
            begin = self._low_m + SLAB_M[0] * (column - 0.5 * ((row + k) % 2))
            end = begin + SLAB_M[0] * int(draw.integers(1, 3))
            low, high = max(begin, self._low_m), min(end, self._high_m)
            slabs.append(((row + k) * SLAB_M[1], (row + k + 1) * SLAB_M[1], low, high))
        return slabs

    def _free(self, place: Rectangle, taken: list[Rectangle]) -> bool:
        """Whether a place lies on slabs and on nothing else; it is taken from now on."""
        s0, s1, t0, t1 = place
        outside = s0 < self._s[0] or s1 > self._s[-1] or t1 - t0 < 0.15
        dropped = any(low < s1 and s0 < high for low, high in self._dropped)
        if outside or dropped or any(a < s1 and s0 < b and c < t1 and t0 < d for a, b, c, d in taken):
            return False
        taken.append((s0 + 1e-3, s1 - 1e-3, t0 + 1e-3, t1 - 1e-3))
        return True

    def _quad(
        self, out: MeshBuilder, place: Rectangle, lift_m: float, material: Material, colour: Sequence[float]
    ) -> None:
        s0, s1, t0, t1 = place
        s, across = np.array([s0, s1, s1, s0]), np.array([t0, t0, t1, t1])
        points = interpolated(s, self._s, self._right)
        points += across[:, None] * interpolated(s, self._s, self._across)
        points[:, 2] += lift_m
        uv = np.stack([across, s], axis=-1)
        out.quads(points[None], material=material, tag=Tag.SIDEWALK, uv_m=uv[None], colour=colour)
