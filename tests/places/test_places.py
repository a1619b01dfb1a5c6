"""Overlap of frames, recall and precision, against closed forms."""

from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.laboratory.place_baselines import (
    Vlad,
    closure_similarity,
    local_maps,
    read_similarity,
    score_places,
    similarity_of,
)
from recorder.laboratory.place_pairs import Frames, Pairs, find_pairs, frames_along
from recorder.laboratory.true_map import field_of, look, seen_shares

pytest.importorskip("open3d", reason="open3d is not installed")
CAMERA = field_of(CameraConfig(pinhole=Pinhole.from_fov(160, 120, 90.0)))


def wall(x: float, half_m: float = 300.0) -> Mesh:
    corners = [[x, -half_m, -half_m], [x, half_m, -half_m], [x, half_m, half_m], [x, -half_m, half_m]]
    return make_mesh(corners, [[0, 1, 2], [0, 2, 3]], material=Material.CONCRETE, tag=Tag.WALL)


def pose(x: float, y: float, yaw_deg: float = 0.0, z: float = 0.0, axes: str = "optical") -> Any:
    return Mount(position_m=(x, y, z), rpy_deg=(0.0, 0.0, yaw_deg), axes=axes).T_base_sensor


def frames(*poses: Any) -> Frames:
    count = len(poses)
    return Frames(
        stamp_ns=np.arange(count), distance_m=np.arange(float(count)), T_world_sensor=np.array(poses)
    )


@pytest.mark.parametrize("aside_m", [0.0, 2.0, 7.0])
def test_two_cameras_before_a_wall_share_the_area_that_both_see(scenery: Any, aside_m: float) -> None:
    """At 90° and 10 m an image is 20 m wide: one that lies aside shares the rest of it."""
    rays = scenery.world([wall(10.0)]).rays()
    found = find_pairs(
        rays, CAMERA, frames(pose(0, 0)), frames(pose(0, aside_m)), within_m=9.0, count=160 * 120
    )
    assert found.distance_m.tolist() == [aside_m]
    assert found.of_query == pytest.approx([1.0 - aside_m / 20.0], abs=0.004)
    assert found.of_reference == pytest.approx(found.of_query, abs=0.004)
    assert found.angle_deg == pytest.approx([0.0], abs=1e-6)


def test_a_nearer_camera_sees_a_part_of_what_a_farther_one_does(scenery: Any) -> None:
    rays = scenery.world([wall(10.0)]).rays()
    found = find_pairs(rays, CAMERA, frames(pose(5, 0)), frames(pose(0, 0)), within_m=9.0, count=160 * 120)
    assert found.of_query == pytest.approx([1.0], abs=1e-9)
    assert found.of_reference == pytest.approx([0.25], abs=0.01)
    assert found.overlap == pytest.approx([0.25], abs=0.01)


def test_no_overlap_of_cameras_that_look_away_from_each_other_or_are_walled_off(scenery: Any) -> None:
    rays = scenery.world([wall(10.0), wall(-10.0)]).rays()
    one, back = frames(pose(0, 0)), frames(pose(0, 0, 180.0))
    found = find_pairs(rays, CAMERA, one, back, within_m=1.0)
    assert (found.of_query.tolist(), found.of_reference.tolist()) == ([0.0], [0.0])
    assert found.angle_deg == pytest.approx([180.0], abs=1e-4)
    both_sides = scenery.world([wall(10.0), wall(10.5)]).rays()
    behind = find_pairs(both_sides, CAMERA, one, frames(pose(20, 0, 180.0)), within_m=30.0)
    assert behind.of_query.tolist() == [0.0]
    assert not len(find_pairs(rays, CAMERA, one, frames(pose(0, 9)), within_m=8.0).query)


def test_identical_frames_overlap_wholly_and_a_lidar_sees_behind(scenery: Any) -> None:
    rng = np.random.default_rng(0)
    boxes = [scenery.box([x, y, 0.0], [x + 3, y + 2, 5.0]) for x, y in rng.uniform(-40, 40, (30, 2))]
    rays = scenery.world([scenery.ground(), *boxes]).rays()
    lidar = field_of(LidarConfig())
    for field, axes in ((CAMERA, "optical"), (lidar, "flu")):
        view = look(rays, field, pose(30.2, 45.3, 200.0, 1.8, axes), 2000)
        assert len(view.points_m) > 500
        assert seen_shares(rays, field, view, [view]) == pytest.approx([1.0], abs=2e-3)
    turned = look(rays, lidar, pose(30.2, 45.3, 20.0, 1.8, "flu"), 2000)
    here = look(rays, lidar, pose(30.2, 45.3, 200.0, 1.8, "flu"), 2000)
    assert seen_shares(rays, lidar, here, [turned]) == pytest.approx([1.0], abs=2e-3)
    sky = look(rays, CAMERA, pose(0, 0, 0.0, 500.0), 100)
    assert seen_shares(rays, CAMERA, here, [sky]).tolist() == [0.0]


def test_the_field_of_a_pattern_is_that_of_its_optics() -> None:
    """Directions lie in their field, and points beside or above it do not."""
    for name, inside, outside in (
        ("avia", (30.0, 20.0), (50.0, 0.0)),
        ("mid360", (170.0, 50.0), (0.0, -9.0)),
    ):
        field = field_of(LidarConfig(**LidarConfig.preset_values(name)))
        away = field.directions(5000)
        assert np.all(field.holds(10.0 * away))
        for (azimuth, elevation), holds in ((inside, True), (outside, False)):
            a, e = np.radians([azimuth, elevation])
            point = 10.0 * np.array([[np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]])
            assert field.holds(point).tolist() == [holds]


def test_frames_lie_at_even_distances_and_a_car_that_waits_gives_none(scenery: Any) -> None:
    def path(t: Any) -> Any:  # 10 m/s, from 1 s to 3 s at rest
        way = 10.0 * (np.minimum(t, 1.0) + np.maximum(t - 3.0, 0.0))
        return np.stack([way, 0 * t, 0 * t], axis=-1), np.zeros((len(t), 3))

    config = CameraConfig(mount=Mount(position_m=(1.5, 0.0, 1.6), axes="optical"))
    drive = scenery.drive(path, 5.0)
    found = frames_along(drive, config, every_m=2.0, span_ns=(0, 5_000_000_000))
    assert found.distance_m == pytest.approx(np.arange(0.0, 29.0, 2.0), abs=0.52)
    assert found.T_world_sensor[:, 0, 3] == pytest.approx(found.distance_m + 1.5, abs=0.02)
    assert not ((found.stamp_ns > 1_050_000_000) & (found.stamp_ns < 3_000_000_000)).any()
    later = frames_along(drive, config, every_m=2.0, span_ns=(0, 5_000_000_000), offset_m=1.0)
    assert later.distance_m == pytest.approx(np.arange(1.0, 29.0, 2.0), abs=0.52)
    with pytest.raises(EvaluationError, match="longer"):
        frames_along(drive, config, every_m=2.0, span_ns=(0, 50_000_000))


def diagonal(count: int, width: int) -> Any:
    away = np.abs(np.arange(count)[:, None] - np.arange(count))
    return np.maximum(1.0 - away / (width + 1.0), 0.0)


def test_perfect_descriptors_have_full_recall_and_precision() -> None:
    overlap = diagonal(40, 3)
    place = np.column_stack([np.arange(40.0), np.zeros(40)])
    score = score_places(similarity_of(place, place), overlap, least=0.5)
    assert score.recall == {1: 1.0, 5: 1.0, 10: 1.0}
    assert (score.average_precision, score.recall_at_full_precision, score.queries) == (1.0, 1.0, 40)


def test_random_descriptors_have_the_recall_of_chance() -> None:
    """Of R references p are right: N drawn ones hold none of them by C(R − p, N) / C(R, N)."""
    rng = np.random.default_rng(3)
    overlap = np.zeros((4000, 50))
    overlap[:, :4] = 1.0
    score = score_places(rng.random((4000, 50)), overlap, least=0.5, at=(1, 5, 10))
    for n, recall in score.recall.items():
        expected = 1.0 - comb(46, n) / comb(50, n)
        assert recall == pytest.approx(expected, abs=5.0 * np.sqrt(0.25 / 4000))
    assert score.curve[-1] == pytest.approx([score.recall[1], score.recall[1]])


def test_precision_and_recall_of_a_small_table_by_hand() -> None:
    overlap = np.array([[0.9, 0.1], [0.2, 0.8], [0.0, 0.0], [0.7, 0.0]])
    likeness = np.array([[9.0, 1.0], [7.0, 8.0], [6.0, -np.inf], [-np.inf, -np.inf]])
    score = score_places(likeness, overlap, least=0.5, at=(1, 2))
    # Three queries have a partner; two are found, then one without a partner is answered, one is not.
    assert score.queries == 3
    assert score.recall == {1: pytest.approx(2 / 3), 2: pytest.approx(2 / 3)}
    assert score.curve.tolist() == pytest.approx(np.array([[1 / 3, 1], [2 / 3, 1], [2 / 3, 2 / 3]]))
    assert score.recall_at_full_precision == pytest.approx(2 / 3)
    assert score.average_precision == pytest.approx(2 / 3)
    swapped = score_places(likeness[:, ::-1], overlap, least=0.5, at=(1, 2))
    assert swapped.recall == {1: 0.0, 2: pytest.approx(2 / 3)}
    assert swapped.recall_at_full_precision == 0.0
    for bad, words in ((likeness[:2], "give one for each"), (np.full((4, 2), np.nan), "not a number")):
        with pytest.raises(EvaluationError, match=words):
            score_places(bad, overlap, least=0.5)
    with pytest.raises(EvaluationError, match="smaller --overlap"):
        score_places(likeness, overlap, least=0.95)
    with pytest.raises(ConfigError):
        score_places(likeness, overlap, least=0.0)


def test_files_of_descriptors(tmp_path: Path) -> None:
    reference, query = np.eye(3), np.array([[0.0, 1.0, 0.0], [3.0, 0.0, 4.0]])
    expected = -np.array([[np.sqrt(2), 0.0, np.sqrt(2)], [np.sqrt(20), np.sqrt(26), np.sqrt(18)]])
    np.savez(tmp_path / "two.npz", reference=reference, query=query)
    np.savez(tmp_path / "one.npz", similarity=expected)
    np.save(tmp_path / "rows.npy", np.concatenate([reference, query]).astype(np.float32))
    for name in ("two.npz", "one.npz", "rows.npy"):
        assert read_similarity(tmp_path / name, 2, 3) == pytest.approx(expected)
    with pytest.raises(EvaluationError, match="a row for each of 4 frames"):
        read_similarity(tmp_path / "two.npz", 2, 4)
    np.savez(tmp_path / "other.npz", feature=reference)
    (tmp_path / "text.npy").write_text("no array")
    for name, words in (("other.npz", "has feature"), ("text.npy", "cannot be read"), ("no.npy", "be read")):
        with pytest.raises(EvaluationError, match=words):
            read_similarity(tmp_path / name, 2, 3)


def test_the_table_of_pairs_as_a_matrix(tmp_path: Path) -> None:
    pairs = Pairs(
        query=np.array([0, 1]), reference=np.array([2, 0]), distance_m=np.array([1.0, 2.0]),
        angle_deg=np.zeros(2), of_query=np.array([0.9, 0.4]), of_reference=np.array([0.8, 0.5]),
    )  # fmt: skip
    assert pairs.matrix(2, 3).tolist() == [[0.0, 0.0, 0.8], [0.4, 0.0, 0.0]]
    lines = pairs.write(tmp_path / "pairs.csv").read_text().splitlines()
    assert lines[0] == "query,reference,distance_m,angle_deg,of_query,of_reference,overlap"
    assert lines[2] == "1,0,2.0000,0.0000,0.4000,0.5000,0.4000"


def test_vlad_knows_a_picture_again_and_learns_of_the_reference_alone() -> None:
    rng = np.random.default_rng(4)

    def picture() -> Any:
        return np.kron(rng.integers(0, 256, (15, 20)), np.ones((12, 12))).astype(np.uint8)

    known = [picture() for _ in range(4)]
    vlad = Vlad(known, seed=1)
    reference = np.array([vlad.describe(image) for image in known])
    assert np.linalg.norm(reference, axis=1) == pytest.approx(1.0)
    darker = np.array([vlad.describe((0.6 * image + 20).astype(np.uint8)) for image in known])
    score = score_places(similarity_of(reference, darker), np.eye(4), least=0.5, at=(1,))
    assert score.recall == {1: 1.0}
    assert not vlad.describe(np.zeros((90, 160), np.uint8)).any()
    with pytest.raises(EvaluationError, match="features in all"):
        Vlad([np.zeros((90, 160), np.uint8)])


def test_local_maps_lie_in_the_frames_own_axes() -> None:
    place = np.array([[3.0, 4.0, 1.0], [8.0, -2.0, 0.5]])
    poses = [
        pose(0.0, 0.0, 0.0, 0.0, "flu"),
        pose(5.0, 0.0, 90.0, 0.0, "flu"),
        pose(90.0, 0.0, 0.0, 0.0, "flu"),
    ]
    own = [transforms.apply(transforms.invert(T), place) for T in poses]
    found = local_maps(
        own,
        Frames(stamp_ns=np.arange(3), distance_m=np.array([0.0, 5.0, 90.0]), T_world_sensor=np.array(poses)),
    )
    for cloud, expected in zip(found, own, strict=True):
        assert {tuple(np.round(p, 6)) for p in cloud} == {tuple(np.round(p, 6)) for p in expected}


def test_map_closures_finds_the_same_houses(scenery: Any) -> None:
    pytest.importorskip("map_closures", reason="map-closures is not installed")
    rng = np.random.default_rng(0)

    def houses() -> Any:
        corners, half = rng.uniform(-50, 50, (30, 1, 2)), rng.uniform(1, 8, (30, 1, 2))
        side, along = rng.integers(0, 2, (30, 1500, 1)), rng.choice([-1.0, 1.0], (30, 1500, 1))
        edge = np.where(side == np.arange(2), along, rng.uniform(-1, 1, (30, 1500, 2)))
        walls = np.concatenate([corners + edge * half, rng.uniform(0, 6, (30, 1500, 1))], axis=2)
        floor = np.column_stack([rng.uniform(-60, 60, (80_000, 2)), np.full(80_000, -1.8)])
        return np.concatenate([walls.reshape(-1, 3), floor])

    towns = [houses() for _ in range(3)]
    likeness = closure_similarity(towns, [towns[k] + [2.0, 0.0, 0.0] for k in (2, 0, 1)])
    found = np.argwhere(likeness >= 10.0)
    assert len(found) >= 2  # its fit of the ground draws points
    assert {(query, (2, 0, 1)[query]) for query, _ in found} == {tuple(pair) for pair in found}
