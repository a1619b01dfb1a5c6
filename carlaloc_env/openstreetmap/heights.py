"""Heights of streets that pass over each other: a linear programme over points along all of them.

OpenStreetMap knows the order of bridges and tunnels (`layer`), not their heights. Streets rise and fall as
little as clearances, grades and vertical curves allow.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import coo_matrix

from carlaloc_env.authoring.geometry.elevation import Record, hermite, level
from carlaloc_env.authoring.geometry.plan_view_curves import Path
from carlaloc_env.core.array_types import Array
from carlaloc_env.openstreetmap.clusters import Cluster, half_width
from carlaloc_env.openstreetmap.road_graph import Chain
from carlaloc_env.openstreetmap.road_network import Crossing, Heights

CLEAR_M = 5.9
"""Height of a street above another that it crosses: 4.5 m are free, the rest is deck [m]."""
STEEPEST = 0.085
"""Steepest grade between two points; curves through them reach a tenth."""
STEP_M = 8.0
"""Distance of the points [m]."""
FAST_KMH = 65.0
"""From this limit on vertical curves are wider [km/h]."""
RADIUS_M, FAST_RADIUS_M = 260.0, 800.0
"""Least radius of vertical curves of other and of fast streets [m]."""
HIGHEST_M, DEEPEST_M = 20.0, -12.0
_SLACK_COST, _BEND_COST = 2000.0, 30.0


@dataclass(slots=True)
class LayeredHeights(Heights):
    """Heights at points along every chain, level at its junctions."""

    stations: dict[int, Array] = field(default_factory=dict)
    values: dict[int, Array] = field(default_factory=dict)
    clusters: dict[tuple[int, ...], float] = field(default_factory=dict)

    def of_road(self, chain: int, first_m: float, path: Path) -> list[Record]:
        """Elevation of a chain's road, which begins at `first_m`."""
        if chain not in self.values or np.ptp(self.values[chain]) < 1e-6:
            return level(0.0 if chain not in self.values else round(float(self.values[chain][0]), 6))
        s, z = self.stations[chain], self.values[chain]
        inner = s[(s > first_m + 1.0) & (s < first_m + path.length - 1.0)]
        knots = np.concatenate([[first_m], inner, [first_m + path.length]])
        heights = np.interp(knots, s, z)
        slope = np.gradient(heights, knots)
        slope[[0, -1]] = 0.0
        knots = np.round(knots - first_m, 6)
        records: list[Record] = []
        for k in range(len(knots) - 1):
            ends = (round(float(heights[k]), 6), float(slope[k]), round(float(heights[k + 1]), 6))
            piece = hermite(*ends, float(slope[k + 1]), float(knots[k + 1] - knots[k]))[0]
            records.append((float(knots[k]), *piece[1:]))
        return records

    def of_cluster(self, cluster: Cluster) -> float:
        """Height of a junction [m]."""
        return self.clusters.get(tuple(sorted(cluster.nodes)), 0.0)


def find_heights(
    chains: Sequence[Chain], clusters: Sequence[Cluster], rails: Sequence[tuple[Array, int]]
) -> Heights:
    """Heights of all streets; a flat town where none crosses another.

    Args:
        chains: Streets.
        clusters: Their junctions.
        rails: Railways with their layers.
    """
    crossings = find_crossings(chains, rails)
    if not crossings:
        return Heights()
    return _Programme(chains, clusters, crossings).solve()


def find_crossings(chains: Sequence[Chain], rails: Sequence[tuple[Array, int]]) -> list[Crossing]:
    """Places where streets of different layers cross without meeting."""
    lines = [shapely.LineString(chain.line) for chain in chains]
    found = []
    tree = shapely.STRtree(lines)
    for a, b in sorted((int(a), int(b)) for a, b in tree.query(lines, predicate="intersects").T if a < b):
        common = set(chains[a].nodes) & set(chains[b].nodes)
        meets = [chains[a].line[chains[a].nodes.index(node)] for node in common]
        for x, y in _points(lines[a].intersection(lines[b])):
            if any(np.hypot(x - p, y - q) < 1.0 for p, q in meets):
                continue
            over = _level_at(chains[a], lines[a], x, y) - _level_at(chains[b], lines[b], x, y)
            if over:
                upper, lower = (a, b) if over > 0 else (b, a)
                found.append(Crossing(upper, lower, x, y))
    for line, layer in rails:
        rail = shapely.LineString(line)
        for k in sorted(int(k) for k in tree.query(rail, predicate="intersects")):
            for x, y in _points(lines[k].intersection(rail)):
                own = _level_at(chains[k], lines[k], x, y)
                over = own - layer
                # Bridges of railways are not built: streets below them stay level.
                if over > 0 or own < min(layer, 0):
                    found.append(Crossing(k if over > 0 else None, None if over > 0 else k, x, y))
    return found


def _points(shape: shapely.Geometry) -> list[tuple[float, float]]:
    return [
        (float(x), float(y)) for x, y in shapely.get_coordinates(shapely.centroid(shapely.get_parts(shape)))
    ]


def _level_at(chain: Chain, line: shapely.LineString, x: float, y: float) -> int:
    at = shapely.line_locate_point(line, shapely.Point(x, y))
    k = int(np.searchsorted(chain.stations_m, at, side="right")) - 1
    return next(
        (p.street.level for p in chain.pieces if p.first <= k < p.last), chain.pieces[-1].street.level
    )


class _Programme:
    """Variables: a height for every junction and every point between; then how far each bends and lies."""

    def __init__(
        self, chains: Sequence[Chain], clusters: Sequence[Cluster], crossings: Sequence[Crossing]
    ) -> None:
        self._chains, self._clusters, self._crossings = chains, clusters, crossings
        self._count = len(clusters)
        self._stations: dict[int, Array] = {}
        self._variables: dict[int, NDArray[np.int64]] = {}
        self._rows: list[tuple[list[int], list[float], float]] = []
        """Columns, factors and bound of every `≤`; factors of one column add up."""
        home = {(end.chain, end.side): (k, end.setback_m) for k, c in enumerate(clusters) for end in c.ends}
        inside = {chain: k for k, cluster in enumerate(clusters) for chain in cluster.inner}
        for k, chain in enumerate(chains):
            length = chain.length_m
            s = np.linspace(0.0, length, max(2, int(length / STEP_M) + 1))
            own = np.full(len(s), inside.get(k, -1))
            for side, gap in ((0, s), (1, length - s)):
                if (k, side) in home:
                    cluster, setback = home[k, side]
                    own[(gap <= setback + STEP_M + 0.5) & (own < 0)] = cluster
            free = own < 0
            own[free] = self._count + np.arange(int(free.sum()))
            self._count += int(free.sum())
            self._stations[k], self._variables[k] = s, own

    def solve(self) -> LayeredHeights:
        """The heights."""
        low = self._bounds()
        bends = self._smooth()
        slack = self._clear(bends[1])
        total = slack[1]
        cost = np.zeros(total)
        heights = self._count
        cost[bends[0] : bends[1]] = _BEND_COST
        cost[slack[0] : slack[1]] = _SLACK_COST
        # Heights above and below the ground cost alike.
        cost[:heights] = np.where(low < 0, -1.0, 1.0)
        limits: list[tuple[float, float | None]] = [
            (float(low[k]), HIGHEST_M if low[k] >= 0 else 0.0) for k in range(heights)
        ]
        limits += [(0.0, None)] * (total - heights)
        terms = [(r, c, v) for r, (cs, vs, _) in enumerate(self._rows) for c, v in zip(cs, vs, strict=True)]
        rows, columns, factors = np.array(terms).T
        places = (rows.astype(np.int64), columns.astype(np.int64))
        matrix = coo_matrix((factors, places), shape=(len(self._rows), total))
        bounds = np.array([bound for _, _, bound in self._rows])
        found = linprog(cost, A_ub=matrix.tocsr(), b_ub=bounds, bounds=limits, method="highs")  # type: ignore[call-overload]
        z = np.round(found.x if found.x is not None else np.zeros(total), 4)
        return LayeredHeights(
            stations=self._stations,
            values={k: z[own] for k, own in self._variables.items()},
            clusters={tuple(sorted(c.nodes)): float(z[k]) for k, c in enumerate(self._clusters)},
            missed=[
                (c, float(gap))
                for c, gap in zip(self._crossings, z[slack[0] : slack[1]], strict=True)
                if gap > 0.05
            ],
        )

    def _bounds(self) -> Array:
        """Lowest height of every variable: streets that lead into tunnels may sink."""
        low = np.zeros(self._count)
        sinking = {k for k, chain in enumerate(self._chains) if any(p.street.level < 0 for p in chain.pieces)}
        for k in sinking:
            own = self._variables[k]
            low[own[own >= len(self._clusters)]] = DEEPEST_M
        for n, cluster in enumerate(self._clusters):
            if sinking.issuperset({*(end.chain for end in cluster.ends), *cluster.inner}):
                low[n] = DEEPEST_M
        return low

    def _smooth(self) -> tuple[int, int]:
        """Grades and vertical curves along every chain; the range of the bends' variables."""
        first = free = self._count
        for k, chain in enumerate(self._chains):
            own, step = self._variables[k], float(self._stations[k][1])
            radius = FAST_RADIUS_M if chain.street.speed_kmh > FAST_KMH else RADIUS_M
            for a, b in itertools.pairwise(own.tolist()):
                if a != b:
                    self._rows += [([a, b], [sign, -sign], STEEPEST * step) for sign in (1.0, -1.0)]
            for a, b, c in zip(own.tolist(), own[1:].tolist(), own[2:].tolist(), strict=False):
                if a == b == c:
                    continue
                for sign in (1.0, -1.0):
                    columns, factors = [a, b, c], [sign, -2.0 * sign, sign]
                    self._rows.append((columns, factors, step * step / radius))
                    self._rows.append(([*columns, free], [*factors, -1.0], 0.0))
                free += 1
        return first, free

    def _clear(self, first: int) -> tuple[int, int]:
        """Clearances; the range of the variables of what they lack."""
        for n, crossing in enumerate(self._crossings):
            upper, lower = (self._near(k, crossing) for k in (crossing.upper, crossing.lower))
            for a in upper:
                for b in lower:
                    terms = [(c, f) for c, f in ((a, -1.0), (b, 1.0)) if c is not None]
                    self._rows.append(
                        ([*(c for c, _ in terms), first + n], [*(f for _, f in terms), -1.0], -CLEAR_M)
                    )
        return first, first + len(self._crossings)

    def _near(self, chain: int | None, crossing: Crossing) -> list[int | None]:
        """Variables of a chain's points at a crossing; None stands for a railway on the ground."""
        if chain is None:
            return [None]
        line = shapely.LineString(self._chains[chain].line)
        at = shapely.line_locate_point(line, shapely.Point(crossing.x, crossing.y))
        other = crossing.lower if chain == crossing.upper else crossing.upper
        street = None if other is None else self._chains[other].street
        reach = 4.0 if street is None else half_width(street) + max(street.walks) + 3.0
        s = self._stations[chain]
        rows = np.flatnonzero(np.abs(s - at) <= max(reach, 0.6 * float(s[1])))
        return sorted(set(self._variables[chain][rows].tolist()))  # type: ignore[arg-type]
