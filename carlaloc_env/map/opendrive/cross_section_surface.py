"""Reads `<crossSectionSurface>` of OpenDRIVE 1.8 as lateral shapes, at stations that are blended linearly."""

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import Polynomial

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.opendrive.cubic_table import CubicTable
from carlaloc_env.map.opendrive.read_plan_view import read_cubics
from carlaloc_env.map.opendrive.records import Cubic, ShapeRecord
from carlaloc_env.map.opendrive.xml_document import Document, Element

STEP_M = 1.0
"""Distance of stations where a coefficient changes along the road [m]."""
POWERS = ("constant", "linear", "quadratic", "cubic")
"""Elements of a strip, whose coefficients are those of the powers of t."""


def read_cross_section_surface(document: Document, road: Element, length_m: float) -> tuple[ShapeRecord, ...]:
    """Lateral shapes of a road's surface strips, ascending in s, then t.

    The heights of a strip are a cubic of its t from its inner border; those of mode ``relative`` are added to
    the height of the next inner strip there. Strips with positive ids lie left of the offset line.
    """
    surface = road.find("lateralProfile/crossSectionSurface")
    strips = [] if surface is None else surface.findall("surfaceStrips/strip")
    if not strips:
        return ()

    def cubics(element: Element, name: str) -> tuple[Cubic, ...]:
        return read_cubics(document, element.findall(f"{name}/coefficients"))

    tables = [[cubics(strip, name) for name in ("width", *POWERS)] for strip in strips]
    offset = cubics(surface, "tOffset")
    records = [record for table in (*tables, [offset]) for own in table for record in own]
    stations = sorted({0.0, *(record.s_m for record in records if record.s_m < length_m)})
    if any(record.b or record.c or record.d for record in records):
        steps = max(int(np.ceil(length_m / STEP_M)), 1)
        stations = sorted({*stations, *np.linspace(0.0, length_m, steps + 1).tolist()})
    numbers = [document.integer(strip, "id", limit=10_000) for strip in strips]
    relative = [strip.get("mode") == "relative" for strip in strips]
    middle = _values([offset], stations)[0]
    values = [_values(table, stations) for table in tables]
    shapes: list[ShapeRecord] = []
    for k, s in enumerate(stations):
        for side in (-1, 1):
            own = sorted((n for n, i in enumerate(numbers) if i * side > 0), key=lambda n: abs(numbers[n]))
            rows = [(values[n][0, k], relative[n], Polynomial(values[n][1:, k])) for n in own]
            shapes += _side(s, float(middle[k]), side, rows)
    return tuple(sorted(shapes, key=lambda record: (record.s_m, record.t_m)))


def _values(table: Sequence[Sequence[Cubic]], stations: Sequence[float]) -> Array:
    """Values of some records at stations, shape (number of records, number of stations)."""
    owner = np.repeat(np.arange(len(table)), len(stations))
    value = CubicTable(table).evaluate(owner, np.tile(stations, len(table)))[0]
    return value.reshape(len(table), len(stations))


def _side(
    s_m: float, t_m: float, side: int, strips: Sequence[tuple[float, bool, Polynomial]]
) -> list[ShapeRecord]:
    """Shapes of the strips on one side of the offset line at one station, from the innermost outwards."""
    shapes, border = [], 0.0
    for number, (width, is_relative, own) in enumerate(strips or [(0.0, False, Polynomial([0.0]))]):
        height = own + border if is_relative else own
        # The last strip has no end, and the record that is farthest right holds beyond its t, too.
        across = side * (1.0 if number >= len(strips) - 1 else width)
        if across:
            begin = min(0.0, across)
            a, b, c, d = np.resize([*height(Polynomial([begin, 1.0])).coef, 0.0, 0.0, 0.0], 4).tolist()
            shapes.append(ShapeRecord(s_m, t_m + begin, a, b, c, d))
            border = float(height(across))
        t_m += across
    return shapes
