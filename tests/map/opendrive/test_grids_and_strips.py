"""Heights of OpenDRIVE 1.8's junction grids and cross-section surfaces against closed forms."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.single_roads import H0, X0, Y0, road, to_world

from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.opendrive.records import OpenDrive
from carlaloc_env.map.opendrive.road_surface import RoadSurface


def coefficients(name: str, a: float, b: float = 0.0, c: float = 0.0) -> str:
    return f'<{name}><coefficients s="0" a="{a}" b="{b}" c="{c}" d="0"/></{name}>'


def strip(number: int, *heights: str, mode: str = "independent", width: str = "") -> str:
    return f'<strip id="{number}" mode="{mode}">{width}{"".join(heights)}</strip>'


def surface(*strips: str, offset: str = "") -> str:
    return (
        f"<crossSectionSurface>{offset}<surfaceStrips>{''.join(strips)}</surfaceStrips></crossSectionSurface>"
    )


def heights(
    xodr: OpenDrive, s: NDArray[np.float64], t: NDArray[np.float64], number: int = 0
) -> NDArray[np.float64]:
    owner = np.full(len(s), number, dtype=np.int64)
    z: NDArray[np.float64] = RoadSurface(xodr.roads).position(owner, s, t)[:, 2]
    return z


def test_strips_of_a_cross_section() -> None:
    """A roof of 2.5 % about t = 0.5 m; outside of 3.5 m a gutter of 6 % to the right, a dish to the left."""
    text = surface(
        strip(1, coefficients("linear", -0.025), width=coefficients("width", 3.5)),
        strip(2, coefficients("linear", -0.06), coefficients("quadratic", 0.02), mode="relative"),
        strip(-1, coefficients("linear", 0.025), width=coefficients("width", 3.5)),
        strip(-2, coefficients("constant", -0.3), coefficients("linear", 0.06)),
        offset=coefficients("tOffset", 0.5),
    )
    xodr = road("<line/>", 40.0, lateral=text)
    assert {note.element for note in xodr.notes} == {"header"}
    t = np.array([-5.0, -3.2, -2.9, 0.0, 0.5, 1.5, 3.9, 4.5, 6.0])
    from_ridge = t - 0.5
    inner = -0.025 * np.abs(from_ridge)
    out = from_ridge - 3.5
    left = np.where(out > 0.0, -0.025 * 3.5 - 0.06 * out + 0.02 * out * out, inner)
    right = np.where(from_ridge < -3.5, -0.3 + 0.06 * (from_ridge + 3.5), inner)
    for s in (0.0, 17.3, 40.0):
        z = heights(xodr, np.full(len(t), s), t)
        np.testing.assert_allclose(z, np.where(t > 0.5, left, right), atol=1e-9)


def test_strips_that_change_along_the_road() -> None:
    """A fall that grows with s² about a ridge that moves with s; between stations it is blended linearly."""
    text = surface(
        strip(1, coefficients("linear", 0.0, 0.0, -4e-5)),
        strip(-1, coefficients("linear", 0.0, 0.0, 4e-5)),
        offset=coefficients("tOffset", -1.0, 0.05),
    )
    xodr = road('<arc curvature="0.01"/>', 40.0, lateral=text)
    s, t = (a.ravel() for a in np.meshgrid(np.linspace(0.0, 40.0, 81), np.linspace(-4.0, 4.0, 17)))
    z = heights(xodr, s, t)
    # The sagitta of a blend over 1 m: an eighth of the second derivative by s, 8e-5 t and the ridge's kink.
    np.testing.assert_allclose(z, -4e-5 * s * s * np.abs(t + 1.0 - 0.05 * s), atol=1e-3)
    at_stations = np.isclose(s, np.round(s))
    np.testing.assert_allclose(
        z[at_stations], (-4e-5 * s * s * np.abs(t + 1.0 - 0.05 * s))[at_stations], atol=1e-9
    )


GRID_LINE = (
    f'<planView><geometry s="0" x="{X0}" y="{Y0}" hdg="{H0}" length="60"><line/></geometry></planView>'
)


def grid_text(values: NDArray[np.float64], most_right: int, *, geometry: str, length: float) -> str:
    """One road in a junction whose grid of 5 m begins at s = 5 m; columns of the values go leftwards."""
    rows = "".join(
        f'<elevation right="{" ".join(map(repr, row[:most_right][::-1].tolist()))}" '
        f'center="{float(row[most_right])!r}" '
        f'left="{" ".join(map(repr, row[most_right + 1 :].tolist()))}"/>'
        for row in values
    )
    lane = '<lane id="-1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane>'
    return (
        '<OpenDRIVE><header revMajor="1" revMinor="8"/>'
        f'<road id="1" length="{length!r}" junction="7">{geometry}'
        '<elevationProfile><elevation s="0" a="99" b="0" c="0" d="0"/></elevationProfile>'
        f'<lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right>{lane}</right>'
        f'</laneSection></lanes></road><junction id="7">{GRID_LINE}'
        f'<elevationGrid gridSpacing="5" sStart="5">{rows}</elevationGrid></junction></OpenDRIVE>'
    )


def curved(length: float) -> str:
    """An arc of radius 20 m from (10, −5) of the grid's line to its left."""
    x, y = to_world(np.array([10.0]), np.array([-5.0]))
    place = f'<geometry s="0" x="{float(x[0])!r}" y="{float(y[0])!r}" hdg="{H0 + 0.4!r}" length="{length!r}">'
    return f'<planView>{place}<arc curvature="0.05"/></geometry></planView>'


def test_a_tilted_plane_lifts_a_curved_road_of_a_junction() -> None:
    """z = 3 + 0.04 u − 0.03 v over the grid, whatever the road's own profile is; the car pitches with it."""
    u, v = np.meshgrid(5.0 + 5.0 * np.arange(10), 5.0 * np.arange(-3, 5), indexing="ij")
    text = grid_text(3.0 + 0.04 * u - 0.03 * v, 3, geometry=curved(20.0), length=20.0)
    xodr = read_opendrive(text.encode())
    assert {note.element for note in xodr.notes} == {"header"}
    surface_ = RoadSurface(xodr.roads)
    s, t = (a.ravel() for a in np.meshgrid(np.linspace(0.0, 20.0, 61), np.linspace(-4.0, 4.0, 9)))
    points = surface_.position(np.zeros(len(s), np.int64), s, t)
    away = points[:, :2] - (X0, Y0)
    along = math.cos(H0) * away[:, 0] + math.sin(H0) * away[:, 1]
    left = -math.sin(H0) * away[:, 0] + math.cos(H0) * away[:, 1]
    # Chords of 0.5 m of a circle of 20 m have a sagitta of 1.6 mm, of which the plane's 5 % are seen.
    np.testing.assert_allclose(points[:, 2], 3.0 + 0.04 * along - 0.03 * left, atol=1e-4)
    pose = build_network(xodr).exact_pose([0], [7.0])
    heading = pose.heading_rad[0] - H0
    rise = 0.04 * math.cos(heading) - 0.03 * math.sin(heading)
    assert math.tan(pose.pitch_rad[0]) == pytest.approx(rise, abs=1e-3)


def test_between_four_points_of_a_grid_heights_are_bilinear_and_beyond_it_level() -> None:
    values = np.array([[0.0, 1.0], [2.0, 5.0]])
    line = GRID_LINE.replace('length="60"', 'length="30"')
    xodr = read_opendrive(grid_text(values, 0, geometry=line, length=30.0).encode())
    s = np.array([5.0, 7.5, 7.5, 10.0, 7.5, 25.0, 25.0])
    t = np.array([0.0, 0.0, 2.5, 5.0, 5.0, 0.0, 7.0])
    np.testing.assert_allclose(heights(xodr, s, t), [0.0, 1.0, 2.0, 5.0, 3.0, 2.0, 5.0], atol=1e-9)


@pytest.mark.parametrize(
    ("good", "bad", "part"),
    [
        ('gridSpacing="5"', 'gridSpacing="0"', "is no grid"),
        ('center="0.0"', "", "is no grid"),
        ('left="0.0"', 'left="0.0 high"', "left='0.0 high'"),
        (GRID_LINE + "<elevationGrid", "<elevationGrid", "lies along no line"),
    ],
)
def test_a_bad_grid_is_named_and_its_roads_keep_their_profiles(good: str, bad: str, part: str) -> None:
    text = grid_text(np.zeros((2, 2)), 0, geometry=GRID_LINE, length=60.0)
    assert read_opendrive(text.encode()).roads[0].elevation[0].a == 0.0
    xodr = read_opendrive(text.replace(good, bad).encode())
    assert xodr.roads[0].elevation[0].a == 99.0
    assert [part in note.message for note in xodr.notes if note.severity == "error"] == [True]
