"""Information of point-to-plane constraints against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from carlaloc_env.core.array_types import Array
from recorder.slam.localizability import (
    localizability,
    longest_below,
    plane_normals,
    shift_information,
    weakest_stretch,
)

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


def test_a_box_holds_all_shifts_alike() -> None:
    faces = [
        face(s * 3.0 * a, 3.0 * b, 3.0 * c) for s in (1, -1) for a, b, c in ((X, Y, Z), (Y, Z, X), (Z, X, Y))
    ]
    np.testing.assert_allclose(localizability(*joined(*faces)).strengths, 1.0 / 3.0, rtol=1e-9)


@pytest.mark.parametrize("width", [0.4, 2.0, 6.0])
def test_a_cross_wall_holds_by_its_share_of_the_points(width: float) -> None:
    """Centred on the axis it is not coupled to any rotation: λ is its area over the area of all."""
    wall = face(8.0 * X, 0.5 * width * Y, 2.0 * Z)
    scan = joined(*corridor(), wall)
    np.testing.assert_allclose(localizability(*scan).least, 4.0 * width / (4.0 * width + 400.0), rtol=1e-9)


def test_one_post_beside_the_road_is_taken_for_a_turn_where_nothing_else_holds_the_heading() -> None:
    """On a bare plane a face off the axis holds a mixture of yaw and shift; walls settle the yaw."""
    floor, post = face(-2.0 * Z, 20.0 * X, 3.0 * Y), face(10.0 * X + 5.0 * Y, 0.05 * Y, 1.0 * Z)
    assert localizability(*joined(floor, post)).least < 1e-6
    assert localizability(*joined(*corridor(), post)).strengths[0] > 0.8 * 0.2 / 400.2


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


def test_planes_are_found_in_noisy_points_and_none_on_lines_and_in_leaves() -> None:
    draw = np.random.default_rng(2)
    wall = np.column_stack(
        [draw.uniform(0, 6, 3000), 0.01 * draw.normal(size=3000), draw.uniform(0, 3, 3000)]
    )
    normals = plane_normals(wall)
    assert (np.abs(normals[:, 1]) > 0.95).mean() > 0.97
    leaves = draw.uniform(0, 3.0, (3000, 3))
    assert (plane_normals(leaves, roughness_m=0.05) == 0.0).all(axis=1).mean() > 0.95
    ring = np.column_stack(
        [np.arange(0, 30, 0.05), 1e-3 * draw.normal(size=600), 1e-3 * draw.normal(size=600)]
    )
    assert not plane_normals(ring).any()
    assert not plane_normals(wall[:5]).any()


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
