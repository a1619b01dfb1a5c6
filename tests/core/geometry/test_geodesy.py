"""WGS84 against published values and against its own inverse."""

import numpy as np
import pytest

from carlaloc_env.core.geodesy import GeoReference, ecef_to_geodetic, geodetic_to_ecef

POLAR_RADIUS_M = 6_356_752.314245  # NIMA TR8350.2, table 3.3


def test_equator_and_pole() -> None:
    assert np.allclose(geodetic_to_ecef([0, 0, 0]), [6_378_137.0, 0, 0], atol=1e-9)
    assert np.allclose(geodetic_to_ecef([0, 90, 10]), [0, 6_378_147.0, 0], atol=1e-8)
    assert np.allclose(geodetic_to_ecef([90, 0, 0]), [0, 0, POLAR_RADIUS_M], atol=1e-5)


def test_published_point() -> None:
    """42°N 82°W 200 m: the example of the pymap3d and MATLAB documentation."""
    assert np.allclose(
        geodetic_to_ecef([42.0, -82.0, 200.0]),
        [660_675.2518247, -4_700_948.68316, 4_245_737.66222],
        atol=1e-4,
    )


@pytest.mark.parametrize(("latitude", "metres"), [(0.0, 110_574.0), (60.0, 111_412.0)])
def test_length_of_a_degree(latitude: float, metres: float) -> None:
    """A sphere, as in CARLA, would be off by up to 0.7 %."""
    geo = GeoReference(latitude_deg=latitude, longitude_deg=8.0)
    half = 0.5e-3
    north = geo.geodetic_to_enu([[latitude + half, 8.0, 0.0], [latitude - half, 8.0, 0.0]])
    assert (north[0, 1] - north[1, 1]) * 1000 == pytest.approx(metres, abs=1.0)


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 35.0, 49.0, 89.0])
def test_round_trip_in_a_town(latitude: float) -> None:
    """Below a nanometre rms; single points meet the resolution of degrees in float64 (0.8 nm)."""
    geo = GeoReference(latitude_deg=latitude, longitude_deg=8.4, height_m=115.0)
    world = np.random.default_rng(1).uniform([-1000, -1000, -50], [1000, 1000, 150], (2000, 3))
    error = geo.geodetic_to_enu(geo.enu_to_geodetic(world)) - world
    assert np.sqrt(np.mean(error**2)) < 1e-9
    assert np.abs(error).max() < 5e-9


def test_one_metre_north_east_and_up() -> None:
    geo = GeoReference(latitude_deg=49.0, longitude_deg=8.4, height_m=100.0)
    origin, east, north, up = geo.enu_to_geodetic([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert np.allclose(origin, [49.0, 8.4, 100.0], atol=1e-9)
    assert east[1] > 8.4
    assert abs(east[0] - 49.0) < 1e-9
    assert (north[0] - 49.0) * 111_207.0 == pytest.approx(1.0, abs=1e-3)
    assert up[2] == pytest.approx(101.0, abs=1e-8)


def test_same_bytes_for_one_point_and_for_many() -> None:
    geo = GeoReference(latitude_deg=49.0, longitude_deg=8.4)
    points = np.random.default_rng(2).uniform(-500, 500, (101, 3))
    many = geo.enu_to_geodetic(points)
    assert all(np.array_equal(geo.enu_to_geodetic(p), row) for p, row in zip(points, many, strict=True))


def test_inverse_far_from_the_ground() -> None:
    grid = np.array(
        [[lat, lon, h] for lat in (-89, -45, 0.1, 70) for lon in (-179, 0, 91) for h in (-400, 9000)]
    )
    assert np.allclose(ecef_to_geodetic(geodetic_to_ecef(grid)), grid, rtol=0, atol=1e-8)
