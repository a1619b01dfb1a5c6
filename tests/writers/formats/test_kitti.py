"""KITTI's layout, against its definitions, against evo's reader and against a drive in closed form."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import PINHOLE, cloud_of, rig, truth, write_all

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image, ObjectList, Sample
from carlaloc_env.scene.semantic_tags import Tag
from recorder.writers.formats.kitti import KittiEncoder, KittiWriter
from recorder.writers.formats.semantic_kitti import semantic_kitti_labels
from recorder.writers.rig_calibration import RigCalibration

SPEED, RATE = 12.0, 0.4
"""A bend: speed [m/s] and rate of turning [rad/s]."""
SWEEP_NS = 100_000_000
WORLD_POINTS = np.random.default_rng(1).uniform([-30, -30, 0], [60, 60, 5], (400, 3))


def pose(stamp_ns: int) -> tuple[np.ndarray, np.ndarray]:
    """Position and attitude of base_link on the bend."""
    angle = RATE * stamp_ns * 1e-9
    radius = SPEED / RATE
    position = np.array([radius * np.sin(angle), radius * (1 - np.cos(angle)), 0.0])
    return position, transforms.rpy_to_quat(0.0, 0.0, angle)


def T_world_base(stamp_ns: int) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3], quat = pose(stamp_ns)
    T[:3, :3] = transforms.quat_to_matrix(quat)
    return T


def drive(calibration: RigCalibration, sweeps: int = 5) -> list[Sample]:
    """Still points, each seen at its own time of a sweep; two road users, of which one moves."""
    assert calibration.lidar is not None
    samples: list[Sample] = []
    for stamp in range(0, sweeps * SWEEP_NS + 1, 5_000_000):
        if stamp % SWEEP_NS == 0 and stamp < sweeps * SWEEP_NS:
            offsets = np.linspace(0, SWEEP_NS - 1, len(WORLD_POINTS)).astype(np.uint32)
            seen = [
                transforms.apply(
                    np.linalg.inv(T_world_base(stamp + int(offset)) @ calibration.lidar.T_base_lidar), point
                )
                for offset, point in zip(offsets, WORLD_POINTS, strict=True)
            ]
            objects = ObjectList(
                sensor="objects", frame_id="world", stamp_ns=stamp,
                id=np.array([70_000, 5], np.uint32), tag=np.array([Tag.CAR, Tag.CAR], np.uint8),
                position_m=np.zeros((2, 3)), heading_rad=np.zeros(2), pitch_rad=np.zeros(2),
                roll_rad=np.zeros(2), size_m=np.ones((2, 3)),
                velocity_mps=np.array([[0.3, 0.4, 0.1], [0.0, 0.4, 0.0]]), yaw_rate_radps=np.zeros(2),
                visible=np.ones(2), distance_m=np.ones(2),
            )  # fmt: skip
            cloud = cloud_of(
                np.array(seen), stamp, sweep_ns=SWEEP_NS, intensity=51.0, offset_ns=offsets, tag=Tag.CAR,
                instance=np.where(np.arange(len(seen)) % 2, 70_000, 5), cos_incidence=1.0,
            )  # fmt: skip
            rgb = np.full((24, 32, 3), [stamp // SWEEP_NS, 2, 3], np.uint8)
            image = Image(sensor="rgb_left", frame_id="camera_left", stamp_ns=stamp, rgb=rgb)
            samples += [objects, cloud, image]
        samples.append(truth(stamp, *pose(stamp)))
    return samples


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("kitti") / "00"
    return write_all(KittiWriter(path, KittiEncoder(rig())), drive(rig()))


def calib(folder: Path) -> dict[str, np.ndarray]:
    rows = (line.split(":") for line in (folder / "calib.txt").read_text().splitlines())
    return {name: np.array(values.split(), float).reshape(3, 4) for name, values in rows}


def square(T: np.ndarray) -> np.ndarray:
    return np.vstack([T, [0.0, 0.0, 0.0, 1.0]])


def test_frames_are_numbered_and_equally_many(folder: Path) -> None:
    for part in ("velodyne", "labels", "image_2"):
        assert sorted(path.stem for path in (folder / part).iterdir()) == [f"{k:06d}" for k in range(5)]
    times = [float(line) for line in (folder / "times.txt").read_text().split()]
    assert times == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    image = cv2.imread(str(folder / "image_2" / "000003.png"))
    assert image is not None
    assert image[0, 0].tolist() == [3, 2, 3]


def test_images_may_come_before_the_cloud_of_their_instant(folder: Path, tmp_path: Path) -> None:
    """As from rigs whose cameras stand before their LiDAR."""
    samples = sorted(drive(rig()), key=lambda sample: (sample.stamp_ns, not isinstance(sample, Image)))
    early = write_all(KittiWriter(tmp_path / "kitti", KittiEncoder(rig())), samples)
    names = sorted(path.name for path in (folder / "image_2").iterdir())
    assert sorted(path.name for path in (early / "image_2").iterdir()) == names
    for name in names:
        assert (early / "image_2" / name).read_bytes() == (folder / "image_2" / name).read_bytes()


def test_poses_as_evo_reads_them(folder: Path) -> None:
    evo = pytest.importorskip("evo.tools.file_interface")
    poses = evo.read_kitti_poses_file(str(folder / "poses.txt")).poses_se3
    np.testing.assert_allclose(poses[0], np.eye(4), atol=1e-9)
    camera = rig().cameras[0].T_base_camera
    true = np.linalg.inv(T_world_base(0) @ camera) @ T_world_base(3 * SWEEP_NS) @ camera
    np.testing.assert_allclose(poses[3], true, atol=1e-6)


def test_points_of_all_frames_lie_on_one_another(folder: Path) -> None:
    """Poses, calibration and deskewing together bring every still point to its place in the world."""
    poses = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    T_world_first = T_world_base(0) @ rig().cameras[0].T_base_camera
    for frame, T in enumerate(poses):
        points = np.fromfile(folder / "velodyne" / f"{frame:06d}.bin", "<f4").reshape(-1, 4)
        T_world_lidar = T_world_first @ square(T) @ square(calib(folder)["Tr"])
        placed = transforms.apply(T_world_lidar, points[:, :3].astype(float))
        # Poses are interpolated over 5 ms, along a chord instead of the bend.
        np.testing.assert_allclose(placed, WORLD_POINTS, atol=2e-4)
        np.testing.assert_allclose(points[:, 3], 0.2)


def test_projection_into_the_right_camera(folder: Path) -> None:
    matrices = calib(folder)
    left, right = matrices["P2"], matrices["P3"]
    p = PINHOLE
    assert left[:, :3].tolist() == [[p.fx_px, 0, p.cx_px], [0, p.fy_px, p.cy_px], [0, 0, 1]]
    # KITTI's fourth column of a camera to the right: −fx · baseline.
    assert right[0, 3] == pytest.approx(-PINHOLE.fx_px * 0.4)


def test_without_cameras_there_are_no_projections(tmp_path: Path) -> None:
    """A matrix of zeros and ones would be taken for a camera's."""
    blind = replace(rig(), cameras=())
    path = write_all(KittiWriter(tmp_path / "00", KittiEncoder(blind)), drive(blind))
    assert set(calib(path)) == {"Tr"}


def test_labels_tell_what_moves(folder: Path) -> None:
    labels = np.fromfile(folder / "labels" / "000002.label", "<u4")
    assert set((labels[1::2] & 0xFFFF).tolist()) == {252}
    assert set((labels[::2] & 0xFFFF).tolist()) == {10}
    assert set((labels[1::2] >> 16).tolist()) == {70_000 & 0xFFFF}


def test_every_tag_has_a_label_of_the_benchmark_and_snow_that_of_wads() -> None:
    known = {
        0, 1, 10, 11, 13, 15, 16, 18, 20, 30, 31, 32, 40, 44, 48, 49, 50, 51, 52, 60, 70, 71, 72, 80, 81, 99,
    }  # fmt: skip
    tags = np.array(list(Tag), np.uint8)
    labels = semantic_kitti_labels(tags, np.zeros(len(tags), np.uint32), np.zeros(0, np.uint32))
    assert labels[tags == Tag.SNOW].tolist() == [110]
    assert set((labels[tags != Tag.SNOW] & 0xFFFF).tolist()) <= known
    assert set(tags[labels == 0].tolist()) == {Tag.UNLABELED, Tag.SKY}


def test_rig_without_lidar_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WriterError, match="needs a LiDAR"):
        KittiWriter(tmp_path / "00", KittiEncoder(RigCalibration.of()))
