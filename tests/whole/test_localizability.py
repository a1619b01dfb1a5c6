"""Information of point-to-plane constraints against closed forms, and of scans along routes."""

import functools
from importlib.util import find_spec

import numpy as np
import pytest
from localizability import (
    RouteLocalizability,
    localizability,
    longest_below,
    route_localizability,
    shift_information,
    weakest_stretch,
)

import carlaloc_env
from carlaloc_env.core.array_types import Array
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town

LIDAR = next(c for c in rig_by_name("paper").sensors if isinstance(c, LidarConfig))
LONGEST_M = 100.0
X, Y, Z = np.eye(3)


def face(centre: Array, one: Array, other: Array, spacing: float = 0.1) -> tuple[Array, Array]:
    """Points of a rectangle at equal distances and their normals; `one` and `other` are half its sides."""
    counts = [max(round(2 * float(np.linalg.norm(side)) / spacing), 1) for side in (one, other)]
    u, v = (((np.arange(n) + 0.5) / n * 2 - 1) for n in counts)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    normal = np.cross(one, other)
    return centre + grid @ np.array([one, other]), np.tile(normal / np.linalg.norm(normal), (len(grid), 1))


def joined(*faces: tuple[Array, Array]) -> tuple[Array, Array]:
    """Several faces as one scan."""
    return np.concatenate([f[0] for f in faces]), np.concatenate([f[1] for f in faces])


def corridor(length: float = 20.0, width: float = 6.0, height: float = 4.0) -> list[tuple[Array, Array]]:
    """Floor, ceiling and both walls of a corridor along x."""
    half = 0.5 * length * X
    sides = [face(s * 0.5 * width * Y, half, 0.5 * height * Z) for s in (1.0, -1.0)]
    return sides + [face(s * 0.5 * height * Z, half, 0.5 * width * Y) for s in (1.0, -1.0)]


def test_a_plane_holds_one_of_three_shifts() -> None:
    found = localizability(*face(-1.85 * Z, 30.0 * X, 10.0 * Y, 0.5))
    np.testing.assert_allclose(found.strengths, [0.0, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(np.abs(found.directions[:, 2]), Z, atol=1e-9)


def test_a_corridor_lets_the_car_slip_along_it() -> None:
    found = localizability(*joined(*corridor()))
    np.testing.assert_allclose(found.least, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.abs(found.weakest), X, atol=1e-9)
    # Two of its four faces are walls: 4 m of 20 m around.
    np.testing.assert_allclose(found.strengths[1:], [8.0 / 20.0, 12.0 / 20.0], atol=1e-9)


@pytest.mark.parametrize("width", [0.4, 2.0, 6.0])
def test_a_cross_wall_holds_by_its_share_of_the_points(width: float) -> None:
    """Centred on the axis it is not coupled to any rotation: λ is its area over the area of all."""
    wall = face(8.0 * X, 0.5 * width * Y, 2.0 * Z)
    scan = joined(*corridor(), wall)
    np.testing.assert_allclose(localizability(*scan).least, 4.0 * width / (4.0 * width + 400.0), rtol=1e-9)


def test_it_is_the_inverse_of_the_marginal_covariance_along_any_axes() -> None:
    """The complement against the covariance of all six, inverted as a whole."""
    draw = np.random.default_rng(4)
    points, normals = draw.normal(size=(500, 3)) * 10.0, draw.normal(size=(500, 3)) * (1.0, 0.3, 0.1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    jacobian = np.concatenate([np.cross(points, normals), normals], axis=1)
    covariance = np.linalg.inv(jacobian.T @ jacobian / len(points))[3:, 3:]
    expected = 1.0 / np.linalg.eigvalsh(covariance)[::-1]
    turn = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    np.testing.assert_allclose(localizability(points, normals).strengths, expected, rtol=1e-9)
    np.testing.assert_allclose(
        localizability(points @ turn.T, normals @ turn.T).strengths, expected, rtol=1e-9
    )


def test_points_without_a_plane_dilute() -> None:
    points, normals = joined(*corridor(), face(8.0 * X, 3.0 * Y, 2.0 * Z))
    twice = shift_information(np.concatenate([points] * 2), np.concatenate([normals, 0.0 * normals]))
    np.testing.assert_allclose(twice, 0.5 * shift_information(points, normals), atol=1e-12)
    assert localizability(np.zeros((0, 3)), np.zeros((0, 3))).least == 0.0


def test_stretches() -> None:
    station = np.arange(0.0, 100.0, 5.0)
    values = np.full(20, 1.0)
    values[4:10] = 0.1
    values[15] = 0.0
    assert longest_below(station, values, 0.5) == (30.0, 20.0)
    assert longest_below(station, values, -1.0) == (0.0, 0.0)
    mean, begin = weakest_stretch(station, values, 30.0)
    assert (round(mean, 9), begin) == (0.1, 20.0)
    assert weakest_stretch(station, values, 1e3) == (pytest.approx(values.mean()), 0.0)


@functools.cache
def curve(name: str) -> RouteLocalizability:
    return route_localizability(load_town(name), LIDAR)


@pytest.mark.skipif(find_spec("open3d") is None, reason="Open3D casts the rays of the LiDAR")
def test_streets_hold_the_car_and_leaves_hold_nothing(town03: Town) -> None:
    found = route_localizability(town03, LIDAR, step_m=240.0)
    assert len(found.station_m) == int(np.ceil(town03.route.length_m / 240.0))  # type: ignore[union-attr]
    assert (found.least < 1.0 / 3.0).all()
    assert (found.firm > 0.01).all()
    assert (found.firm <= found.least + 1e-12).all()
    assert (found.along <= 1.0 + 1e-9).all()


@pytest.mark.soak
@pytest.mark.parametrize("name", carlaloc_env.TOWNS)
def test_no_stretch_of_a_hundred_metres_lets_the_car_slip(name: str) -> None:
    """A tenth of Town03's median is the least, with returns from leaves for nothing."""
    limit = 0.1 * float(np.median(curve("Town03").firm))
    length, begin = longest_below(curve(name).station_m, curve(name).firm, limit)
    assert length <= LONGEST_M, f"{length:.0f} m from {begin:.0f} m on"
