"""Information of point-to-plane constraints against closed forms, and of scans along routes."""

import functools
from importlib.util import find_spec
from pathlib import Path

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
from movers_hold import DriveScans, HoldAmongMovers, pull_mps

import carlaloc_env
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.ranging_config import LidarConfig
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from recorder.episode.episode import Episode
from recorder.episode.summary import town_of
from recorder.factory import standard_drives

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


@pytest.mark.parametrize("speed", [2.0, -8.0])
def test_movers_pull_by_their_share_of_the_hold(speed: float) -> None:
    """A wall that moves beside one that stands, both centred on the axis: v A / (A + B)."""
    standing, moving = face(8.0 * X, 1.0 * Y, 2.0 * Z), face(-8.0 * X, 2.0 * Y, 2.0 * Z)
    points, normals = joined(*corridor(), standing, moving)
    velocities = np.zeros_like(points)
    velocities[-len(moving[0]) :] = speed * X
    np.testing.assert_allclose(pull_mps(points, normals, velocities), speed * 2.0 / 3.0 * X, atol=1e-9)


def test_what_is_beyond_the_gate_does_not_pull() -> None:
    """At 20 scans a second a surface of 21 m/s is more than 1 m away from where it was; one of 19 is not."""
    points, normals = joined(*corridor(), face(8.0 * X, 1.0 * Y, 2.0 * Z), face(-8.0 * X, 1.0 * Y, 2.0 * Z))
    for speed, pull in ((19.0, 9.5), (21.0, 0.0)):
        velocities = np.where(points[:, :1] < -7.9, speed, 0.0) * X
        np.testing.assert_allclose(pull_mps(points, normals, velocities), pull * X, atol=1e-9)


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


def along(drive: Path, every_ns: int) -> list[HoldAmongMovers]:
    episode = Episode.load(drive)
    timeline = episode.timeline()
    scans = DriveScans(town_of(episode), timeline, LIDAR)
    found = [scans.at(stamp) for stamp in range(every_ns, timeline.end_ns - STEP_NS, every_ns)]
    scans.close()
    return found


@pytest.mark.skipif(find_spec("open3d") is None, reason="Open3D casts the rays of the LiDAR")
def test_normals_and_velocities_of_movers(short_drive: Path) -> None:
    """Normals against the angle at which rays meet triangles; movers are ahead along their velocity later."""
    episode = Episode.load(short_drive)
    timeline = episode.timeline()
    scans, stamp_ns = DriveScans(town_of(episode), timeline, LIDAR), 3_000_000_000
    frame = timeline.actors_at(stamp_ns)
    actor = np.argmax(frame.speed_mps)
    eye = frame.position_m[actor] + (0.0, 0.0, 12.0)
    fall, azimuth = np.meshgrid(
        np.radians(np.arange(50.0, 90.0, 0.5)), np.radians(np.arange(0.0, 360.0, 3.0))
    )
    aimed = np.stack([np.cos(fall) * np.cos(azimuth), np.cos(fall) * np.sin(azimuth), -np.sin(fall)], axis=-1)
    aimed = aimed.reshape(-1, 3)
    hits = scans.cast(eye, aimed, stamp_ns)
    rows = np.flatnonzero(hits.instance == timeline.catalog.id[actor])
    normals, velocities = scans.movers(eye, aimed, stamp_ns, hits, rows)
    scans.close()
    cosines = np.abs(np.einsum("ij,ij->i", normals, aimed))[rows]
    flat = np.linalg.norm(normals[rows], axis=1) > 0.5
    assert flat.sum() > 100
    assert np.median(np.abs(cosines - hits.cos_incidence[rows])[flat]) < 0.02
    heading = frame.heading_rad[actor]
    way = frame.speed_mps[actor] * np.array([np.cos(heading), np.sin(heading)])
    np.testing.assert_allclose(velocities[rows, :2], np.tile(way, (len(rows), 1)), atol=0.3)


@pytest.mark.skipif(find_spec("open3d") is None, reason="Open3D casts the rays of the LiDAR")
def test_movers_hide_what_holds(short_drive: Path) -> None:
    found = along(short_drive, 2_500_000_000)
    assert all(0.01 < one.hidden < 1.0 / 3.0 for one in found)
    assert all(0.0 <= one.share < 0.5 and np.isfinite(one.pull_mps) for one in found)
    assert any(one.hidden != one.at_rest for one in found)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["Town04", "Town06"])
def test_the_motorway_holds_among_its_traffic(name: str, tmp_path: Path) -> None:
    """Nowhere on the standard drive do movers hide more than leaves a tenth of Town03's median."""
    limit = 0.1 * float(np.median(curve("Town03").firm))
    (drive,) = standard_drives(tmp_path, lambda *_: None, towns=(name,))
    assert min(one.hidden for one in along(drive, 500_000_000)) >= limit


@pytest.mark.soak
@pytest.mark.parametrize("name", carlaloc_env.TOWNS)
def test_no_stretch_of_a_hundred_metres_lets_the_car_slip(name: str) -> None:
    """A tenth of Town03's median is the least, with returns from leaves for nothing."""
    limit = 0.1 * float(np.median(curve("Town03").firm))
    length, begin = longest_below(curve(name).station_m, curve(name).firm, limit)
    assert length <= LONGEST_M, f"{length:.0f} m from {begin:.0f} m on"
