"""Points on surfaces, visibility, ghosts and scores, against closed forms."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.processes.small_disks import small_disk

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import ConfigError, EvaluationError, OutputError
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, make_mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.dataset.scans import Scan
from recorder.evaluation.align import Alignment, Similarity
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.trajectory import Trajectory
from recorder.laboratory.map_scores import (
    ALL,
    HIDDEN,
    VISIBLE,
    GhostRule,
    MapScore,
    find_ghosts,
    measure,
    score_map,
)
from recorder.laboratory.map_truth import build_map, thinned, transform_of_map
from recorder.laboratory.surface_cloud import Region, read_map, sample_surface, write_cloud, write_mesh
from recorder.laboratory.true_map import TrueMap, ever_visible

resource = pytest.importorskip("resource", reason="needs limits of files")
o3d = pytest.importorskip("open3d", reason="open3d is not installed")


def sphere(radius_m: float) -> Mesh:
    ball = o3d.geometry.TriangleMesh.create_sphere(radius_m, resolution=60)
    return make_mesh(
        np.asarray(ball.vertices), np.asarray(ball.triangles), material=Material.PLAIN, tag=Tag.BUILDING
    )


@contextmanager
def small_files(folder: Path, size_bytes: int) -> Iterator[Path]:
    """A folder whose files may not grow beyond a size."""
    folder.mkdir(exist_ok=True)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, before[1]))
    try:
        yield folder
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("limited", [small_disk, small_files])
@pytest.mark.parametrize("name", ["cloud.ply", "mesh.ply", "mesh.gltf"])
def test_a_map_that_open3d_cuts_is_an_error_and_no_file(name: str, limited: Any, tmp_path: Path) -> None:
    mesh = sphere(5.0)
    cloud = sample_surface(mesh, points_per_m2=20.0)

    def write(folder: Path) -> Path:
        return write_cloud(cloud, folder / name) if "cloud" in name else write_mesh(mesh, folder / name)

    size = write(tmp_path).stat().st_size
    for share in (0.1, 0.6, 0.97):
        with limited(tmp_path / "limited", round(share * size) // 4096 * 4096) as folder:
            with pytest.raises(OutputError, match=r"^cannot write .*: .*; choose another place") as failure:
                write(folder)
            assert "\n" not in str(failure.value)
            assert not list(folder.iterdir())


def scores(points_m: Any, mesh: Mesh, distances_m: tuple[float, ...], visible: Any = None) -> list[MapScore]:
    surface = sample_surface(mesh, points_per_m2=40.0)
    seen = np.ones(len(surface), bool) if visible is None else visible(surface)
    found = measure(points_m, TrueMap(mesh).nearest(points_m), surface, seen)
    return list(score_map(found, distances_m))


def whole(rows: list[MapScore], part: str = ALL, tag: str = ALL) -> list[MapScore]:
    return [row for row in rows if (row.part, row.tag) == (part, tag)]


def test_points_are_even_over_area_and_carry_normal_and_class(scenery: Any) -> None:
    road = scenery.ground(half_m=10.0)
    wall = scenery.box([20.0, 0.0, 0.0], [24.0, 2.0, 3.0], tag=Tag.WALL)  # 2 (8 + 12 + 6) = 52 m²
    cloud = sample_surface(merge([road, wall]), points_per_m2=25.0, seed=3)
    assert len(cloud) == 25 * (400 + 52)
    # One point in each of N equal parts: counts are off by the parts at the ends alone.
    assert np.count_nonzero(cloud.tag == Tag.WALL) == pytest.approx(25 * 52, abs=2)
    on_road = cloud.points_xyz_m[cloud.tag == Tag.ROAD]
    counts = np.histogram2d(*on_road[:, :2].T, bins=10, range=[[-10, 10]] * 2)[0]
    assert (np.abs(counts - 100.0) < 5.0 * 10.0).all()  # binomial, five sigma
    assert np.abs(on_road.mean(axis=0)).max() < 5.0 * 20.0 / np.sqrt(12.0 * len(on_road))
    assert np.array_equal(cloud.normals[cloud.tag == Tag.ROAD], np.tile([0.0, 0.0, 1.0], (len(on_road), 1)))
    away = cloud.points_xyz_m[cloud.tag == Tag.WALL] - [22.0, 1.0, 1.5]
    assert (np.sum(away * cloud.normals[cloud.tag == Tag.WALL], axis=1) > 0.0).all()  # outward
    again, other = (sample_surface(merge([road, wall]), points_per_m2=25.0, seed=s) for s in (3, 4))
    assert np.array_equal(cloud.points_xyz_m, again.points_xyz_m)
    assert not np.array_equal(cloud.points_xyz_m, other.points_xyz_m)
    with pytest.raises(ConfigError, match="points per m²"):
        sample_surface(road, points_per_m2=0.0)


def test_a_region_is_a_disc_of_the_same_density(scenery: Any) -> None:
    region = Region(np.array([[3.0, 4.0]]), 5.0)
    cloud = sample_surface(scenery.ground(half_m=100.0), points_per_m2=30.0, region=region)
    assert np.hypot(*(cloud.points_xyz_m[:, :2] - [3.0, 4.0]).T).max() <= 5.0
    expected = 30.0 * np.pi * 25.0
    assert len(cloud) == pytest.approx(expected, abs=5.0 * np.sqrt(expected))


def test_files_keep_labels_and_axes(tmp_path: Path, scenery: Any) -> None:
    mesh = scenery.box([0.0, 0.0, 0.0], [1.0, 2.0, 3.0], tag=Tag.POLE)
    cloud = sample_surface(mesh, points_per_m2=10.0)
    written = o3d.t.io.read_point_cloud(str(write_cloud(cloud, tmp_path / "c.ply")))
    assert np.array_equal(written.point.positions.numpy(), cloud.points_xyz_m)
    assert np.array_equal(written.point.normals.numpy(), cloud.normals)
    assert np.array_equal(written.point.label.numpy()[:, 0], cloud.tag)
    assert np.array_equal(read_map(tmp_path / "c.ply"), cloud.points_xyz_m.astype(np.float64))
    ply = o3d.io.read_triangle_mesh(str(write_mesh(mesh, tmp_path / "m.ply")))
    assert ply.get_max_bound() == pytest.approx([1.0, 2.0, 3.0])
    assert np.asarray(ply.vertex_colors)[0] * 255 == pytest.approx([153, 153, 153])  # CARLA's poles
    up = o3d.io.read_triangle_mesh(str(write_mesh(mesh, tmp_path / "m.gltf")))
    assert up.get_max_bound() == pytest.approx([1.0, 3.0, 0.0])  # up is +y, north −z
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.ply", "m.gltf", "m.ply"]
    (tmp_path / "empty.xyz").write_text("")
    for name, words in (("empty.xyz", "has no points"), ("no.ply", "no such file"), ("m.gltf", "no map")):
        with pytest.raises(EvaluationError, match=words):
            read_map(tmp_path / name)


@pytest.mark.parametrize("shift_m", [0.03, 0.15])
def test_a_map_shifted_off_a_plane_is_as_accurate_as_its_shift(scenery: Any, shift_m: float) -> None:
    x, y = np.meshgrid(np.arange(-9.95, 10.0, 0.1), np.arange(-9.95, 10.0, 0.1))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, shift_m)])
    low, high = whole(scores(points, scenery.ground(half_m=10.0), (0.02, 0.3)))
    assert low.accuracy_m == pytest.approx(shift_m, abs=1e-5)
    assert (low.precision, low.recall, low.f_score) == (0.0, 0.0, 0.0)
    assert (high.precision, high.recall, high.f_score) == (1.0, 1.0, 1.0)
    # Mean of √(d² + r²) over a cell of the grid, r from its middle.
    u = (np.arange(200) + 0.5) / 200 * 0.05
    cell = np.sqrt(shift_m**2 + u[:, None] ** 2 + u**2).mean()
    assert low.completeness_m == pytest.approx(cell, rel=0.01)


def test_a_swollen_sphere(scenery: Any) -> None:
    points = sample_surface(sphere(2.1), points_per_m2=200.0).points_xyz_m.astype(np.float64)
    (row,) = whole(scores(points, sphere(2.0), (0.12,)))
    assert row.accuracy_m == pytest.approx(0.1, rel=0.02)
    assert (row.precision, row.tag, row.map_points) == (1.0, ALL, len(points))


def test_half_of_a_surface_missing_by_class_and_visibility(scenery: Any) -> None:
    mesh = merge([scenery.ground(half_m=10.0), scenery.box([-1.0, -1.0, 5.0], [1.0, 1.0, 6.0], tag=Tag.WALL)])
    x, y = np.meshgrid(np.arange(-9.975, 0.0, 0.05), np.arange(-9.975, 10.0, 0.05))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    rows = scores(points, mesh, (0.1,), lambda surface: surface.points_xyz_m[:, 0] < 0.0)
    (road,) = whole(rows, tag="road")
    assert (road.precision, road.accuracy_m) == (1.0, pytest.approx(0.0, abs=1e-6))
    assert road.recall == pytest.approx(0.5 + 0.1 / 20.0, abs=0.01)
    assert road.f_score == pytest.approx(2 * road.recall / (1 + road.recall))
    (seen,), (hidden,) = whole(rows, VISIBLE, "road"), whole(rows, HIDDEN, "road")
    assert (seen.recall, seen.surface_points + hidden.surface_points) == (1.0, road.surface_points)
    assert hidden.recall < 0.02
    (wall,) = whole(rows, tag="wall")
    assert (wall.map_points, wall.recall) == (0, 0.0)
    assert np.isnan(wall.precision)
    with pytest.raises(EvaluationError, match="no point near the drive"):
        scores(np.zeros((0, 3)), mesh, (0.1,))
    with pytest.raises(ConfigError, match="above 0 m"):
        scores(points, mesh, (0.0,))


def test_visible_is_in_range_between_the_beams_and_not_hidden(scenery: Any) -> None:
    lidar = LidarConfig(mount=Mount(position_m=(0.0, 0.0, 2.0)), elevations_deg=(-20.0, 10.0), range_max_m=60)
    world = scenery.world(
        [scenery.ground(), scenery.box([20.0, -5.0, 0.0], [21.0, 5.0, 4.0])], {"saloon": scenery.box(
            [-1.0, -1.0, 0.0], [1.0, 1.0, 3.0], tag=Tag.CAR)}
    )  # fmt: skip
    still = scenery.drive(
        scenery.straight(),
        0.2,
        scenery.catalog(["saloon"]),
        lambda t: scenery.frame([[0.0, 30.0, 0.0]], [0.0]),
    )
    points = np.array(
        [
            [15.0, 0.0, 0.0], [4.0, 0.0, 0.0], [20.0, 0.0, 3.9], [30.0, 0.0, 0.0], [21.0, 0.0, 2.0],
            [0.0, 50.0, 0.0], [0.0, -50.0, 0.0], [0.0, -61.0, 0.0],
        ]
    )  # fmt: skip
    seen = ever_visible(points, world.rays(), still, lidar, np.array([0]))
    # Under the lowest beam; behind the box; its far side; behind the car; beyond the range.
    assert seen.tolist() == [True, False, True, False, False, False, True, False]
    driven = scenery.drive(scenery.straight(40.0), 2.0)
    late = ever_visible(points, world.rays(), driven, lidar, np.array([0, 2_000_000_000]))
    assert late.tolist() == [True, False, True, True, True, True, True, False]


def test_planted_ghosts_are_all_found_and_nothing_else(scenery: Any) -> None:
    rng = np.random.default_rng(1)
    catalog = scenery.catalog(["car", "car"])  # boxes of 2 m
    turn = 0.5

    def frame(t: float) -> Any:
        way = 10.0 * t * np.array([np.cos(turn), np.sin(turn), 0.0])
        return scenery.frame([way, [0.0, 40.0, 0.0]], [turn, 0.0], 10.0)

    timeline = scenery.drive(scenery.straight(), 2.0, catalog, frame)
    along, across, up = rng.uniform(-1.0, 21.0, 500), rng.uniform(-1.0, 1.0, 500), rng.uniform(0.35, 2.0, 500)
    c, s = np.cos(turn), np.sin(turn)
    swept = np.column_stack([c * along - s * across, s * along + c * across, up])
    beside = swept + 2.5 * np.array([-s, c, 0.0])
    standing = rng.uniform([-1, 39, 0.35], [1, 41, 2], (50, 3))
    road = np.column_stack([swept[:, :2], rng.uniform(-0.05, 0.05, 500)])
    points = np.concatenate([swept, standing, beside, road])
    distance = TrueMap(scenery.ground()).nearest(points)[0]
    ghost = find_ghosts(points, distance, timeline, (0, 2_000_000_000))
    assert ghost.tolist() == [True] * 550 + [False] * 1000
    half = find_ghosts(points, distance, timeline, (0, 1_000_000_000), GhostRule(margin_m=0.0))
    assert half[:500].tolist() == (along <= 11.0).tolist()
    alone = timeline.select_actors(np.zeros(0, np.intp))
    assert not find_ghosts(points, distance, alone, (0, 2_000_000_000)).any()


def test_boxes_lean_as_their_road(scenery: Any) -> None:
    catalog = scenery.catalog(["car"])
    pitch, roll = 0.3, -0.2
    timeline = scenery.drive(
        scenery.straight(),
        0.1,
        catalog,
        lambda t: scenery.frame([[5.0, 5.0, 1.0]], [0.7], pitch_rad=pitch, roll_rad=roll),
    )
    R = transforms.quat_to_matrix(transforms.rpy_to_quat(roll, -pitch, 0.7))
    local = np.random.default_rng(2).uniform([-2, -2, -1], [2, 2, 3], (2000, 3))
    inside = (np.abs(local[:, :2]) <= 1.0).all(axis=1) & (local[:, 2] >= 0.0) & (local[:, 2] <= 2.0)
    points = local @ R.T + [5.0, 5.0, 1.0]
    found = find_ghosts(points, np.full(2000, 9.0), timeline, (0, 0), GhostRule(margin_m=0.0))
    assert 100 < inside.sum() < 1900
    assert np.count_nonzero(found != inside) <= 2  # single precision at the faces


def test_a_map_of_sweeps_is_laid_at_each_points_own_time() -> None:
    """A LiDAR that drives and turns looks at one place: all its points fall together."""
    stamps = np.arange(0, 400_000_000, 10_000_000)
    t = stamps * 1e-9
    quat = transforms.rpy_to_quat(0 * t, 0 * t, 1.5 * t)
    poses = Trajectory(stamp_ns=stamps, position_m=np.column_stack([20 * t, 0 * t, 0 * t]), quat_xyzw=quat)
    place = np.array([7.1, 9.2, 1.1])
    scans = []
    for first in (0, 20):
        own = transforms.quat_rotate(transforms.quat_conjugate(quat), place - poses.position_m)[first:][:15]
        order = np.random.default_rng(0).permutation(15)
        scans.append(
            Scan(stamp_ns=int(stamps[first]), points_xyz_m=own[order], time_s=0.01 * np.arange(15)[order])
        )
    assert build_map(scans, poses, voxel_m=0.0) == pytest.approx(np.tile(place, (30, 1)), abs=1e-9)
    assert build_map(scans, poses, voxel_m=0.5).shape == (1, 3)
    grid = thinned(np.array([[0.1, 0.1, -0.1], [0.4, 0.2, -0.2], [0.6, 0.1, -0.1]]), 0.5)
    assert grid.tolist() == [[0.1, 0.1, -0.1], [0.6, 0.1, -0.1]]


@pytest.mark.parametrize("bend", [0.0, 30.0])
def test_the_alignment_of_a_straight_way_does_not_turn_the_map_about_it(bend: float) -> None:
    s = np.linspace(0.0, 1.0, 100)
    way = np.column_stack([200.0 * s, bend * np.sin(6 * s), 0 * s])
    own = Similarity(R=transforms.quat_to_matrix(transforms.rpy_to_quat(0.4, 0.2, 1.0)), t=np.ones(3) * 30.0)
    stamps = (s * 1e10).astype(np.int64)
    truth = Trajectory(stamp_ns=stamps, position_m=way, quat_xyzw=np.tile([0.0, 0.0, 0.0, 1.0], (100, 1)))
    noisy = truth.position_m + np.random.default_rng(5).normal(0.0, 0.01, (100, 3))
    estimate = own.apply(Trajectory(stamp_ns=stamps, position_m=noisy, quat_xyzw=truth.quat_xyzw))
    result = evaluate(truth, estimate, alignment=Alignment.SE3)
    fit = transform_of_map(result)
    wall = np.array([[100.0, 50.0, 5.0], [20.0, -50.0, 0.0]])
    assert (wall @ own.R.T + own.t) @ fit.R.T + fit.t == pytest.approx(wall, abs=0.05)
