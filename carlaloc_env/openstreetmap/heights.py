"""Heights of streets on the land and over each other: a linear programme over points along all of them.

OpenStreetMap knows the order of bridges and tunnels (`layer`), not their heights. Streets leave the land as
little as clearances, grades and vertical curves allow.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import coo_matrix

from carlaloc_env.authoring.geometry.elevation import Record, hermite, level
from carlaloc_env.authoring.geometry.junction_planes import Plane, leaning
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Pose
from carlaloc_env.core.array_types import Array
from carlaloc_env.openstreetmap.clusters import Cluster, End, half_width
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
TILT_MAX, TILT_REACH_M = 0.06, 20.0
"""Steepest slope of a junction on sloping land, and the distance over which the land's is taken [m]."""
_SLACK_COST, _BEND_COST = 2000.0, 30.0
_LAND_BEND_COST, _STEEP_COST, _CUT_COST = 3.0, 300.0, 2.0
"""With heights of the land: a metre of bend, one beyond the limits, and one below the land rather than above
it. Bends that small smooth waves below about 60 m."""

LandHeight = Callable[[Array], Array]
"""Height of the land [m] at world points (N, 2)."""


@dataclass(slots=True)
class LayeredHeights(Heights):
    """Heights at points along every chain; its junctions are planes."""

    stations: dict[int, Array] = field(default_factory=dict)
    values: dict[int, Array] = field(default_factory=dict)
    planes: dict[tuple[int, ...], Plane] = field(default_factory=dict)
    legs: dict[tuple[int, int], tuple[Plane, float]] = field(default_factory=dict)
    """On sloping land: plane of the junction at an end of a chain (key: chain, side), and the road's end."""

    def of_road(self, chain: int, first_m: float, path: Path) -> tuple[list[Record], list[Record]]:
        """Elevation and superelevation of a chain's road, which begins at `first_m`."""
        s, z = self.stations[chain], self.values[chain]
        if not self.legs:
            if np.ptp(z) < 1e-6:
                return level(round(float(z[0]), 6)), []
            inner = s[(s > first_m + 1.0) & (s < first_m + path.length - 1.0)]
            knots = np.concatenate([[first_m], inner, [first_m + path.length]])
            heights = np.interp(knots, s, z)
            slope = np.gradient(heights, knots)
            slope[[0, -1]] = 0.0
            return _cubics(np.round(knots - first_m, 6), heights, slope, 6), []
        (first, gap), (last, rest) = self.legs[chain, 0], self.legs[chain, 1]
        between = (s > gap + 0.5) & (s < rest - 0.5)
        knots = np.round((s[between] - gap) * (path.length / (rest - gap)), 6)
        knots = np.concatenate([[0.0], knots, [path.length]])
        (z0, grade0), (z1, grade1) = first.height(path.start), last.height(path.end)
        heights = np.concatenate([[z0], z[between], [z1]])
        slope = np.gradient(heights, knots)
        slope[[0, -1]] = grade0, grade1
        tilt = leaning(first.tilt(path.start), last.tilt(path.end), path.length)
        return _cubics(knots, heights, slope, 12), tilt

    def of_cluster(self, cluster: Cluster) -> Plane:
        """Plane of a junction."""
        return self.planes[tuple(sorted(cluster.nodes))]


def _cubics(knots: Array, heights: Array, slope: Array, digits: int) -> list[Record]:
    records: list[Record] = []
    for k in range(len(knots) - 1):
        ends = (round(float(heights[k]), digits), float(slope[k]), round(float(heights[k + 1]), digits))
        piece = hermite(*ends, float(slope[k + 1]), float(knots[k + 1] - knots[k]))[0]
        records.append((float(knots[k]), *piece[1:]))
    return records


def find_heights(
    chains: Sequence[Chain],
    clusters: Sequence[Cluster],
    rails: Sequence[tuple[Array, int]],
    land: LandHeight | None = None,
) -> Heights:
    """Heights of all streets; a flat town where none crosses another and nothing is known of the land.

    Args:
        chains: Streets.
        clusters: Their junctions.
        rails: Railways with their layers.
        land: Heights of the land.
    """
    crossings = find_crossings(chains, rails)
    if not crossings and land is None:
        return Heights()
    return _Programme(chains, clusters, crossings, land).solve()


def find_crossings(chains: Sequence[Chain], rails: Sequence[tuple[Array, int]]) -> list[Crossing]:
    """Places where streets of different layers cross without meeting."""
    lines = [shapely.LineString(chain.line) for chain in chains]
    crossings = []
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
                crossings.append(Crossing(upper, lower, x, y))
    for line, layer in rails:
        rail = shapely.LineString(line)
        for k in sorted(int(k) for k in tree.query(rail, predicate="intersects")):
            for x, y in _points(lines[k].intersection(rail)):
                own = _level_at(chains[k], lines[k], x, y)
                over = own - layer
                # Bridges of railways are not built: streets below them stay level.
                if over > 0 or own < min(layer, 0):
                    crossings.append(Crossing(k if over > 0 else None, None if over > 0 else k, x, y))
    return crossings


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
        self,
        chains: Sequence[Chain],
        clusters: Sequence[Cluster],
        crossings: Sequence[Crossing],
        land: LandHeight | None,
    ) -> None:
        self._chains, self._clusters, self._crossings, self._land = chains, clusters, crossings, land
        self._count = len(clusters)
        self._stations: dict[int, Array] = {}
        self._variables: dict[int, NDArray[np.int64]] = {}
        self._ground: dict[int, Array] = {}
        """Heights of the land at the points."""
        self._rises: dict[int, Array] = {}
        """Heights of points above their variables: junctions on sloping land slope."""
        self._rows: list[tuple[list[int], list[float], float]] = []
        """Columns, factors and bound of every `≤`; factors of one column add up."""
        self._costs: list[float] = []
        """Costs of the variables after the heights: bends, and slacks of what should hold."""
        self._planes = [self._plane(cluster) for cluster in clusters]
        legs = {(end.chain, end.side): (k, end) for k, c in enumerate(clusters) for end in c.ends}
        inside = {chain: k for k, cluster in enumerate(clusters) for chain in cluster.inner}
        for k, chain in enumerate(chains):
            length = chain.length_m
            s = np.linspace(0.0, length, max(2, int(length / STEP_M) + 1))
            own = np.full(len(s), inside.get(k, -1))
            for side, gap in ((0, s), (1, length - s)):
                if (k, side) in legs:
                    cluster, end = legs[k, side]
                    own[(gap <= end.setback_m + STEP_M + 0.5) & (own < 0)] = cluster
            rise = np.zeros(len(s))
            if land is not None and (k, 0) in legs:
                s, own, rise = self._lattice(legs[k, 0], legs[k, 1], length)
            free = own < 0
            own[free] = self._count + np.arange(int(free.sum()))
            self._count += int(free.sum())
            self._stations[k], self._variables[k], self._rises[k] = s, own, rise

    def _plane(self, cluster: Cluster) -> Plane:
        """Plane through the origin of heights that slopes as the land does round a junction."""
        streets = [end.street for end in cluster.ends]
        if self._land is None or not streets or any(street.level for street in streets):
            return Plane(0.0, 0.0, 0.0)
        places = np.array([end.at(end.setback_m)[:2] for end in cluster.ends])
        x, y = places.mean(axis=0).round(3).tolist()
        reach = max(TILT_REACH_M, 0.5 * float(np.ptp(places, axis=0).max()))
        low_x, high_x, low_y, high_y = self._land(
            np.array([[x - reach, y], [x + reach, y], [x, y - reach], [x, y + reach]])
        )
        slope = np.array([high_x - low_x, high_y - low_y]) / (2.0 * reach)
        slope *= min(1.0, TILT_MAX / max(float(np.hypot(*slope)), 1e-9))
        return Plane(x, y, 0.0, *slope.round(5).tolist())

    def _lattice(
        self, first: tuple[int, End], last: tuple[int, End], length: float
    ) -> tuple[Array, NDArray[np.int64], Array]:
        """Stations of a road and one beyond each end, their junctions (−1 between), and heights in these."""
        gap, rest = first[1].setback_m, last[1].setback_m
        count = max(1, round((length - gap - rest) / STEP_M))
        step = max(length - gap - rest, 1.0) / count
        steps = np.arange(-1, count + 2, dtype=np.int64)
        own = np.where(steps <= 0, first[0], np.where(steps >= count, last[0], -1))
        rise = np.zeros(len(steps))
        for (cluster, end), rows, away in ((first, steps <= 0, steps), (last, steps >= count, count - steps)):
            z, grade = self._planes[cluster].height(Pose(*end.at(end.setback_m)))
            rise[rows] = z + grade * step * away[rows]
        return np.asarray(gap + step * steps, dtype=np.float64), own, rise

    def solve(self) -> LayeredHeights:
        """Solves the programme; gives the heights."""
        low, heights = self._bounds(), self._count
        self._smooth()
        first = len(self._costs)
        self._clear()
        missed = slice(heights + first, heights + len(self._costs))
        # Heights above and below the ground cost alike.
        cost = np.where(low < 0, -1.0, 1.0)
        limits: list[tuple[float | None, float | None]] = [
            (float(low[k]), HIGHEST_M if low[k] >= 0 else 0.0) for k in range(heights)
        ]
        if self._land is not None:
            self._follow(low)
            cost[:], limits = 0.0, [(None, None)] * heights
        cost = np.concatenate([cost, self._costs])
        limits += [(0.0, None)] * len(self._costs)
        terms = [(r, c, v) for r, (cs, vs, _) in enumerate(self._rows) for c, v in zip(cs, vs, strict=True)]
        rows, columns, factors = np.array(terms).T
        places = (rows.astype(np.int64), columns.astype(np.int64))
        matrix = coo_matrix((factors, places), shape=(len(self._rows), len(cost)))
        bounds = np.array([bound for _, _, bound in self._rows])
        solution = linprog(cost, A_ub=matrix.tocsr(), b_ub=bounds, bounds=limits, method="highs")  # type: ignore[call-overload]
        z = np.round(solution.x if solution.x is not None else np.zeros(len(cost)), 4)
        values = {k: z[own] + self._rises[k] for k, own in self._variables.items()}
        planes = [replace(p, z=float(p.z + height)) for p, height in zip(self._planes, z, strict=False)]
        result = LayeredHeights(
            stations=self._stations,
            values=values,
            planes={tuple(sorted(c.nodes)): p for c, p in zip(self._clusters, planes, strict=True)},
            missed=[(c, float(gap)) for c, gap in zip(self._crossings, z[missed], strict=True) if gap > 0.05],
        )
        if self._land is not None:
            for cluster, plane in zip(self._clusters, planes, strict=True):
                for e in cluster.ends:
                    s = e.setback_m if e.side == 0 else self._chains[e.chain].length_m - e.setback_m
                    result.legs[e.chain, e.side] = plane, s
            result.off_m = {
                k: float(np.abs(values[k] - self._ground[k])[1:-1].max())
                for k in values
                if (k, 0) in result.legs
            }
        return result

    def _extra(self, cost: float) -> int:
        """A variable of its own."""
        self._costs.append(cost)
        return self._count + len(self._costs) - 1

    def _follow(self, low: Array) -> None:
        """Heights near the land; streets that may not sink are rather above it."""
        assert self._land is not None
        for k, chain in enumerate(self._chains):
            own, rise = self._variables[k], self._rises[k]
            self._ground[k] = self._land(_along(chain, self._stations[k]))
            for a, up, sinks in zip(
                own.tolist(), (self._ground[k] - rise).tolist(), low[own] < 0, strict=True
            ):
                off, cut = self._extra(1.0), 1.0 if sinks else _CUT_COST
                self._rows += [([a, off], [1.0, -1.0], up), ([a, off], [-cut, -1.0], -cut * up)]

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

    def _smooth(self) -> None:
        """Grades and vertical curves along every chain."""
        bend_cost = _BEND_COST if self._land is None else _LAND_BEND_COST
        for k, chain in enumerate(self._chains):
            own, rise, s = self._variables[k].tolist(), self._rises[k], self._stations[k]
            step = float(s[1] - s[0])
            radius = FAST_RADIUS_M if chain.street.speed_kmh > FAST_KMH else RADIUS_M
            for n, (a, b) in enumerate(itertools.pairwise(own)):
                if a != b:
                    slack, less = self._slack()
                    for sign in (1.0, -1.0):
                        bound = STEEPEST * step - sign * float(rise[n] - rise[n + 1])
                        self._rows.append(([a, b, *slack], [sign, -sign, *less], bound))
            for n, columns in enumerate(zip(own, own[1:], own[2:], strict=False)):
                if len(set(columns)) == 1:
                    continue
                bend, (slack, less) = self._extra(bend_cost), self._slack()
                bent = float(rise[n] - 2.0 * rise[n + 1] + rise[n + 2])
                for sign in (1.0, -1.0):
                    factors, rise_m = [sign, -2.0 * sign, sign], sign * bent
                    limit = step * step / radius - rise_m
                    self._rows.append(([*columns, *slack], [*factors, *less], limit))
                    self._rows.append(([*columns, bend], [*factors, -1.0], -rise_m))

    def _slack(self) -> tuple[list[int], list[float]]:
        """A column and its factor on sloping land, where grades and vertical curves may be missed."""
        return ([], []) if self._land is None else ([self._extra(_STEEP_COST)], [-1.0])

    def _clear(self) -> None:
        """Clearances, and variables of what they lack."""
        for crossing in self._crossings:
            short = self._extra(_SLACK_COST)
            upper, lower = (self._near(k, crossing) for k in (crossing.upper, crossing.lower))
            for a, up in upper:
                for b, down in lower:
                    terms = [(c, f) for c, f in ((a, -1.0), (b, 1.0)) if c is not None]
                    columns, factors = [c for c, _ in terms], [f for _, f in terms]
                    self._rows.append(([*columns, short], [*factors, -1.0], -CLEAR_M + up - down))

    def _near(self, chain: int | None, crossing: Crossing) -> list[tuple[int | None, float]]:
        """Variables of a chain's points at a crossing, and heights above them; None: the railway's ground."""
        if chain is None:
            place = np.array([[crossing.x, crossing.y]])
            return [(None, 0.0 if self._land is None else float(self._land(place)[0]))]
        line = shapely.LineString(self._chains[chain].line)
        at = shapely.line_locate_point(line, shapely.Point(crossing.x, crossing.y))
        other = crossing.lower if chain == crossing.upper else crossing.upper
        street = None if other is None else self._chains[other].street
        reach = 4.0 if street is None else half_width(street) + max(street.walks) + 3.0
        s = self._stations[chain]
        gap = np.abs(s - at)
        rows = np.flatnonzero(gap <= max(reach, 0.6 * float(s[1] - s[0]), gap.min()))
        points = zip(self._variables[chain][rows].tolist(), self._rises[chain][rows].tolist(), strict=True)
        return sorted(set(points))


def _along(chain: Chain, s: Array) -> Array:
    """Points (N, 2) of a chain [m]."""
    points = shapely.line_interpolate_point(shapely.LineString(chain.line), s)
    return np.asarray(shapely.get_coordinates(points))
