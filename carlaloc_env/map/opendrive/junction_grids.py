"""Lays roads of a junction onto its `<elevationGrid>` of OpenDRIVE 1.8, by elevation and lateral shape."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.map.opendrive.read_plan_view import read_plan_view
from carlaloc_env.map.opendrive.records import Cubic, Geometry, Road, ShapeRecord
from carlaloc_env.map.opendrive.reference_line import PlanView
from carlaloc_env.map.opendrive.xml_document import Document, Element

STEP_M = 0.5
"""Greatest distance of the points at which roads take heights from the grid [m]."""
REACH_M = 15.0
"""Roads take heights this far to their sides [m]."""
STEPS = 3
"""Newton steps from the nearest sample of a reference line to the foot of a point."""
POINTS_LIMIT = 1_000_000
"""Grids of more points are refused."""


class _Grid(NamedTuple):
    """Heights at points of a square grid along a reference line."""

    line: tuple[Geometry, ...]
    first_s_m: float
    spacing_m: float
    most_right: int
    """Number of columns right of the line."""
    heights_m: Array
    """Rows along the line, columns from right to left."""


def on_grids(document: Document, junctions: Sequence[Element], roads: Sequence[Road]) -> list[Road]:
    """The roads, those of junctions with an elevation grid on it, whatever their own profiles are.

    Heights of lanes lie on top, as the standard has it.
    """
    elements = [e for junction in junctions if (e := junction.find("elevationGrid")) is not None]
    grids = dict(document.each(elements, lambda e: (e.getparent().get("id"), _grid(document, e))))
    return [_laid(road, grids[road.junction_id]) if road.junction_id in grids else road for road in roads]


def _grid(document: Document, element: Element) -> _Grid:
    junction = element.getparent()
    if junction.find("planView/geometry") is None:
        document.fail(element, "lies along no line", "add the junction's <planView>")
    spacing = document.length(element, "gridSpacing")
    rows = [
        tuple(_numbers(document, e, name) for name in ("right", "center", "left"))
        for e in element.findall("elevation")
    ]
    if spacing <= 0.0 or not rows or any(len(middle) != 1 for _, middle, _ in rows):
        document.fail(element, "is no grid", "give gridSpacing above 0 and one center of each elevation")
    most_right, most_left = (max(len(row[side]) for row in rows) for side in (0, 2))
    if len(rows) * (most_right + most_left + 1) > POINTS_LIMIT:
        document.fail(element, "has too many points", f"give it {POINTS_LIMIT} at most")
    # Rows that end earlier go on level.
    heights = [
        np.pad([*right[::-1], *middle, *left], (most_right - len(right), most_left - len(left)), "edge")
        for right, middle, left in rows
    ]
    return _Grid(
        line=read_plan_view(document, junction),
        first_s_m=document.length(element, "sStart", 0.0),
        spacing_m=spacing,
        most_right=most_right,
        heights_m=np.array(heights, np.float64),
    )


def _numbers(document: Document, element: Element, name: str) -> list[float]:
    try:
        values = [float(word) for word in (element.get(name) or "").split()]
    except ValueError:
        values = [math.nan]
    if not np.isfinite(values).all():
        document.fail(element, f"has {name}='{element.get(name)[:40]}'", "write numbers with blanks between")
    return values


def _laid(road: Road, grid: _Grid) -> Road:
    """A road with the grid's heights along it and to its sides."""
    stations = np.linspace(0.0, road.length_m, int(np.ceil(road.length_m / STEP_M)) + 1)
    aside = np.linspace(-REACH_M, REACH_M, 2 * round(REACH_M / STEP_M) + 1)
    line = PlanView([road]).evaluate(np.zeros(len(stations), np.int64), stations)
    x = line.x_m[:, None] - elementary.sin(line.heading_rad)[:, None] * aside
    y = line.y_m[:, None] + elementary.cos(line.heading_rad)[:, None] * aside
    heights = _heights(road, grid, np.stack([x.ravel(), y.ravel()], axis=-1)).reshape(x.shape)
    middle = heights[:, len(aside) // 2]
    slopes = np.diff(middle) / np.diff(stations)
    own = heights - middle[:, None]
    across = np.append(np.diff(own, axis=1) / np.diff(aside), np.zeros((len(stations), 1)), axis=1)
    return replace(
        road,
        elevation=tuple(
            Cubic(float(s), float(z), float(slope), 0.0, 0.0)
            for s, z, slope in zip(stations, middle, [*slopes, slopes[-1]], strict=True)
        ),
        superelevation=(),
        shape=tuple(
            ShapeRecord(float(s), float(t), float(own[k, n]), float(across[k, n]), 0.0, 0.0)
            for k, s in enumerate(stations)
            for n, t in enumerate(aside)
        ),
    )


def _heights(road: Road, grid: _Grid, points_m: Array) -> Array:
    """Heights of points, bilinear between those of the grid and level beyond it, (M,)."""
    rows, columns = grid.heights_m.shape
    last_s = grid.first_s_m + grid.spacing_m * (rows - 1)
    view = PlanView([replace(road, geometry=grid.line)])

    def line(s_m: Array) -> tuple[Array, Array]:
        at = view.evaluate(np.zeros(len(s_m), np.int64), s_m)
        ahead = np.stack([elementary.cos(at.heading_rad), elementary.sin(at.heading_rad)], axis=-1)
        return np.stack([at.x_m, at.y_m], axis=-1), ahead

    count = int(min(np.ceil((last_s - grid.first_s_m) / STEP_M), POINTS_LIMIT)) + 2
    stations = np.linspace(grid.first_s_m, last_s, count)
    s = stations[point_tree(line(stations)[0]).query(points_m)[1]]
    for _ in range(STEPS):
        place, ahead = line(s)
        s = s + ((points_m - place) * ahead).sum(axis=-1)
    place, ahead = line(s)
    away = points_m - place
    t = ahead[:, 0] * away[:, 1] - ahead[:, 1] * away[:, 0]
    row = np.clip((s - grid.first_s_m) / grid.spacing_m, 0.0, rows - 1)
    column = np.clip(t / grid.spacing_m + grid.most_right, 0.0, columns - 1)
    low_row = np.minimum(row.astype(np.int64), max(rows - 2, 0))
    low_column = np.minimum(column.astype(np.int64), max(columns - 2, 0))
    high_row, high_column = np.minimum(low_row + 1, rows - 1), np.minimum(low_column + 1, columns - 1)
    u, v, z = row - low_row, column - low_column, grid.heights_m
    near = z[low_row, low_column] * (1.0 - v) + z[low_row, high_column] * v
    far = z[high_row, low_column] * (1.0 - v) + z[high_row, high_column] * v
    heights: Array = near * (1.0 - u) + far * u
    return heights
