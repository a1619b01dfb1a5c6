"""All roads of a map as one graph of samples, so that a level can be followed over roads and junctions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from carlaloc_env.core.areas import Area, polygons_of, strip_polygon
from carlaloc_env.core.array_types import Array, Index, Mask
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.scenery.ground.lane_strips import PAVED, Strip

APART_M = 3.0
"""Roads that cross with at least this height between them are on different levels [m]."""
JOINED_M, JOINED_HEIGHT_M = 0.3, 1.0
"""Ends of roads this near to another road, in plan and in height, are joined to it [m]."""
_STEP_M = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """A place where one road passes over another."""

    low: int
    """Sample of the lower road."""
    high: int
    """Sample of the upper road."""
    point_m: tuple[float, float]
    """World x and y [m]."""


class RoadGraph:
    """Samples of all strips, a metre apart; rows of one strip follow each other with growing s."""

    def __init__(self, strips: Sequence[Strip]) -> None:
        lines = [outer_lines(strip) for strip in strips]
        counts = [0 if line is None else len(line[0]) for line in lines]
        kept = [line for line in lines if line is not None]
        self.first: Index = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        """First row of each strip and the number of all rows, (K + 1,)."""
        self.strip: Index = np.repeat(np.arange(len(strips)), counts)
        """Strip of each row, (M,)."""
        self.s_m: Array = np.concatenate([line[0] for line in kept]) if kept else np.zeros(0)
        """Station of each row [m], (M,)."""
        self.left_m: Array = np.concatenate([line[1] for line in kept]) if kept else np.zeros((0, 3))
        """Left edge of the paved part at its top [m], (M, 3)."""
        self.right_m: Array = np.concatenate([line[2] for line in kept]) if kept else np.zeros((0, 3))
        """Right edge [m], (M, 3)."""
        self.middle_m: Array = 0.5 * (self.left_m + self.right_m)
        """Between both edges [m], (M, 3)."""
        self.junction: Mask = np.array([strip.junction_id is not None for strip in strips], dtype=bool)[
            self.strip
        ]
        """Whether a row lies in a junction, (M,)."""
        self.prints: list[Area] = [
            strip_polygon(self.left_m[a:b], self.right_m[a:b]) if b - a > 1 else shapely.Polygon()
            for a, b in zip(self.first[:-1], self.first[1:], strict=True)
        ]
        """Plan-view areas of the strips."""
        self._links = self._joined(strips)

    def rows(self, strip: int) -> slice:
        """Rows of one strip."""
        return slice(int(self.first[strip]), int(self.first[strip + 1]))

    def neighbours(self, row: int) -> Index:
        """Rows that are joined to one row."""
        ends = self._links.indptr
        return np.asarray(self._links.indices[ends[row] : ends[row + 1]], dtype=np.int64)

    def component(self, mask: Mask, row: int) -> Mask:
        """Rows that can be reached from one row over rows that hold `mask`, (M,)."""
        members = np.flatnonzero(mask)
        _, label = connected_components(self._links[members][:, members], directed=False)
        result = np.zeros(len(mask), dtype=bool)
        place = np.searchsorted(members, row)
        if place < len(members) and members[place] == row:
            result[members[label == label[place]]] = True
        return result

    def leads_out(self, mask: Mask) -> bool:
        """Whether rows that hold `mask` are joined to any that do not."""
        return bool((~mask[self._links[np.flatnonzero(mask)].indices]).any())

    def nearest(self, strip: int, xy_m: Array) -> int:
        """Row of a strip that is nearest to a point in plan."""
        rows = self.rows(strip)
        gap = self.middle_m[rows, :2] - xy_m
        return int(rows.start) + int(np.argmin(np.sum(gap * gap, axis=1)))

    def crossings(self, strips: Sequence[Strip]) -> list[Crossing]:
        """All places where roads pass over each other."""
        prints = np.array(self.prints, dtype=object)
        pairs = shapely.STRtree(prints).query(prints, predicate="intersects").T
        pairs = np.unique(np.sort(pairs[pairs[:, 0] < pairs[:, 1]], axis=1), axis=0)
        low, high = self._heights()
        # Roads of one height cannot pass over each other; this leaves few pairs for the polygon work.
        apart = np.maximum(high[pairs[:, 0]] - low[pairs[:, 1]], high[pairs[:, 1]] - low[pairs[:, 0]])
        crossings = []
        for a, b in pairs[apart >= APART_M]:
            same = strips[a].junction_id is not None and strips[a].junction_id == strips[b].junction_id
            if (strips[a].road == strips[b].road and a == b) or same:
                continue
            for part in polygons_of(shapely.intersection(prints[a], prints[b])):
                crossing = self._crossing(int(a), int(b), part)
                if crossing is not None:
                    crossings.append(crossing)
        return crossings

    def _crossing(self, a: int, b: int, common: Area) -> Crossing | None:
        if common.area < 2.0:
            return None
        point = shapely.get_coordinates(shapely.centroid(common))[0]
        i, j = self.nearest(a, point), self.nearest(b, point)
        z_i, z_j = self.middle_m[i, 2], self.middle_m[j, 2]
        if abs(z_i - z_j) < APART_M:
            return None
        low, high = (i, j) if z_i < z_j else (j, i)
        return Crossing(low=low, high=high, point_m=(float(point[0]), float(point[1])))

    def _heights(self) -> tuple[Array, Array]:
        """Lowest and highest point of every strip [m]."""
        low, high = np.full(len(self.prints), np.inf), np.full(len(self.prints), -np.inf)
        np.minimum.at(low, self.strip, self.middle_m[:, 2])
        np.maximum.at(high, self.strip, self.middle_m[:, 2])
        return low, high

    def _joined(self, strips: Sequence[Strip]) -> csr_matrix:
        inner = np.flatnonzero(np.diff(self.strip) == 0)
        pairs = [np.stack([inner, inner + 1])]
        ends = np.array(
            [
                row
                for k in range(len(strips))
                for row in (self.first[k], self.first[k + 1] - 1)
                if self.first[k + 1] > self.first[k]
            ],
            dtype=np.int64,
        )
        if len(ends):
            tree = shapely.STRtree(np.array(self.prints, dtype=object))
            bars = shapely.linestrings(np.stack([self.left_m[ends, :2], self.right_m[ends, :2]], axis=1))
            for end, other in tree.query(bars, predicate="dwithin", distance=JOINED_M).T:
                row = int(ends[end])
                if other == self.strip[row]:
                    continue
                there = self.nearest(int(other), self.middle_m[row, :2])
                if abs(self.middle_m[there, 2] - self.middle_m[row, 2]) < JOINED_HEIGHT_M:
                    pairs.append(np.array([[row], [there]]))
        a, b = np.concatenate(pairs, axis=1)
        ones = np.ones(2 * len(a), dtype=np.int8)
        size = len(self.strip)
        return csr_matrix((ones, (np.concatenate([a, b]), np.concatenate([b, a]))), shape=(size, size))


def outer_lines(strip: Strip) -> tuple[Array, Array, Array] | None:
    """Stations s (N,) and outer edges of the paved part at its top (N, 3), a point per metre or less."""
    span = strip.span(PAVED)
    if span is None:
        return None
    s = np.linspace(strip.s_m[0], strip.s_m[-1], max(2, int(np.ptp(strip.s_m) / _STEP_M) + 2))
    edges = strip.lane_edges(span[0])[0], strip.lane_edges(span[1] - 1)[1]
    return s, interpolated(s, strip.s_m, edges[0]), interpolated(s, strip.s_m, edges[1])


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Half-open ranges of rows in which a mask holds."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(change[::2], change[1::2], strict=True)]


def grown(mask: Mask, rows: int = 1) -> Mask:
    """The mask with some more rows at both ends of each run."""
    wide = mask.copy()
    for step in range(1, rows + 1):
        wide[step:] |= mask[:-step]
        wide[:-step] |= mask[step:]
    return wide
