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


def curve_figure(lines: Sequence[Line], x_label: str, y_label: str, *, name: str) -> str:
    """Curves from zero upwards; a click on them tells the page the abscissa.

    Args:
        lines: Curves.
        x_label: What is to the right.
        y_label: What is upwards.
        name: Name of the gallery whose picture a click shows.
    """
    width, height, left, below = 460.0, 240.0, 50.0, 34.0
    x_max = max(float(line.x.max()) for line in lines) or 1.0
    y_max = (max(float(line.y.max()) for line in lines) or 1.0) * 1.05
    inner_x, inner_y = width - left - 10, height - below - 10
    parts = [
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(y_label)}" class="curve" '
        f'data-gallery="{name}" data-xmax="{x_max:.4f}" data-left="{left}" data-inner="{inner_x}">'
    ]
    for k in range(5):
        y = 10 + inner_y * (1 - k / 4)
        parts.append(
            f'<line class="grid" x1="{left}" x2="{width - 10}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text x="{left - 5}" y="{y + 4:.1f}" text-anchor="end">{y_max * k / 4:.2g}</text>'
        )
        x = left + inner_x * k / 4
        parts.append(f'<text x="{x:.1f}" y="{height - 18}" text-anchor="middle">{x_max * k / 4:.3g}</text>')
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
            f"<title>{escape(line.label)}: {line.y[peak]:.3f} m at {line.x[peak]:.1f} s</title></circle>"
        )
    parts.append(
        f'<line class="cursor" y1="10" y2="{10 + inner_y}" x1="-9" x2="-9"/>'
        f'<text x="{left + inner_x / 2}" y="{height - 3}" text-anchor="middle">{escape(x_label)}</text>'
        f'<text transform="translate(11 {10 + inner_y / 2}) rotate(-90)" '
        f'text-anchor="middle">{escape(y_label)}</text>'
        "</svg>"
    )
    return "".join(parts)


def box_figure(boxes: Sequence[tuple[str, str, Array]], x_label: str) -> str:
    """Boxes of the quartiles and the median, whiskers from the 5th to the 95th percentile.

    Args:
        boxes: Label, colour and values of each.
        x_label: What is to the right.
    """
    width, row, left = 500.0, 22.0, 225.0
    height = row * len(boxes) + 40
    found = [np.percentile(values, [5, 25, 50, 75, 95]) for _, _, values in boxes]
    x_max = max(float(p[-1]) for p in found) * 1.05 or 1.0
    inner = width - left - 12
    parts = [_open(width, height, x_label)]
    for k, ((label, colour, _), at) in enumerate(zip(boxes, found, strict=True)):
        y = row * k + 14
        a, b, c, d, e = (left + inner * at / x_max).tolist()
        parts.append(
            f'<text x="{left - 6}" y="{y + 4}" text-anchor="end">{escape(label)}</text>'
            f'<line class="axis" x1="{a:.1f}" x2="{e:.1f}" y1="{y}" y2="{y}"/>'
            f'<rect x="{b:.1f}" y="{y - 7}" width="{max(d - b, 1):.1f}" height="14" fill="{colour}" '
            'opacity="0.75"/>'
            f'<line class="median" x1="{c:.1f}" x2="{c:.1f}" y1="{y - 8}" y2="{y + 8}"/>'
        )
    for k in range(5):
        x = left + inner * k / 4
        parts.append(f'<text x="{x:.1f}" y="{height - 18}" text-anchor="middle">{x_max * k / 4:.2g}</text>')
    parts.append(
        f'<text x="{left + inner / 2}" y="{height - 3}" text-anchor="middle">{escape(x_label)}</text></svg>'
    )
    return "".join(parts)


def _open(width: float, height: float, label: str) -> str:
    return f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(label)}">'


def _every(points: Array) -> Array:
    return points[:: max(len(points) // _POINTS_MAX, 1)]
