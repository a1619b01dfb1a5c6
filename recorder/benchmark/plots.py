"""Plots of a report as SVG by matplotlib: trajectories over lanes, errors over time, boxes, run times."""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape, unescape
from typing import Any

import numpy as np
from matplotlib import rc_context

from carlaloc_env.core.array_types import Array
from recorder.report.canvas import new_figure

_INK = "#010203"
"""Stands for the page's own colour of text, so that letters are light on a dark page."""
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "carlaloc",
    "font.size": 9.5,
    "font.sans-serif": ["DejaVu Sans"],
    "text.parse_math": False,
    **{f"{part}.color": _INK for part in ("text", "xtick", "ytick")},
    **{f"axes.{part}color": _INK for part in ("edge", "label")},
    **{f"{part}.facecolor": "none" for part in ("axes", "figure", "savefig")},
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#888888",
    "grid.alpha": 0.3,
}
_WIDTH_IN, _ROW_IN = 5.2, 0.24
"""Width of figures, and height of a row of boxes or bars [inches]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """A line of a figure."""

    label: str
    """Its name."""
    colour: str
    """Its colour."""
    x: Array
    """Abscissae, shape (N,)."""
    y: Array
    """Ordinates, shape (N,)."""
    dashed: bool = False
    """Whether it is dashed, to differ from another one of its colour."""

    def draw(self, axes: Any) -> None:
        """Draw it, with its name as a title."""
        style = "--" if self.dashed else "-"
        axes.plot(self.x, self.y, style, color=self.colour, lw=1.5, gid=f"hover {escape(self.label)}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """A row of a figure of boxes."""

    label: str
    """Its name."""
    colour: str
    """Its colour."""
    values: Array
    """What is summed up, shape (N,); empty where all runs failed."""
    failed: int = 0
    """Runs that failed."""
    runs: int = 1
    """Runs in all."""


@rc_context(_STYLE)
def map_plot(truth_m: Array, lines: Sequence[Line], lanes_m: Sequence[Array]) -> str:
    """Trajectories from above, east to the right, over the centre lines of lanes, metres.

    Args:
        truth_m: True positions [m], shape (N, 2).
        lines: Estimates.
        lanes_m: Centre lines [m], shape (K, 2) each.
    """
    figure = new_figure(_WIDTH_IN, _WIDTH_IN)
    axes = figure.subplots()
    for lane in lanes_m:
        axes.plot(*lane.T, color="#888888", lw=0.8, alpha=0.5)
    axes.plot(*truth_m.T, color=_INK, lw=3.5, alpha=0.45)
    axes.plot(*truth_m[0], "o", color=_INK, mfc="none", ms=7)
    for line in lines:
        line.draw(axes)
    low, high = truth_m.min(axis=0), truth_m.max(axis=0)
    half = max(0.575 * float((high - low).max()), 15.0)
    east, north = 0.5 * (low + high)
    axes.set(xlim=(east - half, east + half), ylim=(north - half, north + half), aspect="equal")
    axes.set(xlabel="east [m]", ylabel="north [m]")
    return _svg(figure, "trajectories from above")


@rc_context(_STYLE)
def curve_plot(
    lines: Sequence[Line], x_label: str, y_label: str, *, name: str | None = None, axis: int = 0
) -> str:
    """Curves from zero upwards; a click on them gives the page the abscissa.

    Args:
        lines: Curves; those of a gallery begin at 0.
        x_label: What is to the right.
        y_label: What is upwards.
        name: Name of the gallery whose picture a click shows; None: areas below the curves and no gallery.
        axis: Which number of the gallery's pictures the abscissa is: 0 time, 1 distance.
    """
    figure = new_figure(_WIDTH_IN, 0.5 * _WIDTH_IN)
    axes = figure.subplots()
    for line in lines:
        line.draw(axes)
        x, y = (float(values[np.argmax(line.y)]) for values in (line.x, line.y))
        title = f"{line.label}: {y:.3f} m at {x:.1f} {'sm'[axis]}"
        axes.plot(x, y, "o", color=line.colour, ms=7, clip_on=False, gid=f"peak {escape(title)}")
        if name is None:
            axes.fill_between(line.x, line.y, color=line.colour, alpha=0.2, lw=0)
    x_min = min(float(line.x.min()) for line in lines)
    x_max = max(float(line.x.max()) for line in lines) or 1.0
    y_max = max(float(line.y.max()) for line in lines) or 1.0
    axes.set(xlim=(x_min, x_max), ylim=(0.0, 1.05 * y_max), xlabel=x_label, ylabel=y_label)
    axes.grid()
    figure.draw_without_rendering()
    place = axes.get_position()
    gallery = (
        f'class="curve" data-gallery="{name}" data-axis="{axis}" data-xmax="{x_max:.4f}" '
        f'data-left="{place.x0:.5f}" data-width="{place.width:.5f}"'
    )
    return _svg(figure, y_label, gallery if name is not None else "")


@rc_context(_STYLE)
def box_plot(boxes: Sequence[Box], x_label: str) -> str:
    """Boxes of the quartiles and the median, whiskers from the 5th to the 95th percentile.

    Failed runs stand in words: their errors would be no errors of a system that works, and without them
    a system that fails often would look good.

    Args:
        boxes: Rows.
        x_label: What is to the right.
    """
    figure, axes = _rows([box.label for box in boxes], x_label)
    drawn = axes.boxplot(
        [box.values for box in boxes],
        positions=range(len(boxes)),
        orientation="horizontal",
        whis=(5, 95),
        widths=0.6,
        showfliers=False,
        patch_artist=True,
        manage_ticks=False,
        medianprops={"color": _INK, "lw": 1.5},
        **{part: {"color": _INK, "lw": 0.8} for part in ("boxprops", "whiskerprops", "capprops")},
    )
    for patch, box in zip(drawn["boxes"], boxes, strict=True):
        patch.set(facecolor=box.colour, alpha=0.75)
    axes.set_xlim(left=0.0)
    end = axes.get_xlim()[1]
    for row, box in enumerate(boxes):
        if box.failed:
            words = "✕ fail" if box.failed == box.runs else f"✕ {box.failed} of {box.runs} fail"
            low, high = np.percentile(box.values, [5, 95]) if len(box.values) else (0.0, 0.0)
            right = high < 0.7 * end
            _word(axes, words, high if right else low, row, right=right, color="#cc3333")
    return _svg(figure, x_label)


@rc_context(_STYLE)
def real_time_plot(bars: Sequence[tuple[str, str, float]]) -> str:
    """Bars of the median time of a frame by the time between frames, logarithmic, with a line at real time.

    Args:
        bars: Label, colour and ratio of each; beyond 1 it does not keep up.
    """
    labels, colours, ratios = zip(*bars, strict=True)
    label = "time of a frame / time between frames"
    figure, axes = _rows(labels, label)
    low, high = np.floor(np.log10(min(*ratios, 0.1))), np.ceil(np.log10(max(*ratios, 10.0)))
    axes.barh(range(len(bars)), ratios, 0.6, color=colours, alpha=0.75)
    axes.set(xscale="log", xlim=(10.0**low, 10.0**high))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.axvline(1.0, color=_INK, ls="--", lw=1.0)
    for row, ratio in enumerate(ratios):
        _word(axes, f"×{ratio:.2g}", ratio, row, right=True)
    return _svg(figure, label)


def _rows(labels: Sequence[str], x_label: str) -> tuple[Any, Any]:
    """A figure with a row for each label, the first one at the top."""
    figure = new_figure(_WIDTH_IN, _ROW_IN * len(labels) + 0.7)
    axes = figure.subplots()
    axes.set_yticks(range(len(labels)), labels)
    axes.set(ylim=(len(labels) - 0.4, -0.6), xlabel=x_label)
    return figure, axes


def _word(axes: Any, text: str, x: float, row: int, *, right: bool, **looks: str) -> None:
    """Write a word beside a place of a row."""
    side, offset = ("left", 5) if right else ("right", -5)
    axes.annotate(
        text, (x, row), (offset, 0), textcoords="offset points", ha=side, va="center_baseline", **looks
    )


def _svg(figure: Any, label: str, attributes: str = "") -> str:
    """A figure as an element of a page; what has the name ``hover …`` or ``peak …`` shows it as a title."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    svg = text.getvalue().replace(_INK, "currentColor")
    svg = svg[svg.index("<svg") :]
    named = r'<g id="(hover|peak) ([^"]*)">'
    svg = re.sub(named, lambda m: f'<g class="{m[1]}"><title>{unescape(m[2])}</title>', svg)
    # Figures of one page would share the other names.
    svg = re.sub(r'<g id="[^"]*">', "<g>", svg)
    svg = re.sub(r' (?:width|height)="[\d.]+pt"', "", svg, count=2)
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(label)}" {attributes}', 1)
