"""Figures of a report as SVG: trajectories over the town's lanes, errors over time, boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from carlaloc_env.core.array_types import Array

COLOURS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00",
    "#56B4E9", "#8C564B", "#7F7F7F", "#B8A000", "#444444",
)  # fmt: skip
"""Okabe and Ito's colours, which colour-blind people can tell apart, and some more."""
_POINTS_MAX = 600
"""Points of a line at most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """A line of a figure."""

    label: str
    """What it is called."""
    colour: str
    """Its colour."""
    x: Array
    """Abscissae, shape (N,)."""
    y: Array
    """Ordinates, shape (N,)."""


def thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """At most some hundred points of a line, of each stretch the one with the largest ordinate."""
    if len(x) <= _POINTS_MAX:
        return x, y
    groups = np.array_split(np.arange(len(x)), _POINTS_MAX)
    chosen = np.array([group[np.argmax(y[group])] for group in groups])
    return x[chosen], y[chosen]


def map_figure(truth_m: Array, lines: Sequence[Line], lanes_m: Sequence[Array]) -> str:
    """Trajectories from above, east to the right, over the centre lines of lanes, metres.

    Args:
        truth_m: True positions [m], shape (N, 2).
        lines: Estimates.
        lanes_m: Centre lines [m], shape (K, 2) each.
    """
    low, high = truth_m.min(axis=0), truth_m.max(axis=0)
    side = max(float((high - low).max()) * 1.15, 30.0)
    corner = 0.5 * (low + high) - 0.5 * side
    size = 400.0
    scale = size / side

    def place(points_m: Array) -> str:
        xy = (points_m - corner) * scale
        return " ".join(f"{x:.1f},{size - y:.1f}" for x, y in xy.tolist())

    parts = [_open(size, size, "trajectories from above")]
    for lane in lanes_m:
        near = (np.abs(lane - corner - 0.5 * side) < side).all(axis=1)
        if near.any():
            parts.append(f'<polyline class="lane" points="{place(lane)}"/>')
    parts.append(f'<polyline class="truth" points="{place(_every(truth_m))}"/>')
    for line in lines:
        points = place(_every(np.column_stack([line.x, line.y])))
        parts.append(
            f'<polyline class="line" stroke="{line.colour}" points="{points}">'
            f"<title>{escape(line.label)}</title></polyline>"
        )
    start = ((truth_m[0] - corner) * scale).tolist()
    parts.append(f'<circle class="start" cx="{start[0]:.1f}" cy="{size - start[1]:.1f}" r="4"/>')
    bar_m = next(b for b in (500, 200, 100, 50, 20, 10, 5) if b * scale < 0.4 * size or b == 5)
    parts.append(
        f'<line class="axis" x1="12" x2="{12 + bar_m * scale:.1f}" y1="{size - 12}" y2="{size - 12}"/>'
        f'<text x="12" y="{size - 18}">{bar_m} m</text></svg>'
    )
    return "".join(parts)


def curve_figure(lines: Sequence[Line], x_label: str, y_label: str, *, name: str, axis: int = 0) -> str:
    """Curves from zero upwards; a click on them tells the page the abscissa.

    Args:
        lines: Curves.
        x_label: What is to the right.
        y_label: What is upwards.
        name: Name of the gallery whose picture a click shows.
        axis: Which number of the gallery's pictures the abscissa is: 0 time, 1 distance.
    """
    width, height, left, below = 460.0, 240.0, 60.0, 34.0
    x_max = max(float(line.x.max()) for line in lines) or 1.0
    y_max = (max(float(line.y.max()) for line in lines) or 1.0) * 1.05
    inner_x, inner_y = width - left - 10, height - below - 10
    parts = [
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(y_label)}" class="curve" '
        f'data-gallery="{name}" data-xmax="{x_max:.4f}" data-left="{left}" '
        f'data-inner="{inner_x}" data-axis="{axis}">'
    ]
    for k in range(5):
        y = 10 + inner_y * (1 - k / 4)
        parts.append(
            f'<line class="grid" x1="{left}" x2="{width - 10}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text x="{left - 5}" y="{y + 4:.1f}" text-anchor="end">{y_max * k / 4:.2g}</text>'
        )
        x = left + inner_x * k / 4
        anchor = "end" if k == 4 else "middle"
        parts.append(f'<text x="{x:.1f}" y="{height - 18}" text-anchor="{anchor}">{x_max * k / 4:.3g}</text>')
    for line in lines:
        seconds, metres = thinned(line.x, line.y)
        right, down = left + inner_x * seconds / x_max, 10 + inner_y * (1 - metres / y_max)
        pixels = zip(right.tolist(), down.tolist(), strict=True)
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in pixels)
        parts.append(
            f'<polyline class="line" stroke="{line.colour}" points="{points}">'
            f"<title>{escape(line.label)}</title></polyline>"
        )
        peak = int(np.argmax(line.y))
        cx, cy = left + inner_x * line.x[peak] / x_max, 10 + inner_y * (1 - line.y[peak] / y_max)
        parts.append(
            f'<circle class="peak" cx="{cx:.1f}" cy="{cy:.1f}" r="5" fill="{line.colour}">'
            f"<title>{escape(line.label)}: {line.y[peak]:.3f} m at {line.x[peak]:.1f} {'sm'[axis]}</title>"
            "</circle>"
        )
    parts.append(
        f'<line class="cursor" y1="10" y2="{10 + inner_y}" x1="-9" x2="-9"/>'
        f'<text x="{left + inner_x / 2}" y="{height - 3}" text-anchor="middle">{escape(x_label)}</text>'
        f'<text transform="translate(11 {10 + inner_y / 2}) rotate(-90)" '
        f'text-anchor="middle">{escape(y_label)}</text>'
        "</svg>"
    )
    return "".join(parts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """A row of a figure of boxes."""

    label: str
    """What it is called."""
    colour: str
    """Its colour."""
    values: Array
    """What is summed up, shape (N,); empty where all runs failed."""
    failed: int = 0
    """Runs that failed."""
    runs: int = 1
    """Runs in all."""


def box_figure(boxes: Sequence[Box], x_label: str) -> str:
    """Boxes of the quartiles and the median, whiskers from the 5th to the 95th percentile.

    Failed runs are told in words: their errors would be no errors of a system that works, and without them
    a system that fails often would look good.

    Args:
        boxes: Rows.
        x_label: What is to the right.
    """
    left = _label_width([box.label for box in boxes])
    width, row = left + 275.0, 22.0
    height = row * len(boxes) + 40
    found = [np.percentile(b.values, [5, 25, 50, 75, 95]) if len(b.values) else np.zeros(5) for b in boxes]
    x_max = max(float(p[-1]) for p in found) * 1.05 or 1.0
    inner = width - left - 12
    parts = [_open(width, height, x_label)]
    for k, (box, at) in enumerate(zip(boxes, found, strict=True)):
        y = row * k + 14
        parts.append(f'<text x="{left - 6}" y="{y + 4}" text-anchor="end">{escape(box.label)}</text>')
        a, b, c, d, e = (left + inner * at / x_max).tolist()
        if len(box.values):
            parts.append(
                f'<line class="axis" x1="{a:.1f}" x2="{e:.1f}" y1="{y}" y2="{y}"/>'
                f'<rect x="{b:.1f}" y="{y - 7}" width="{max(d - b, 1):.1f}" height="14" '
                f'fill="{box.colour}" opacity="0.75"/>'
                f'<line class="median" x1="{c:.1f}" x2="{c:.1f}" y1="{y - 8}" y2="{y + 8}"/>'
            )
        if box.failed:
            told = "fail" if box.failed == box.runs else f"{box.failed} of {box.runs} fail"
            x, anchor = (e + 6, "start") if e < left + 0.7 * inner else (a - 6, "end")
            parts.append(
                f'<text class="failed" x="{x:.1f}" y="{y + 4}" text-anchor="{anchor}">✕ {told}</text>'
            )
    parts.append(_ticks(left, inner, height, x_max, x_label))
    return "".join(parts)


def real_time_figure(bars: Sequence[tuple[str, str, float]]) -> str:
    """Bars of the median time of a frame by the time between frames, logarithmic, with a line at real time.

    Args:
        bars: Label, colour and ratio of each; beyond 1 it does not keep up.
    """
    left = _label_width([name for name, _, _ in bars])
    width, row = left + 305.0, 22.0
    height, inner = row * len(bars) + 40, width - left - 42
    decades = np.log10([ratio for _, _, ratio in bars])
    low = min(float(np.floor(decades.min())), -1.0)
    high = max(float(np.ceil(decades.max())), 1.0)

    def x_of(decade: float) -> float:
        return left + inner * (decade - low) / (high - low)

    label = "time of a frame / time between frames"
    parts = [_open(width, height, label)]
    for k, ((name, colour, ratio), decade) in enumerate(zip(bars, decades.tolist(), strict=True)):
        y = row * k + 14
        parts.append(
            f'<text x="{left - 6}" y="{y + 4}" text-anchor="end">{escape(name)}</text>'
            f'<rect x="{left}" y="{y - 7}" width="{max(x_of(decade) - left, 1):.1f}" height="14" '
            f'fill="{colour}" opacity="0.75"/>'
            f'<text x="{x_of(decade) + 4:.1f}" y="{y + 4}">×{ratio:.2g}</text>'
        )
    for decade in range(int(low), int(high) + 1):
        x = x_of(decade)
        parts.append(f'<text x="{x:.1f}" y="{height - 18}" text-anchor="middle">{10.0**decade:g}</text>')
    x = x_of(0.0)
    parts.append(
        f'<line class="cursor" x1="{x:.1f}" x2="{x:.1f}" y1="2" y2="{height - 32}"/>'
        f'<text x="{left + inner / 2}" y="{height - 3}" text-anchor="middle">{label}</text>'
        "</svg>"
    )
    return "".join(parts)


def _label_width(labels: Sequence[str]) -> float:
    """Room that the longest label takes at 12 px, some 6.8 px a letter, with a margin."""
    return max(6.8 * max(map(len, labels)) + 14.0, 120.0)


def _ticks(left: float, inner: float, height: float, x_max: float, label: str) -> str:
    parts = [
        f'<text x="{left + inner * k / 4:.1f}" y="{height - 18}" '
        f'text-anchor="{"end" if k == 4 else "middle"}">{x_max * k / 4:.2g}</text>'
        for k in range(5)
    ]
    middle = left + inner / 2
    parts.append(f'<text x="{middle}" y="{height - 3}" text-anchor="middle">{escape(label)}</text></svg>')
    return "".join(parts)


def _open(width: float, height: float, label: str) -> str:
    return f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(label)}">'


def _every(points: Array) -> Array:
    return points[:: max(len(points) // _POINTS_MAX, 1)]
