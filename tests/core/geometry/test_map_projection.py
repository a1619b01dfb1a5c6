"""Projected worlds: against the plane that touches there, and closed forms."""

import math

import numpy as np
import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.core.map_projection import area_of_use, projected_reference

UTM = "+proj=utm +zone=32 +datum=WGS84 +units=m"
MUNICH = projected_reference(UTM, 691_000.0, 5_336_000.0, height_m=500.0)


def test_origin_and_convergence() -> None:
    """The convergence by γ = atan(tan(λ − λ₀)·sin φ), which is 0.1 % right three degrees off the meridian."""
    lat, lon = math.radians(MUNICH.latitude_deg), math.radians(MUNICH.longitude_deg - 9.0)
    assert (MUNICH.latitude_deg, MUNICH.longitude_deg) == pytest.approx((48.1485463, 11.5679498), abs=1e-7)
    assert MUNICH.azimuth_rad == pytest.approx(math.atan(math.tan(lon) * math.sin(lat)), rel=1e-3)


def test_near_the_origin_it_is_the_touching_plane_turned_by_the_convergence() -> None:
    plane = GeoReference(
        latitude_deg=MUNICH.latitude_deg, longitude_deg=MUNICH.longitude_deg, height_m=MUNICH.height_m
    )
    world = np.array([[100.0, 0.0, 0.0], [0.0, 100.0, 5.0], [-70.0, 70.0, -5.0]])
    east, north, up = plane.geodetic_to_enu(MUNICH.enu_to_geodetic(world)).T
    c, s = math.cos(MUNICH.azimuth_rad), math.sin(MUNICH.azimuth_rad)
    turned = np.column_stack([c * world[:, 0] + s * world[:, 1], c * world[:, 1] - s * world[:, 0]])
    # The scale of UTM is within 4e-4 of 1.
    np.testing.assert_allclose(np.column_stack([east, north]), turned, atol=0.05)
    np.testing.assert_allclose(up, world[:, 2], atol=0.01)


def test_heights_are_heights_and_points_come_back() -> None:
    """Nine kilometres off a plane would be 6 m too high; there and back is a micrometre."""
    world = np.random.default_rng(1).uniform(-9000.0, 9000.0, (200, 3)) * (1.0, 1.0, 0.01)
    geodetic = MUNICH.enu_to_geodetic(world)
    np.testing.assert_array_equal(geodetic[:, 2], world[:, 2] + 500.0)
    np.testing.assert_allclose(MUNICH.geodetic_to_enu(geodetic), world, atol=2e-6)
    alone = [MUNICH.enu_to_geodetic(point) for point in world[:5]]
    np.testing.assert_array_equal(alone, geodetic[:5])


def test_a_turned_world_lies_where_its_grid_points_do() -> None:
    turned = projected_reference(UTM, 691_000.0, 5_336_000.0, height_m=500.0, turn_rad=0.3)
    x, y = 120.0, -40.0
    grid = (math.cos(0.3) * x - math.sin(0.3) * y, math.sin(0.3) * x + math.cos(0.3) * y, 7.0)
    found = turned.enu_to_geodetic([x, y, 7.0])
    np.testing.assert_allclose(found, MUNICH.enu_to_geodetic(grid), atol=1e-10)
    np.testing.assert_allclose(turned.geodetic_to_enu(found), [x, y, 7.0], atol=2e-6)
    assert turned.azimuth_rad == pytest.approx(MUNICH.azimuth_rad - 0.3, abs=1e-9)


def test_directions_and_covariances_turn_with_the_grid() -> None:
    """What stands due north lies to the grid's left; variances about world axes come out about true ones."""
    plane = GeoReference(latitude_deg=MUNICH.latitude_deg, longitude_deg=MUNICH.longitude_deg)
    from carlaloc_env.core.geodesy import geodetic_to_ecef

    ahead = geodetic_to_ecef(plane.enu_to_geodetic([0.0, 1e4, 0.0]))
    x, y, _ = MUNICH.ecef_to_enu(ahead)
    assert math.atan2(x, y) == pytest.approx(-MUNICH.azimuth_rad, abs=1e-6)
    c, s = math.cos(MUNICH.azimuth_rad), math.sin(MUNICH.azimuth_rad)
    along_y = np.array([s, c, 0.0])
    covariance = MUNICH.covariance_enu(np.diag([1.0, 9.0, 4.0]))
    assert along_y @ covariance @ along_y == pytest.approx(9.0)
    assert np.trace(covariance) == pytest.approx(14.0)


def test_feet_are_read_as_the_metres_of_the_file() -> None:
    """California zone 3 counts in feet, OpenDRIVE in metres."""
    feet = projected_reference("EPSG:2227", 1_830_000.0, 650_000.0)
    metres = projected_reference("EPSG:26943", 1_830_000.0, 650_000.0)
    assert feet.latitude_deg == pytest.approx(metres.latitude_deg, abs=2e-5)
    assert feet.longitude_deg == pytest.approx(metres.longitude_deg, abs=2e-5)


@pytest.mark.parametrize("text", ["+proj=longlat +datum=WGS84", "EPSG:4978", "rubbish", "EPSG:999999", ""])
def test_no_projection_is_named(text: str) -> None:
    with pytest.raises(ConfigError):
        projected_reference(text, 0.0, 0.0)


def test_areas_of_use() -> None:
    assert area_of_use("EPSG:32632") == (6.0, 0.0, 12.0, 84.0)
    assert area_of_use(UTM) == (6.0, 0.0, 12.0, 84.0)
    assert area_of_use(UTM + " +south") == (6.0, -80.0, 12.0, 0.0)
    assert area_of_use("+proj=tmerc +lat_0=48 +lon_0=11.5 +datum=WGS84") == (5.5, -90.0, 17.5, 90.0)
