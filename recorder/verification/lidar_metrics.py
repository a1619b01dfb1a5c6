"""Metrics of a spinning LiDAR's sweeps that differ between real recordings and drawn ones.

They need no truth, so they hold for anybody's clouds: sweeps are laid on a grid of columns and rings, and
noise, edges, missing returns and intensities are read from neighbours on it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.jit import compiled
from recorder.dataset.scans import Scan

COLUMNS = 1085
"""Columns of an HDL-32E at 20 Hz; of denser sweeps every second, third, … column is looked at."""
_GAP_DEG = 0.2
"""Least gap of elevation between two rings of clouds that do not number them."""
_SPREAD_DEG = 2.0
"""Deviation of elevations in a ring above which it is no beam that goes round."""
_RINGS = (4, 256)
"""Fewest and most rings."""
_LOW_DEG, _LEVEL_DEG = -22.0, (-4.67, -0.67)
"""Elevations up to which rings look at the road beside the car, and between which at the far road."""
_ROAD_WINDOW_M, _SMOOTH_WINDOW_M = 1.5, 0.55
"""Lengths of windows along a ring: for the road, and short ones for whatever is smooth."""
_NEAR_M, _FAR_M, _MOST = 3.0, 40.0, 40
"""Ranges between which windows lie, and steps that they have at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A sweep on a grid; NaN where nothing came back."""

    xyz_m: Array
    """Points in the sensor's frame, shape (C, R, 3)."""
    range_m: Array
    """Their distances, shape (C, R)."""
    intensity: Array
    """Their intensities, shape (C, R)."""
    elevation_deg: Array
    """Elevation of each ring, shape (R,)."""


class _Windows(NamedTuple):
    """Stretches of a ring, N of them, and the ranges' residuals about a parabola on each."""

    range_m: Array
    """Mean range, shape (N,)."""
    middle_m: Array
    """Mean point, shape (N, 3)."""
    spread_m: Array
    """Standard deviation of the residuals."""
    correlation: Array
    """Of neighbouring residuals."""
    varied: Array
    """Standard deviation of the intensity over its mean."""


def lidar_metrics(scans: Sequence[Scan]) -> dict[str, float]:
    """Metrics by name, means over sweeps; NaN where clouds lack what a metric needs.

    Args:
        scans: Sweeps of one sensor whose z axis points up, 1 to 3.2 m above the road.

    Raises:
        EvaluationError: points lie on no rings, or see no road.
    """
    return means_of([_metrics(sweep) for sweep in sweeps_of(scans)])


def means_of(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    """Means over sweeps or pictures of what each of them shows; NaN where none does."""
    values = {name: [row[name] for row in rows if math.isfinite(row[name])] for name in rows[0]}
    return {name: float(np.mean(numbers)) if numbers else math.nan for name, numbers in values.items()}


def sweeps_of(scans: Sequence[Scan]) -> Iterator[Sweep]:
    """Sweeps on grids of columns and rings.

    Raises:
        EvaluationError: points lie on no rings.
    """
    rings = [_rings(scan) for scan in scans]
    elevations = [_elevation_deg(scan.points_xyz_m) for scan in scans]
    ring, elevation = np.concatenate(rings), np.concatenate(elevations)
    count = int(ring.max()) + 1
    if not _RINGS[0] <= count <= _RINGS[1] or ring.min() < 0:
        raise EvaluationError(f"clouds of {count} rings are no spinning LiDAR's; give one with 4 to 256")
    order = np.argsort(ring, kind="stable")
    number, first = np.unique(ring[order], return_index=True)
    parts = np.split(elevation[order], first[1:])
    middle = [np.median(part) for part in parts]
    spread = np.median([np.median(np.abs(part - at)) for part, at in zip(parts, middle, strict=True)])
    if spread > _SPREAD_DEG:
        raise EvaluationError("rings have no constant elevation, as a Livox's; give a spinning LiDAR's")
    # A ring that never answers lies between its neighbours.
    of_ring = np.interp(np.arange(count), number, middle)
    for scan, mine in zip(scans, rings, strict=True):
        yield _grid(scan, mine, of_ring)


def is_like_hdl32e(elevation_deg: Array) -> bool:
    """Whether rings at these elevations are those of an HDL-32E, of which the highest may never answer."""
    low, high = elevation_deg.min(), elevation_deg.max()
    return bool(28 <= len(elevation_deg) <= 32 and abs(low + 30.67) < 3.0 and 5.0 < high < 12.0)


def _rings(scan: Scan) -> NDArray[np.int64]:
    """Ring of each point: as the cloud numbers them, else by gaps of elevation."""
    if len(scan.points_xyz_m) < 100:
        raise EvaluationError(f"a sweep has {len(scan.points_xyz_m)} points; give clouds of whole sweeps")
    if scan.ring is not None:
        return scan.ring
    elevation = _elevation_deg(scan.points_xyz_m)
    order = np.argsort(elevation)
    ring = np.empty(len(order), np.int64)
    ring[order] = np.concatenate([[0], np.cumsum(np.diff(elevation[order]) > _GAP_DEG)])
    away = np.abs(elevation - (np.bincount(ring, elevation) / np.bincount(ring))[ring])
    if not _RINGS[0] <= ring.max() + 1 <= _RINGS[1] or away.mean() > _GAP_DEG:
        raise EvaluationError(
            "clouds have no field ring, and their points lie on no rings; record raw clouds"
        )
    return ring


def _elevation_deg(points_m: Array) -> Array:
    flat = np.hypot(points_m[:, 0], points_m[:, 1])
    return np.degrees(np.arctan2(points_m[:, 2], flat))


def _grid(scan: Scan, ring: NDArray[np.int64], elevation_deg: Array) -> Sweep:
    points = scan.points_xyz_m
    column, columns = _columns(scan, ring)
    every = max(round(columns / COLUMNS), 1)
    kept = (column >= 0) & (column < columns) & (column % every == 0)
    place = column[kept] // every, ring[kept]
    shape = -(-columns // every), len(elevation_deg)
    xyz, intensity = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
    xyz[place] = points[kept]
    if scan.intensity is not None:
        intensity[place] = scan.intensity[kept]
    range_m = np.sqrt((xyz * xyz).sum(axis=2))
    return Sweep(xyz_m=xyz, range_m=range_m, intensity=intensity, elevation_deg=elevation_deg)


def _columns(scan: Scan, ring: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Column of each point, and columns of a turn: by the times of points, else by their azimuths."""
    azimuth = np.arctan2(scan.points_xyz_m[:, 1], scan.points_xyz_m[:, 0]) / (2 * np.pi)
    timed = len(scan.deskew_time_s) > 0
    phase = scan.time_s - scan.time_s.min() if timed else (azimuth - azimuth[0]) % 1.0
    order = np.lexsort((phase, ring))
    same = np.diff(ring[order]) == 0
    step = _mean_step(np.diff(phase[order])[same])
    turn = np.abs((np.diff(azimuth[order])[same] + 0.5) % 1.0 - 0.5)
    columns = max(round(1.0 / _mean_step(turn)), 1)
    # Each ring fires at its own instant of a column.
    share = phase / step
    real, imaginary = (np.bincount(ring, f(2 * np.pi * share)) for f in (np.cos, np.sin))
    shift = (np.arctan2(imaginary, real) / (2 * np.pi) + 0.05) % 1.0 - 0.05
    return np.round(share - shift[ring]).astype(np.int64), columns


def _mean_step(steps: Array) -> float:
    """Mean of the steps from one column to the next, among wider ones over missing returns."""
    middle = np.median(steps)
    single = steps[(steps > 0.5 * middle) & (steps < 1.5 * middle)]
    if not len(single) or middle <= 0.0:
        raise EvaluationError("points of a ring have no even steps; give clouds of a spinning LiDAR")
    return float(single.mean())


def _metrics(sweep: Sweep) -> dict[str, float]:
    xyz, r, intensity = sweep.xyz_m, sweep.range_m, sweep.intensity
    answered = np.isfinite(r)
    near = r[answered]
    normal, offset = _road_plane(sweep)
    road, smooth = _windows(sweep, _ROAD_WINDOW_M, 8), _windows(sweep, _SMOOTH_WINDOW_M, 6)
    flat = (np.abs(road.middle_m @ normal + offset) < 0.12) & (road.range_m < 16)
    discontinuities, dropouts, mixed = _discontinuities(r)
    low = sweep.elevation_deg <= _LOW_DEG
    level = (sweep.elevation_deg > _LEVEL_DEG[0]) & (sweep.elevation_deg < _LEVEL_DEG[1])
    above = sweep.elevation_deg >= _LEVEL_DEG[1]
    received_intensity = intensity[np.isfinite(intensity)]
    return {
        "returns of a sweep": float(answered.sum()),
        "own car: share below 2.5 m": float((near < 2.5).mean()),
        "no return, rings below -22 deg": _silent(answered[:, low]),
        "no return, rings at -4 to -1 deg": _silent(answered[:, level]),
        "no return, rings above": _silent(answered[:, above]),
        "range p99 [m]": float(np.percentile(near, 99)),
        "share beyond 70 m": float((near > 70).mean()),
        "road residual, 1.5 m [cm]": 100 * _percentile(road.spread_m[flat], 50),
        "neighbours' correlation on the road": _percentile(road.correlation[flat], 50),
        "shot noise, 0.55 m, p50 [cm]": 100 * _percentile(smooth.spread_m, 50),
        "shot noise p10 [cm]": 100 * _percentile(smooth.spread_m, 10),
        "dropouts at range discontinuities": dropouts / max(discontinuities, 1),
        "mixed pixels at range discontinuities": mixed / max(discontinuities, 1),
        "intensity p50": _percentile(received_intensity, 50),
        "intensity p95": _percentile(received_intensity, 95),
        "ground intensity exponent": _incidence_exponent(xyz, r, intensity, normal, offset),
        "intensity variation in a road window": _percentile(road.varied[flat], 50),
    }


def _silent(answered: NDArray[np.bool_]) -> float:
    return float(1 - answered.mean()) if answered.size else float("nan")


def _percentile(values: Array, percent: float) -> float:
    return float(np.percentile(values, percent)) if len(values) else float("nan")


def _road_plane(sweep: Sweep) -> tuple[Array, float]:
    """Normal and offset [m] of the road near the car: the best of 400 planes, fitted to its points."""
    xyz, r = sweep.xyz_m, sweep.range_m
    q = xyz[(r > 3) & (r < 15) & (xyz[..., 2] < -1.0) & (xyz[..., 2] > -3.2)]
    if len(q) < 100:
        raise EvaluationError(
            "sweeps see no road 1 to 3.2 m below the sensor; give clouds of a car's LiDAR whose z axis is up"
        )
    a, b, c = q[np.random.default_rng(0).integers(0, len(q), (3, 400))]
    n = np.cross(b - a, c - a)
    size = np.linalg.norm(n, axis=1)
    n, a = n[size > 1e-3], a[size > 1e-3]
    n /= (size[size > 1e-3] * np.sign(n[:, 2]))[:, None]
    n, a = n[n[:, 2] > 0.97], a[n[:, 2] > 0.97]
    if not len(n):
        raise EvaluationError("sweeps see no level road; give clouds in a frame whose z axis points up")
    some = q[:: max(len(q) // 3000, 1)]
    best = int((np.abs(some @ n.T - (n * a).sum(axis=1)) < 0.05).sum(axis=0).argmax())
    normal, offset = n[best], -float(n[best] @ a[best])
    for _ in range(3):
        on = q[np.abs(q @ normal + offset) < 0.08]
        east, north, height = np.linalg.lstsq(np.c_[on[:, :2], np.ones(len(on))], on[:, 2], rcond=None)[0]
        size = np.sqrt(east * east + north * north + 1.0)
        normal, offset = np.array([-east, -north, 1.0]) / size, float(-height / size)
    return normal, offset


def _windows(sweep: Sweep, length_m: float, fewest: int) -> _Windows:
    """Stretches of about a length without a jump of range, one after the other on each ring."""
    step = np.sqrt((np.diff(sweep.xyz_m, axis=0) ** 2).sum(axis=2))
    stretches = np.empty((sweep.range_m.size // 2 + 1, 3), np.int64)
    count = _stretches(sweep.range_m, step, length_m, fewest, stretches)
    ring, first, last = stretches[:count].T
    lengths = last - first + 1
    rows = [np.zeros((0, 7))]
    for n in np.unique(lengths).tolist():
        rows.append(_fitted(sweep, ring[lengths == n], first[lengths == n], n))
    table = np.concatenate(rows)
    return _Windows(table[:, 0], table[:, 1:4], *table[:, 4:].T)


@compiled
def _stretches(range_m: Array, step_m: Array, length_m: float, fewest: int, out: NDArray[np.int64]) -> int:
    """Ring, first and last column of each stretch, written to `out`; their number."""
    columns, rings = range_m.shape
    count = 0
    for ring in range(rings):
        c = 0
        while c < columns - fewest:
            r = range_m[c, ring]
            if not (_NEAR_M < r < _FAR_M):
                c += 1
                continue
            widest = max(0.3, 8.0 * np.pi * r / columns)
            e, way, whole = c, 0.0, True
            while e + 1 < columns and way < length_m and e - c < _MOST:
                if not step_m[e, ring] <= widest:
                    whole = False
                    break
                way += step_m[e, ring]
                e += 1
            if whole and e - c + 1 >= fewest and way >= 0.6 * length_m:
                out[count, 0], out[count, 1], out[count, 2] = ring, c, e
                count += 1
                c = e + 1
            else:
                c = max(e, c + 1)
    return count


def _fitted(sweep: Sweep, ring: NDArray[np.int64], first: NDArray[np.int64], n: int) -> Array:
    """Columns of `_Windows` for stretches of n points, shape (N, 7)."""
    place = first[:, None] + np.arange(n), ring[:, None]
    y, received = sweep.range_m[place], sweep.intensity[place]
    x = np.linspace(-1.0, 1.0, n)
    basis, _ = np.linalg.qr(np.stack([np.ones(n), x, x * x], axis=1))
    rest = y - (y @ basis) @ basis.T
    power = (rest * rest).sum(axis=1)
    beside = (rest[:, 1:] * rest[:, :-1]).sum(axis=1) / np.maximum(power, 1e-12)
    with np.errstate(invalid="ignore", divide="ignore"):
        varied = received.std(axis=1) / received.mean(axis=1)
    middle = sweep.xyz_m[place].mean(axis=1)
    return np.column_stack([y.mean(axis=1), middle, np.sqrt(power / (n - 3)), beside, varied])


def _discontinuities(range_m: Array) -> tuple[int, int, int]:
    """Number of range discontinuities above 1 m, of dropouts there, and of mixed pixels there."""
    a, b, c = range_m[:-2], range_m[1:-1], range_m[2:]
    nothing = np.full((1, range_m.shape[1]), np.nan)
    before, after = np.vstack([nothing, range_m[:-3]]), np.vstack([range_m[3:], nothing])
    low, high = np.fmin(a, c), np.fmax(a, c)
    gap = high - low
    jump = (low > 2.5) & (high < 40) & (gap > 1.0)
    jump &= (np.abs(a - before) < 0.15 * gap) & (np.abs(c - after) < 0.15 * gap)
    between = jump & (b > low + 0.15 * gap) & (b < high - 0.15 * gap)
    return int(jump.sum()), int((jump & ~np.isfinite(b)).sum()), int(between.sum())


def _incidence_exponent(
    xyz_m: Array, range_m: Array, intensity: Array, normal: Array, offset: float
) -> float:
    """k of intensity ∝ cosᵏ of the incidence, on the road at 4 to 14 m."""
    on = (np.abs(xyz_m @ normal + offset) < 0.12) & (range_m > 4) & (range_m < 14) & np.isfinite(intensity)
    if on.sum() <= 500:
        return float("nan")
    cosine = np.abs(xyz_m[on] @ normal) / range_m[on]
    return float(np.polyfit(np.log(cosine), np.log(np.maximum(intensity[on], 0.25)), 1)[0])
