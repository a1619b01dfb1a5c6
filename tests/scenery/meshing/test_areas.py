"""Areas less others, where outlines cross themselves."""

import pytest
import shapely

from carlaloc_env.core.areas import without

BOW_TIE = shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])
"""Two triangles of 25 m² that meet in the middle; such outlines come from strips that fold."""


def test_an_outline_that_crosses_itself_is_repaired_first() -> None:
    """GEOS refuses it as it is; the areas are those of the triangles less a band."""
    band = shapely.box(-1.0, 4.0, 11.0, 6.0)
    with pytest.raises(shapely.GEOSException):
        shapely.difference(BOW_TIE, band)
    # Of each triangle a strip 2 m high is lost: two trapezia between widths of 5 m and 4 m.
    assert without(BOW_TIE, band).area == pytest.approx(50.0 - 2 * 2 * 0.5 * (5.0 + 4.0) * 1.0, abs=1e-2)
    assert without(shapely.box(0, 0, 10, 10), BOW_TIE).area == pytest.approx(50.0, abs=1e-2)
