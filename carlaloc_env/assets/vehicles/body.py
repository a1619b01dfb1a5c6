"""Car bodies lofted through cross-sections: bonnet, greenhouse, wheel arches, nose and tail."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.assets.primitives import Look, crease, grid_triangles, mirrored
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour, Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

Points = tuple[tuple[float, float], ...]
"""Points (x, z) of an outline."""

DARK: Colour = (9, 9, 10)
"""Linear tint of black trim."""
_ROWS = 10
_FEW_ROWS = (0, 1, 3, 5, 6, 7, 9)


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyShape:
    """Lines of a body; `d` is the distance from the nose [m], z the height over ground [m]."""

    length_m: float
    width_m: float
    top: Points
    """Upper outline in the middle of the car, (d, z)."""
    belt: Points
    """Lower edge of the side windows, (d, z)."""
    cowl_d: float
    """Foot of the windscreen."""
    roof_front_d: float
    """Head of the windscreen."""
    roof_rear_d: float
    """Head of the rear window."""
    deck_d: float
    """Foot of the rear window; equal to `roof_rear_d` without one."""
    windows: tuple[tuple[float, float], ...]
    """Side windows, (from d, to d)."""
    axles_d: tuple[float, ...]
    tyre_m: float
    """Diameter of the tyres."""
    clearance_m: float = 0.16
    tumblehome: float = 0.36
    """Tangent of the side windows' lean."""
    nose_bow_m: float = 0.22
    tail_bow_m: float = 0.10
    screen_bow_m: float = 0.14
    plan: Points = ((0.0, 0.84), (0.12, 0.91), (0.45, 0.97), (1.1, 1.0))
    """Half width near the nose as a share of the greatest, (d, share)."""
    plan_rear: Points = ((0.0, 0.88), (0.10, 0.94), (0.5, 0.98), (1.0, 1.0))
    """The same near the tail, (distance from the tail, share)."""
    nose_low: float = 0.10
    """How much the bumper's lower edge rises at nose and tail [m]."""
    arch_m: float = 0.07
    """Gap between tyre and arch."""
    cladding: bool = False
    """Whether sills and arches are unpainted plastic."""
    bed: tuple[float, float, float] | None = None
    """Open load bed (from d, to d, floor height) of a pick-up."""
    nose_round_m: float = 0.05
    """How far the nose's upper and lower edge lie behind its middle."""
    tail_round_m: float = 0.04
    """The same at the tail."""

    def belt_z(self, d: float) -> float:
        """Height of the side windows' lower edge [m] at a distance from the nose [m]."""
        return float(_line(self.belt, d))


def plastic(tag: Tag, tint: Colour = DARK) -> Look:
    """Plastic of a linear tint, black trim when left out."""
    return Look(Material.PLASTIC, tag, tint)


def loft_body(shape: BodyShape, tag: Tag, *, low: bool = False) -> Mesh:
    """Painted shell with windows; nose at +x, centred on its box, closed.

    Args:
        shape: Its lines.
        tag: Semantic tag of the vehicle.
        low: Few triangles and no wheel arches, for a car far away.
    """
    paint = Look(Material.CAR_PAINT, tag)
    d = _few_stations(shape) if low else _stations(shape)
    grid = _sections(shape, d, arches=not low)
    rows = _FEW_ROWS if low else tuple(range(_ROWS))
    left = _skin(shape, d, grid, rows, paint)
    grid = grid[:, rows]
    caps = [_cap(grid[0], shape.nose_bow_m, 1.0, paint), _cap(grid[-1], shape.tail_bow_m, -1.0, paint)]
    return crease(merge([left, mirrored(left), *caps]), 38.0)


def _few_stations(shape: BodyShape) -> Array:
    """The ends, the feet and heads of the screens, the ends of the windows and a few between."""
    length = shape.length_m
    key = [0.0, 0.12, length - 0.12, length, shape.cowl_d, shape.roof_front_d]
    key += [shape.roof_rear_d, shape.deck_d, shape.windows[0][0], shape.windows[-1][1], *_bed_edges(shape)]
    return _filled(np.unique(np.round(np.clip(key, 0.0, length), 4)), 1.4)


def _stations(shape: BodyShape) -> Array:
    length = shape.length_m
    key = [0.05, 0.14, 0.32, length - 0.05, length - 0.14, length - 0.32, *(p[0] for p in shape.top)]
    window_edges = [shape.cowl_d, shape.roof_front_d, shape.roof_rear_d, shape.deck_d, *_bed_edges(shape)]
    window_edges += [edge for window in shape.windows for edge in window]
    radius = 0.5 * shape.tyre_m + shape.arch_m
    arch = radius * np.array([-1.01, -1.0, -0.90, -0.64, -0.24, 0.24, 0.64, 0.90, 1.0, 1.01])
    exact = np.concatenate([[0.0, length], *(axle + arch for axle in shape.axles_d), window_edges])
    # Loose stations within 2.5 cm of an exact edge are left out: slivers cost and show nothing.
    loose = [d for d in key if np.abs(exact - d).min() > 0.025]
    fixed = np.unique(np.round(np.concatenate([exact, loose]), 4))
    return _filled(fixed[(fixed >= 0.0) & (fixed <= length)], 0.55)


def _bed_edges(shape: BodyShape) -> tuple[float, ...]:
    """Both ends of a load bed and of the walls there, if there is one."""
    if shape.bed is None:
        return ()
    front, rear, _ = shape.bed
    return front, front + 0.01, rear - 0.01, rear


def _filled(stations: Array, gap_m: float) -> Array:
    """Rising stations with as many even ones between them as leave no wider gap."""
    gaps = [np.linspace(a, b, int(np.ceil((b - a) / gap_m)) + 1)[:-1] for a, b in pairwise(stations)]
    return np.concatenate([*gaps, stations[-1:]])


def _sections(shape: BodyShape, d: Array, *, arches: bool) -> Array:
    """Left half of every cross-section from the bottom centre to the top centre, shape (K, 10, 3)."""
    tail = shape.length_m - d
    top = _roof_line(shape, d)
    belt = np.minimum(_line(shape.belt, d), top - 0.045)
    half = 0.5 * shape.width_m * np.minimum(_line(shape.plan, d), _line(shape.plan_rear, tail))
    lift = shape.nose_low * (np.clip(1 - d / 0.4, 0, 1) ** 2 + np.clip(1 - tail / 0.4, 0, 1) ** 2)
    bottom = shape.clearance_m + lift
    upper = top - belt
    shoulder = belt - np.minimum(0.07, 0.2 * (belt - bottom))
    sill = bottom + 0.3 * (shoulder - bottom)
    waist = bottom + 0.68 * (shoulder - bottom)
    y_belt = 0.955 * half
    y_glass = y_belt - np.maximum(shape.tumblehome * 0.84 * upper, 0.05)
    y_rail = y_glass - np.maximum(0.05, 0.10 * np.minimum(upper, 0.5))
    zero = np.zeros_like(d)
    # Before the windscreen the upper rows spread over a crowned bonnet.
    bonnet = np.clip((shape.cowl_d - d) / 0.45, 0.0, 1.0)
    y_glass = y_glass + bonnet * (0.87 * half - y_glass)
    y_roof = 0.55 * y_rail * (1 - bonnet) + bonnet * 0.36 * half
    y_rail = y_rail + bonnet * (0.66 * half - y_rail)
    rise = [full + bonnet * (low - full) for full, low in ((0.84, 0.42), (0.945, 0.72), (0.985, 0.92))]
    y = np.stack(
        [zero, 0.86 * half, 0.975 * half, half, 0.99 * half, y_belt, y_glass, y_rail, y_roof, zero], -1
    )
    lower = [bottom, bottom, sill, waist, shoulder, belt]
    z = np.stack([*lower, *(belt + share * upper for share in rise), top], axis=-1)
    if shape.bed is not None:
        inside = (d > shape.bed[0]) & (d < shape.bed[1])
        z[inside, 6] = belt[inside]
        z[inside, 7:] = shape.bed[2]
        y[inside, 6] = y_belt[inside] - 0.07
        y[inside, 7] = y[inside, 6] - 0.01
    radius = 0.5 * shape.tyre_m + shape.arch_m
    for axle in shape.axles_d if arches else ():
        inside = np.abs(d - axle) <= radius + 1e-6
        height = 0.5 * shape.tyre_m + np.sqrt(np.maximum(radius**2 - (d - axle) ** 2, 0.0))
        z[inside, :5] = np.maximum(z[inside, :5], height[inside, None])
    z[:, :5] = np.minimum(z[:, :5], (belt - 0.01)[:, None])
    x = 0.5 * shape.length_m - d[:, None] - _bow(shape, d, y, half) - _rounding(shape, d, z)
    return np.stack([x, y, z], axis=-1)


def _rounding(shape: BodyShape, d: Array, z: Array) -> Array:
    """How far upper and lower edge of nose and tail lie behind their middle, shape (K, 10) [m]."""
    tail = shape.length_m - d
    total = np.zeros_like(z)
    for away, depth, facing in ((d, shape.nose_round_m, 1.0), (tail, shape.tail_round_m, -1.0)):
        end = z[int(np.argmin(away))]
        middle, half = 0.5 * (end[0] + end[-1]), max(0.5 * (end[-1] - end[0]), 0.1)
        share = np.minimum(((z - middle) / half) ** 2, 1.0)
        total += facing * depth * np.clip(1 - away / 0.5, 0, 1)[:, None] * share
    return total


def _bow(shape: BodyShape, d: Array, y: Array, half: Array) -> Array:
    """How far the sides lie behind the middle: rounded nose, screens and tail in plan."""
    share = (y / half[:, None]) ** 2
    nose = shape.nose_bow_m * np.clip(1 - d / 0.9, 0, 1)
    tail = shape.tail_bow_m * np.clip(1 - (shape.length_m - d) / 0.9, 0, 1)
    screen = np.interp(
        d,
        [shape.cowl_d - 0.35, shape.cowl_d, shape.roof_front_d, shape.roof_front_d + 0.35],
        [0.0, shape.screen_bow_m, 0.6 * shape.screen_bow_m, 0.0],
    )
    upper = np.arange(_ROWS) >= 7
    return (nose - tail)[:, None] * share + np.where(upper, screen[:, None] * (share - 1) * 0.7, 0.0)


def _skin(shape: BodyShape, d: Array, grid: Array, rows: tuple[int, ...], paint: Look) -> Mesh:
    """Left half of the shell, each cell with the material of its place."""
    middle = 0.5 * (d[:-1] + d[1:])
    glazed = np.zeros(len(middle), dtype=bool)
    for first, last in shape.windows:
        glazed |= (middle > first) & (middle < last)
    cabin = bool(shape.windows)
    span = (middle > shape.windows[0][0]) & (middle < shape.windows[-1][1]) if cabin else glazed
    screen = (middle > shape.cowl_d) & (middle < shape.roof_front_d)
    rear = (middle > shape.roof_rear_d) & (middle < shape.deck_d)
    part = np.zeros((len(middle), _ROWS - 1), dtype=np.int64)
    part[:, 0] = 1
    if shape.cladding:
        part[:, 1] = 1
    # The folded edge inside a wheel arch.
    z = grid[:, :6, 2]
    level = np.abs(np.diff(z, axis=1)) < 1e-6
    folded = level[:-1] & level[1:]
    step = np.any(level[:-1] != level[1:], axis=1) & (np.diff(d) < 0.02)
    part[:, :5] = np.where(folded | step[:, None], 1, part[:, :5])
    part[:, 5] = np.where(glazed, 2, np.where(span, 1, 0))
    part[:, 7:] = np.where(screen | rear, 2, 0)[:, None]
    if shape.bed is not None:
        bed = (middle > shape.bed[0]) & (middle < shape.bed[1])
        part[:, 6:] = np.where(bed[:, None], 1, part[:, 6:])
    # From nose to tail, and from the bottom up along the left side: anticlockwise from outside when reversed.
    cells = grid_triangles(len(d), len(rows))[:, ::-1]
    owner = np.tile(part[:, [b - 1 for b in rows[1:]]].ravel(), 2)
    looks = (paint, plastic(paint.tag), Look(Material.GLASS, paint.tag))
    flat = grid[:, rows].reshape(-1, 3)
    return merge(look.mesh(flat, cells[owner == k], flat[:, [0, 2]]) for k, look in enumerate(looks))


def _cap(section: Array, bow_m: float, facing: float, paint: Look) -> Mesh:
    """Front or rear wall between the left and right half of the last section."""
    share = np.array([1.0, 0.66, 0.33, 0.0, -0.33, -0.66, -1.0])
    rows = section[1:]
    half = max(float(np.abs(rows[:, 1]).max()), 1e-6)
    points = np.repeat(rows[:, None], len(share), axis=1)
    points[..., 1] = rows[:, 1:2] * share
    change = (points[..., 1] / half) ** 2 - (rows[:, 1:2] / half) ** 2
    points[..., 0] -= facing * bow_m * change
    order = grid_triangles(len(rows), len(share))
    flat = points.reshape(-1, 3)
    return paint.mesh(flat, order[:, ::-1] if facing > 0 else order, flat[:, 1:])


def _roof_line(shape: BodyShape, d: Array) -> Array:
    """Upper outline at distances from the nose: smooth, with edges where screens meet bonnet and deck.

    Between edges a monotone cubic (Fritsch and Carlson 1980), so that bonnet and roof are arched.
    """
    x, z = np.array(shape.top, dtype=np.float64).T
    step, slope = np.diff(x), np.diff(z) / np.diff(x)
    edges = {shape.cowl_d, shape.deck_d, *((shape.bed[0],) if shape.bed else ())}
    tangent = np.zeros(len(x))
    for k in range(1, len(x) - 1):
        before, after = slope[k - 1], slope[k]
        if before * after > 0:
            tangent[k] = (step[k - 1] + step[k]) / (step[k - 1] / before + step[k] / after)
    right, left = tangent.copy(), tangent.copy()
    right[0], left[-1] = slope[0], slope[-1]
    for k in range(1, len(x) - 1):
        # An edge, and any bend so sharp that a curve would bulge.
        if float(x[k]) in edges or abs(slope[k] - slope[k - 1]) > 0.75:
            left[k], right[k] = slope[k - 1], slope[k]
    at = np.clip(np.searchsorted(x, d, side="right") - 1, 0, len(slope) - 1)
    t = np.clip((d - x[at]) / step[at], 0.0, 1.0)
    h10, h11 = t * (1 - t) ** 2, t * t * (t - 1)
    h01 = t * t * (3 - 2 * t)
    bend = step[at] * (h10 * right[at] + h11 * left[at + 1])
    return np.asarray(z[at] * (1 - h01) + z[at + 1] * h01 + bend, dtype=np.float64)


def _line(points: Points, d: ArrayLike) -> Array:
    return np.asarray(np.interp(np.asarray(d), *np.array(points).T), dtype=np.float64)
