"""Reads the shape of roads: plan view, elevation and other profiles."""

from collections.abc import Iterable
from dataclasses import replace

from carlaloc_env.map.opendrive.records import GEOMETRY_KINDS, Cubic, Geometry, ShapeRecord
from carlaloc_env.map.opendrive.xml_document import Document, Element

PROJECTED_LIMIT = 1.0e8
"""Coordinates beyond this are those of no projection of the Earth [m]."""
COEFFICIENT_LIMIT = 1.0e12
"""Polynomial coefficients beyond this are refused; real files reach 1e9 on pieces of 1e-7 m."""
CURVATURE_LIMIT_RADPM = 1.0e4
"""Curvatures beyond this can only come from broken files [1/m]."""
SPIRAL_TURN_LIMIT_RAD = 30.0
"""A spiral that may turn further is refused: it would cost unbounded time to integrate."""


def read_plan_view(document: Document, road: Element) -> tuple[Geometry, ...]:
    """All ``<geometry>`` of a road in ascending s, without pieces of no length."""
    elements = road.findall("planView/geometry")
    if not elements:
        document.fail(road, "has no <planView> with a <geometry>", "add its reference line")
    pieces = sorted((_geometry(document, e) for e in elements), key=lambda g: g.s_m)
    long = tuple(g for g in pieces if g.length_m > 0.0)
    if len(long) < len(pieces):
        document.note(road, f"{len(pieces) - len(long)} of its {len(pieces)} <geometry> have length 0")
    return long or tuple(pieces[:1])


def read_cubics(
    document: Document, elements: Iterable[Element], s_name: str = "s", *, start_m: float = 0.0
) -> tuple[Cubic, ...]:
    """Records a, b, c, d in ascending s, with `start_m` added to s; without repeats of one s."""

    def read(element: Element) -> Cubic:
        s = document.number(element, s_name, 0.0 if s_name == "sOffset" else None) + start_m
        return Cubic(s, *(document.number(element, k, 0.0, limit=COEFFICIENT_LIMIT) for k in "abcd"))

    return tuple(sorted(document.each(elements, read), key=lambda record: record.s_m))


def read_shapes(document: Document, road: Element) -> tuple[ShapeRecord, ...]:
    """Lateral shapes of a road, ascending in s, then t."""

    def read(element: Element) -> ShapeRecord:
        return ShapeRecord(
            document.number(element, "s"),
            document.number(element, "t"),
            *(document.number(element, k, 0.0, limit=COEFFICIENT_LIMIT) for k in "abcd"),
        )

    records = document.each(road.findall("lateralProfile/shape"), read)
    return tuple(sorted(records, key=lambda record: (record.s_m, record.t_m)))


def _geometry(document: Document, element: Element) -> Geometry:
    shape = next((child for child in element if child.tag in GEOMETRY_KINDS), None)
    if shape is None:
        document.fail(element, "holds no line, arc, spiral, poly3 or paramPoly3", "add one")
    place = Geometry(
        s_m=document.number(element, "s"),
        # Coordinates of a map projection, which the reader moves near the origin, are large.
        x_m=document.number(element, "x", limit=PROJECTED_LIMIT),
        y_m=document.number(element, "y", limit=PROJECTED_LIMIT),
        heading_rad=document.number(element, "hdg"),
        length_m=document.length(element, "length"),
        kind="line",
        line=document.line(element),
    )
    if shape.tag == "line":
        return place
    if shape.tag == "arc":
        k = document.number(shape, "curvature", limit=CURVATURE_LIMIT_RADPM)
        return replace(place, kind="arc", curvature_start_radpm=k, curvature_end_radpm=k)
    if shape.tag == "spiral":
        k0 = document.number(shape, "curvStart", limit=CURVATURE_LIMIT_RADPM)
        k1 = document.number(shape, "curvEnd", limit=CURVATURE_LIMIT_RADPM)
        if max(abs(k0), abs(k1)) * place.length_m > SPIRAL_TURN_LIMIT_RAD:
            document.fail(shape, "turns more than 30 rad", "split it or correct its curvature")
        return replace(place, kind="spiral", curvature_start_radpm=k0, curvature_end_radpm=k1)
    return _polynomial(document, shape, place)


def _polynomial(document: Document, shape: Element, place: Geometry) -> Geometry:
    def coefficients(names: tuple[str, ...]) -> tuple[float, float, float, float]:
        a, b, c, d = (document.number(shape, n, 0.0, limit=COEFFICIENT_LIMIT) for n in names)
        return a, b, c, d

    if shape.tag == "poly3":
        v = coefficients(("a", "b", "c", "d"))
        return replace(place, kind="poly3", v_poly=v, p_max=place.length_m)
    span = shape.get("pRange", "normalized")
    if span not in ("normalized", "arcLength"):
        document.fail(shape, f"has pRange='{span[:40]}'", "write normalized or arcLength")
    return replace(
        place,
        kind="paramPoly3",
        u_poly=coefficients(("aU", "bU", "cU", "dU")),
        v_poly=coefficients(("aV", "bV", "cV", "dV")),
        p_max=1.0 if span == "normalized" else place.length_m,
    )
