"""EuRoC folders and TUM files, read back by evo, OpenCV and PyYAML."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from shared_fixtures.readings.bag_samples import imu, truth

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image, Imu, Odometry
from carlaloc_env.sensors.base import Mount
from carlaloc_env.timeline.actors import empty_catalog
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.motion import Motion
from carlaloc_env.timeline.timeline import Timeline
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.formats.euroc import EurocEncoder, EurocWriter
from recorder.writers.formats.euroc_states import write_state_csv
from recorder.writers.formats.tum import write_truth, write_tum
from recorder.writers.rig_calibration import CameraCalibration, ImuCalibration, RigCalibration

T_BASE_IMU = Mount(position_m=(1.5, 0.1, 1.05), axes="paper_imu").T_base_sensor
T_BASE_LEFT = Mount(position_m=(1.8, 0.2, 1.4), axes="optical").T_base_sensor
T_BASE_RIGHT = Mount(position_m=(1.8, -0.2, 1.4), axes="optical").T_base_sensor
STAMPS = np.arange(0, 400_000_000, 5_000_000)


def rig() -> RigCalibration:
    return RigCalibration.of(
        cameras=[
            CameraCalibration(name="left", T_base_camera=T_BASE_LEFT, pinhole=Pinhole()),
            CameraCalibration(name="right", T_base_camera=T_BASE_RIGHT, pinhole=Pinhole()),
        ],
        imu=ImuCalibration(T_base_imu=T_BASE_IMU),
    )


def timeline() -> Timeline:
    """A turn with pitch and roll."""
    t = np.arange(100)[:, None] * 0.005
    position = np.concatenate([20 * np.cos(t), 20 * np.sin(t), 0.3 * t], axis=1)
    quat = transforms.rpy_to_quat(0.1 * t[:, 0], 0.05 + 0.02 * t[:, 0], t[:, 0] + 1.5)
    return Timeline(empty_catalog(), ego=EgoTrack.from_arrays(position, quat))


def odometry(motion: Motion, k: int, frame_id: str) -> Odometry:
    velocity, rate = motion.velocity_world_mps[k], motion.omega_body_radps[k]
    return truth(int(motion.stamp_ns[k]), motion.position_m[k], motion.quat_xyzw[k], frame_id, velocity, rate)


def write(path: Path, truth_frame: str, *, colour: bool = False) -> tuple[Motion, list[Image], list[Imu]]:
    motion = timeline().ego_motion(STAMPS)
    given = motion if truth_frame == "base_link" else motion.at_mount(T_BASE_IMU)
    rng = np.random.default_rng(1)
    images, inertial = [], []
    with EurocWriter(path, EurocEncoder(rig(), colour=colour)) as writer:
        for k, stamp in enumerate(STAMPS.tolist()):
            inertial.append(imu(stamp, rng.normal(size=3), rng.normal(size=3)))
            writer.write(inertial[-1])
            writer.write(odometry(given, k, truth_frame))
            if stamp % 50_000_000 == 0:
                for side in ("left", "right"):
                    rgb = rng.integers(0, 256, (72, 128, 3), dtype=np.uint8)
                    name, frame = f"rgb_{side}", f"camera_{side}"
                    images.append(Image(sensor=name, frame_id=frame, stamp_ns=stamp, rgb=rgb))
                    writer.write(images[-1])
        assert not path.exists()
    return motion.at_mount(T_BASE_IMU), images, inertial


@pytest.mark.parametrize("truth_frame", ["base_link", "imu"])
def test_evo_reads_the_truth_of_the_imu(tmp_path: Path, truth_frame: str) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    motion, _, _ = write(tmp_path / "mav0", truth_frame)
    read = file_interface.read_euroc_csv_trajectory(tmp_path / "mav0/state_groundtruth_estimate0/data.csv")
    assert np.abs(read.positions_xyz - motion.position_m).max() < 1e-12
    assert np.abs(read.orientations_quat_wxyz[:, 1:] - motion.quat_xyzw[:, :3]).max() < 1e-12
    assert np.abs(read.timestamps - (DEFAULT_EPOCH_NS + STAMPS) * 1e-9).max() < 1e-6
    table = np.loadtxt(tmp_path / "mav0/state_groundtruth_estimate0/data.csv", delimiter=",")
    assert table.shape == (len(STAMPS), 17)
    assert np.abs(table[:, 8:11] - motion.velocity_world_mps).max() < 1e-12


def test_imu_table_is_gyroscope_then_accelerometer(tmp_path: Path) -> None:
    _, _, inertial = write(tmp_path / "mav0", "imu")
    lines = (tmp_path / "mav0/imu0/data.csv").read_text().splitlines()
    assert lines[0].startswith("#timestamp [ns],w_RS_S_x")
    for line, sample in zip(lines[1:], inertial, strict=True):
        stamp, *values = line.split(",")
        assert int(stamp) == DEFAULT_EPOCH_NS + sample.stamp_ns
        assert [float(v) for v in values] == [*sample.angular_rate_radps, *sample.specific_force_mps2]


@pytest.mark.parametrize("colour", [False, True])
def test_pictures_and_their_tables(tmp_path: Path, colour: bool) -> None:
    _, images, _ = write(tmp_path / "mav0", "imu", colour=colour)
    times = (tmp_path / "mav0/times.txt").read_text().split()
    assert times == [str(DEFAULT_EPOCH_NS + image.stamp_ns) for image in images[::2]]
    for camera, side in (("cam0", "left"), ("cam1", "right")):
        lines = (tmp_path / "mav0" / camera / "data.csv").read_text().splitlines()[1:]
        expected = [image for image in images if image.sensor == f"rgb_{side}"]
        for line, image in zip(lines, expected, strict=True):
            stamp, name = line.split(",")
            assert (int(stamp), name) == (DEFAULT_EPOCH_NS + image.stamp_ns, f"{stamp}.png")
            pixels = cv2.imread(str(tmp_path / "mav0" / camera / "data" / name), cv2.IMREAD_UNCHANGED)
            assert pixels is not None
            if colour:
                assert np.array_equal(pixels[..., ::-1], image.rgb)
            else:
                assert np.abs(pixels - image.rgb @ [0.299, 0.587, 0.114]).max() <= 1.0


def test_sensor_yaml(tmp_path: Path) -> None:
    write(tmp_path / "mav0", "imu")
    camera = yaml.safe_load((tmp_path / "mav0/cam0/sensor.yaml").read_text())
    T_BS = np.array(camera["T_BS"]["data"]).reshape(4, 4)
    assert np.allclose(T_BASE_IMU @ T_BS, T_BASE_LEFT, atol=1e-14)
    assert camera["intrinsics"] == [640.0, 640.0, 640.0, 360.0]
    assert camera["resolution"] == [1280, 720]
    inertial = yaml.safe_load((tmp_path / "mav0/imu0/sensor.yaml").read_text())
    assert inertial["gyroscope_random_walk"] == 2e-5
    assert np.array_equal(np.array(inertial["T_BS"]["data"]).reshape(4, 4), np.eye(4))


def test_euroc_refusals(tmp_path: Path) -> None:
    with pytest.raises(WriterError, match="needs an IMU"):
        EurocWriter(tmp_path / "mav0", EurocEncoder(RigCalibration()))
    (tmp_path / "mav0").mkdir()
    with pytest.raises(WriterError, match="exists"):
        EurocWriter(tmp_path / "mav0", EurocEncoder(rig())).open()
    with (
        EurocWriter(tmp_path / "b", EurocEncoder(rig())) as writer,
        pytest.raises(WriterError, match="frame 'gnss'"),
    ):
        writer.write(odometry(timeline().ego_motion(STAMPS), 0, "gnss"))


def test_tum_files_keep_nanoseconds_and_every_digit(tmp_path: Path) -> None:
    drive = timeline()
    stamps = STAMPS + 3
    files = write_truth(tmp_path, drive, stamps, {"imu": T_BASE_IMU, "camera_left": T_BASE_LEFT})
    assert [f.name for f in files] == ["imu.tum", "camera_left.tum"]
    motion = drive.ego_motion(stamps).at_mount(T_BASE_LEFT)
    lines = files[1].read_text().splitlines()[1:]
    for k, line in enumerate(lines):
        time_text, *values = line.split()
        assert int(time_text.replace(".", "")) == DEFAULT_EPOCH_NS + stamps[k]
        assert [float(v) for v in values] == [*motion.position_m[k], *motion.quat_xyzw[k]]
    file_interface = pytest.importorskip("evo.tools.file_interface")
    read = file_interface.read_tum_trajectory_file(files[1])
    assert np.array_equal(read.positions_xyz, motion.position_m)
    assert np.array_equal(np.roll(read.orientations_quat_wxyz, -1, axis=1), motion.quat_xyzw)


def test_existing_tum_file_is_kept(tmp_path: Path) -> None:
    motion = timeline().ego_motion(STAMPS)
    path = write_tum(tmp_path / "a.tum", motion)
    with pytest.raises(WriterError, match="exists"):
        write_tum(path, motion)


def test_state_csv_with_biases(tmp_path: Path) -> None:
    motion = timeline().ego_motion(STAMPS).at_mount(T_BASE_IMU)
    biases = np.random.default_rng(0).normal(size=(len(STAMPS), 6))
    write_state_csv(tmp_path / "state.csv", motion, biases=biases)
    table = np.loadtxt(tmp_path / "state.csv", delimiter=",")
    assert np.array_equal(table[:, 11:14], biases[:, 3:])
    assert np.array_equal(table[:, 14:17], biases[:, :3])
