"""Lanes sampled every half metre along their own centre lines, in travel direction."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.opendrive.cubic_table import last_at_or_before
from carlaloc_env.map.opendrive.road_surface import RoadSurface, SurfaceCurve

TABLE_STEP_M = 0.5
"""Spacing of the samples; each lane uses the next smaller one that divides its length."""
LANE_LIMIT_M = 1.0e6
"""Maps with more metres of lanes are refused: their tables would fill the memory."""
POSITION_LIMIT_M = 1.0e7
"""Lane points farther out can only come from broken polynomials."""
_CHUNK = 1 << 17


class LanePose(NamedTuple):
    """Poses on lane centre lines, looking in travel direction, world frame."""

    position_m: NDArray[np.float64]
    """(M, 3)."""
    heading_rad: Array
    """Anticlockwise from east, in (−π, π], (M,)."""
    pitch_rad: Array
    """Nose up positive, (M,)."""
    curvature_radpm: Array
    """Of the lane centre in the plane, left positive [1/m], (M,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaneTables:
    """All lanes' samples, concatenated; a lane owns rows first … first + count − 1."""

    first: Index
    """First row of each lane, (N,)."""
    count: Index
    """Rows of each lane, at least 2, (N,)."""
    step_m: Array
    """Station step of each lane, (N,)."""
    length_m: Array
    """Length of each lane's centre line in the plane, (N,)."""
    along_m: Array
    """|s − s at the lane's travel start| of each row, (R,)."""
    position_m: NDArray[np.float64]
    """(R, 3)."""
    tangent: NDArray[np.float64]
    """Cosine and sine of the heading, and rise per metre, (R, 3)."""
    heading_rad: Array
    """Continuous along each lane, (R,)."""
    curvature_radpm: Array
    """(R,)."""
    width_m: Array
    """(R,)."""
    speed_limit_mps: Array
    """(R,)."""

    def locate(self, lane: Index, station_m: Array) -> tuple[Index, Array]:
        """Row and fraction of the way to the next row; stations are clipped to the lane."""
        at = np.clip(station_m / self.step_m[lane], 0.0, self.count[lane] - 1.0)
        k = np.minimum(at.astype(np.int64), self.count[lane] - 2)
        return self.first[lane] + k, at - k

    def pose(self, lane: Index, station_m: Array) -> LanePose:
        """Poses between samples: cubic Hermite for points, linear for angles and curvature."""
        row, f = self.locate(lane, station_m)
        after = row + 1
        g, f2 = 1.0 - f, f * f
        h = self.step_m[lane]
        w1 = f2 * (3.0 - 2.0 * f)
        m0 = (h * f * g * g)[:, None]
        m1 = (h * f2 * g)[:, None]
        t0, t1 = self.tangent[row], self.tangent[after]
        position = (
            self.position_m[row] * (1.0 - w1)[:, None]
            + self.position_m[after] * w1[:, None]
            + t0 * m0
            - t1 * m1
        )
        heading = self.heading_rad[row] * g + self.heading_rad[after] * f
        slope = t0[:, 2] * g + t1[:, 2] * f
        curvature = self.curvature_radpm[row] * g + self.curvature_radpm[after] * f
        return LanePose(position, wrap_angle(heading), elementary.arctan(slope), curvature)

    def along(self, lane: Index, station_m: Array) -> Array:
        """|s − s at the travel start| of stations, (M,)."""
        row, f = self.locate(lane, station_m)
        return self.along_m[row] * (1.0 - f) + self.along_m[row + 1] * f

    def station(self, lane: Index, along_m: Array) -> Array:
        """Inverse of `along`, (M,)."""
        row = last_at_or_before(self.first[lane], self.count[lane] - 1, self.along_m, along_m)
        gap = self.along_m[row + 1] - self.along_m[row]
        f = np.where(gap > 0.0, (along_m - self.along_m[row]) / np.where(gap > 0.0, gap, 1.0), 0.0)
        station: Array = (row - self.first[lane] + np.clip(f, 0.0, 1.0)) * self.step_m[lane]
        return station


def build_tables(
    surface: RoadSurface,
    start_s_m: Array,
    end_s_m: Array,
    forward: NDArray[np.bool_],
    limits: Sequence[Sequence[tuple[float, float]]],
    rank: Index,
    labels: Sequence[str],
) -> LaneTables:
    """Samples all lanes.

    Args:
        surface: The roads.
        start_s_m: s at the start of each lane's section, (N,).
        end_s_m: s at its end, (N,).
        forward: True where traffic runs with growing s, (N,).
        limits: Per lane, ascending (s, speed limit [m/s]); the first holds from the start.
        rank: Per lane, |lane id|.
        labels: Per lane, its name for errors.

    Raises:
        MapError: The map is too large, or a lane's points are not finite.
    """
    spans = np.maximum(end_s_m - start_s_m, 0.0)
    if spans.sum() > LANE_LIMIT_M:
        raise MapError(
            f"the map has {spans.sum() / 1e3:.0f} km of lanes; split it below {LANE_LIMIT_M / 1e3:.0f} km"
        )
    fine_s, grown, fine_first, fine_count = _arc_steps(surface, start_s_m, spans)
    total = np.add.reduceat(grown, fine_first)
    _refuse_long(total, spans, rank, labels)
    cumulative = np.cumsum(grown) - grown
    cumulative -= np.repeat(cumulative[fine_first], fine_count)
    length = cumulative[fine_first + fine_count - 1]
    intervals = np.maximum(np.ceil(length / TABLE_STEP_M - 1e-9), 1.0).astype(np.int64)
    count = intervals + 1
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64)
    owner = np.repeat(np.arange(len(count)), count)
    k = np.arange(len(owner)) - first[owner]
    along_travel = k * (length / intervals)[owner]
    station = np.where(forward[owner], along_travel, length[owner] - along_travel)
    # One growing axis for all lanes lets a single interp call answer for all of them.
    base = np.concatenate([[0.0], np.cumsum(length + 1.0)[:-1]])
    fine_owner = np.repeat(np.arange(len(count)), fine_count)
    s = np.interp(base[owner] + station, base[fine_owner] + cumulative, fine_s)
    curve = _centre(surface, owner, s)
    _refuse_broken(curve.position_m, owner, rank, labels)
    sign = np.where(forward[owner], 1.0, -1.0)
    heading = _continuous(curve.heading_rad + np.where(forward[owner], 0.0, np.pi), first)
    travel_start = np.where(forward, start_s_m, start_s_m + spans)
    return LaneTables(
        first=first,
        count=count,
        step_m=np.maximum(length / intervals, 1e-12),
        length_m=length,
        along_m=np.abs(s - travel_start[owner]),
        position_m=curve.position_m,
        tangent=np.stack([elementary.cos(heading), elementary.sin(heading), curve.slope * sign], axis=-1),
        heading_rad=heading,
        curvature_radpm=curve.curvature_radpm * sign,
        width_m=surface.edges.width(owner, s),
        speed_limit_mps=_limits(limits, owner, s),
    )


def _arc_steps(surface: RoadSurface, start_s_m: Array, spans: Array) -> tuple[Array, Array, Index, Index]:
    """s every quarter metre, arc length to the next by Simpson's rule, then first row and rows per lane."""
    pieces = np.maximum(np.ceil(spans / (0.5 * TABLE_STEP_M)), 1.0).astype(np.int64)
    count = pieces + 1
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64)
    owner = np.repeat(np.arange(len(count)), count)
    k = np.arange(len(owner)) - first[owner]
    step = (spans / pieces)[owner]
    s = start_s_m[owner] + k * step
    at_points, at_middles = _stretch(surface, owner, s), _stretch(surface, owner, s + 0.5 * step)
    after = np.append(at_points[1:], 0.0)
    grown = step * (at_points + 4.0 * at_middles + after) / 6.0
    grown[first + pieces] = 0.0
    return s, grown, first, count


def _refuse_long(length: Array, spans: Array, rank: Index, labels: Sequence[str]) -> None:
    """Refuses lanes that wild polynomials make endless, before tables are made for them."""
    allowed = 1.5 * LANE_LIMIT_M
    broken = ~(length < allowed)
    if broken.any() or length.sum() > allowed:
        # A broken width shifts all lanes outside of it: the innermost is to blame.
        worst = int(np.argmin(np.where(broken, rank, np.inf))) if broken.any() else int(np.argmax(length))
        grown = f"{labels[worst]} grows to {length[worst]:.3g} m over {spans[worst]:.3g} m of road"
        raise MapError(f"{grown}; correct its geometry and width polynomials")


def _stretch(surface: RoadSurface, lane: Index, s_m: Array) -> Array:
    """Metres of lane centre per metre of s, in chunks."""
    out = np.empty(len(lane))
    for k in range(0, len(lane), _CHUNK):
        own = slice(k, k + _CHUNK)
        out[own] = surface.lane_centre(lane[own], s_m[own]).stretch
    return out


def _centre(surface: RoadSurface, lane: Index, s_m: Array) -> SurfaceCurve:
    """Lane centres in chunks, so that memory stays bounded."""
    parts = [
        surface.lane_centre(lane[k : k + _CHUNK], s_m[k : k + _CHUNK])
        for k in range(0, max(len(lane), 1), _CHUNK)
    ]
    return SurfaceCurve(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _refuse_broken(position_m: NDArray[np.float64], owner: Index, rank: Index, labels: Sequence[str]) -> None:
    bad = ~(np.abs(position_m) < POSITION_LIMIT_M).all(axis=1)
    if bad.any():
        label = labels[int(owner[np.argmin(np.where(bad, rank[owner], np.iinfo(np.int64).max))])]
        raise MapError(
            f"{label} runs out of the world; correct its geometry, elevation and width polynomials"
        )


def _continuous(heading_rad: Array, first: Index) -> Array:
    """Headings without jumps of 2π inside each lane."""
    wrapped = wrap_angle(heading_rad)
    turns = np.zeros(len(wrapped))
    turns[1:] = -np.round(np.diff(wrapped) / (2.0 * np.pi))
    turns[first] = 0.0
    total = np.cumsum(turns)
    total -= np.repeat(total[first], np.diff(np.append(first, len(wrapped))))
    return wrapped + 2.0 * np.pi * total


def _limits(limits: Sequence[Sequence[tuple[float, float]]], owner: Index, s: Array) -> Array:
    out = np.array([rows[0][1] for rows in limits])[owner]
    for lane, rows in enumerate(limits):
        if len(rows) > 1:
            low, high = np.searchsorted(owner, [lane, lane + 1])
            which = np.searchsorted([r[0] for r in rows], s[low:high], side="right") - 1
            out[low:high] = np.array([r[1] for r in rows])[np.maximum(which, 0)]
    return out
