"""Calibration files loaded as their programs load them, and compared with each other."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.sensors.base import Mount
from recorder.writers.calibration.files import write_calibration
from recorder.writers.rig_calibration import (
    CameraCalibration,
    ImuCalibration,
    LidarCalibration,
    RigCalibration,
)
from recorder.writers.text_templates import real

T_BASE_IMU = Mount(position_m=(1.5, 0.0, 1.05), axes="paper_imu").T_base_sensor
T_BASE_LIDAR = Mount(position_m=(1.2, 0.0, 1.85), rpy_deg=(0.0, 1.0, 2.0)).T_base_sensor
T_BASE_CAMERA = {
    "left": Mount(position_m=(1.8, 0.2, 1.4), axes="optical").T_base_sensor,
    "right": Mount(position_m=(1.8, -0.2, 1.4), axes="optical").T_base_sensor,
}
ELEVATIONS = tuple(-30.0 + 40.0 * k / 31 for k in range(32))


def rig() -> RigCalibration:
    return RigCalibration.of(
        cameras=[
            CameraCalibration(name=name, T_base_camera=T, pinhole=Pinhole())
            for name, T in T_BASE_CAMERA.items()
        ],
        imu=ImuCalibration(T_base_imu=T_BASE_IMU),
        lidar=LidarCalibration(T_base_lidar=T_BASE_LIDAR, elevations_deg=ELEVATIONS),
        others={"gnss": Mount(position_m=(0.7, 0.0, 1.5)).T_base_sensor},
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibration")
    write_calibration(path, rig())
    return path


def opencv(path: Path) -> cv2.FileStorage:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.isOpened()
    return storage


def load(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


def test_a_point_seen_through_every_file(folder: Path) -> None:
    """One world of points, taken from the IMU frame to both cameras by each program's own matrices.

    Rules out a matrix that is inverted or of another pair of frames.
    """
    point_base = np.array([12.0, 1.0, 2.5, 1.0])
    point_imu = np.linalg.inv(T_BASE_IMU) @ point_base
    seen = {
        name: Pinhole().project((np.linalg.inv(T) @ point_base)[None, :3])[0]
        for name, T in T_BASE_CAMERA.items()
    }
    chain = load(folder / "kalibr/camchain-imucam.yaml")
    vins = opencv(folder / "vins_fusion/stereo_inertial.yaml")
    orb = opencv(folder / "orbslam3_stereo_inertial.yaml")
    T_b_c1, T_c1_c2 = orb.getNode("IMU.T_b_c1").mat(), orb.getNode("Stereo.T_c1_c2").mat()
    extrinsics = load(folder / "extrinsics.yaml")["frames"]
    for k, name in enumerate(("left", "right")):
        kalibr = np.array(chain[f"cam{k}"]["T_cam_imu"])
        estimates = {
            "kalibr": kalibr,
            "vins": np.linalg.inv(vins.getNode(f"body_T_cam{k}").mat()),
            "orbslam3": np.linalg.inv(T_b_c1 if k == 0 else T_b_c1 @ T_c1_c2),
            "extrinsics": np.linalg.inv(np.array(extrinsics[f"camera_{name}"][f"T_imu_camera_{name}"])),
        }
        for program, T_cam_imu in estimates.items():
            pixel = Pinhole().project((T_cam_imu @ point_imu)[None, :3])[0]
            assert np.allclose(pixel, seen[name], atol=1e-3), program
    T_c1_c0 = np.array(chain["cam1"]["T_cn_cnm1"])
    assert np.allclose(T_c1_c0 @ np.array(chain["cam0"]["T_cam_imu"]), chain["cam1"]["T_cam_imu"])
    assert np.allclose(T_c1_c0[:3, 3], [-0.4, 0.0, 0.0])


def test_fast_lio_extrinsics_take_lidar_points_to_the_imu(folder: Path) -> None:
    settings = load(folder / "fast_lio.yaml")
    R = np.array(settings["mapping"]["extrinsic_R"]).reshape(3, 3)
    t = np.array(settings["mapping"]["extrinsic_T"])
    point_lidar = np.array([10.0, -3.0, -1.0])
    expected = np.linalg.inv(T_BASE_IMU) @ T_BASE_LIDAR @ np.append(point_lidar, 1.0)
    assert np.allclose(R @ point_lidar + t, expected[:3], atol=1e-12)
    assert settings["preprocess"]["scan_line"] == 32
    assert (settings["preprocess"]["scan_rate"], settings["preprocess"]["timestamp_unit"]) == (20, 0)
    assert settings["common"] == {
        "lid_topic": "/lidar/points", "imu_topic": "/imu/data", "time_sync_en": False,
        "time_offset_lidar_to_imu": 0.0,
    }  # fmt: skip


def test_orbslam3_types_are_those_it_insists_on(folder: Path) -> None:
    """ORB-SLAM3's Settings.cc aborts where an int is a real, and toSophus reads float32."""
    for name in ("orbslam3_stereo.yaml", "orbslam3_stereo_inertial.yaml"):
        storage = opencv(folder / name)
        assert storage.getNode("File.version").string() == "1.0"
        assert storage.getNode("Camera.type").string() == "PinHole"
        for key in ("Camera.width", "Camera.height", "Camera.fps", "Camera.RGB"):
            assert storage.getNode(key).isInt(), key
        for key in ("nFeatures", "nLevels", "iniThFAST", "minThFAST"):
            assert storage.getNode(f"ORBextractor.{key}").isInt(), key
        for key in ("Camera1.fx", "Camera2.cy", "Camera1.k1", "Stereo.ThDepth", "ORBextractor.scaleFactor"):
            assert storage.getNode(key).isReal(), key
        for key in ("KeyFrameSize", "CameraSize", "ViewpointX", "ViewpointY", "ViewpointZ", "ViewpointF"):
            assert storage.getNode(f"Viewer.{key}").isReal(), key
        assert storage.getNode("Stereo.T_c1_c2").mat().dtype == np.float32
    for key, value in (("NoiseGyro", 2e-4), ("NoiseAcc", 2e-3), ("GyroWalk", 2e-5), ("AccWalk", 3e-3)):
        node = storage.getNode(f"IMU.{key}")
        assert node.isReal()
        assert node.real() == pytest.approx(value, rel=1e-12)


def test_orbslam3_rectification_leaves_the_pictures_as_they_are(folder: Path) -> None:
    """The program rectifies by itself: from our matrices the maps must be the identity, bf 256."""
    storage = opencv(folder / "orbslam3_stereo.yaml")
    K = Pinhole().K
    T_c2_c1 = np.linalg.inv(storage.getNode("Stereo.T_c1_c2").mat().astype(np.float64))
    none = np.zeros(4)
    R, t, flags = T_c2_c1[:3, :3], T_c2_c1[:3, 3:], cv2.CALIB_ZERO_DISPARITY
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K, none, K, none, (1280, 720), R, t, flags=flags, alpha=-1)
    assert np.allclose(R1, np.eye(3), atol=1e-6)
    assert np.allclose(R2, np.eye(3), atol=1e-6)
    assert np.allclose(P1[:, :3], K, atol=1.0)
    assert P2[0, 3] == pytest.approx(-256.0, rel=1e-3)


def test_vins_settings(folder: Path) -> None:
    storage = opencv(folder / "vins_fusion/stereo_inertial.yaml")
    assert storage.getNode("imu").real() == 1
    assert storage.getNode("num_of_cam").real() == 2
    assert storage.getNode("imu_topic").string() == "/imu/data"
    assert storage.getNode("image1_topic").string() == "/camera/right/image_raw"
    assert storage.getNode("body_T_cam0").mat().dtype == np.float64
    assert storage.getNode("g_norm").real() == 9.81
    camera = opencv(folder / "vins_fusion" / storage.getNode("cam1_calib").string())
    assert camera.getNode("model_type").string() == "PINHOLE"
    assert camera.getNode("projection_parameters").getNode("cx").real() == 640.0
    stereo = opencv(folder / "vins_fusion/stereo.yaml")
    assert stereo.getNode("imu").real() == 0


def test_kalibr_values_are_numbers(folder: Path) -> None:
    """PyYAML reads 2e-05 as a text: such a file stops Kalibr."""
    imu = load(folder / "kalibr/imu.yaml")
    assert imu == {
        "accelerometer_noise_density": 2e-3, "accelerometer_random_walk": 3e-3, "rostopic": "/imu/data",
        "gyroscope_noise_density": 2e-4, "gyroscope_random_walk": 2e-5, "update_rate": 200.0,
    }  # fmt: skip
    camera = load(folder / "kalibr/camchain-imucam.yaml")["cam0"]
    assert camera["intrinsics"] == [640.0, 640.0, 640.0, 360.0]
    assert camera["rostopic"] == "/camera/left/image_raw"
    assert camera["resolution"] == [1280, 720]


def test_topics_follow_the_profile(tmp_path: Path) -> None:
    write_calibration(tmp_path, rig(), profile="paper")
    chain = load(tmp_path / "kalibr/camchain-imucam.yaml")
    assert [chain[c]["rostopic"] for c in ("cam0", "cam1")] == ["/cam0_raw", "/cam1_raw"]
    assert load(tmp_path / "fast_lio.yaml")["common"]["lid_topic"] == "/velodyne"


def test_notes_for_lego_loam(folder: Path) -> None:
    text = (folder / "lego_loam.md").read_text()
    assert "N_SCAN          = 32" in text
    assert "ang_bottom      = 30.000" in text
    assert "ang_res_y       = 1.290323" in text


def test_smaller_rigs_get_the_files_that_make_sense(tmp_path: Path) -> None:
    files = write_calibration(tmp_path / "a", RigCalibration.of(lidar=LidarCalibration()))
    assert [f.name for f in files] == ["extrinsics.yaml", "kiss_icp.yaml"]
    files = write_calibration(tmp_path / "b", RigCalibration.of(imu=ImuCalibration()))
    assert sorted(f.name for f in files) == ["extrinsics.yaml", "imu.yaml"]
    with pytest.raises(WriterError, match="exists"):
        write_calibration(tmp_path / "b", RigCalibration())
    with pytest.raises(WriterError, match="no frame 'laser'"):
        rig().T("laser", "imu")


@pytest.mark.parametrize("value", [0.0, -0.0, 640.0, 2e-5, 1e-300, 1e22, -0.1, 1 / 3])
def test_reals_are_reals_to_both_parsers(tmp_path: Path, value: float) -> None:
    (tmp_path / "a.yaml").write_text(f"%YAML:1.0\n---\nx: {real(value)}\n")
    storage = opencv(tmp_path / "a.yaml")
    node = storage.getNode("x")
    assert node.isReal()
    assert node.real() == pytest.approx(value, rel=1e-12, abs=1e-15)
    assert isinstance(yaml.safe_load(real(value)), float)


def test_rig_from_sensor_configurations() -> None:
    from carlaloc_env.sensors.camera_config import CameraConfig
    from carlaloc_env.sensors.gnss import GnssConfig
    from carlaloc_env.sensors.imu import ImuConfig
    from carlaloc_env.sensors.lidar_config import LidarConfig

    configs = (
        CameraConfig(name="left", mount=Mount(position_m=(1.8, 0.2, 1.4), axes="optical")),
        CameraConfig(name="right", mount=Mount(position_m=(1.8, -0.2, 1.4), axes="optical")),
        ImuConfig(mount=Mount(position_m=(1.5, 0.0, 1.05), axes="paper_imu"), gyro_random_walk=7e-5),
        LidarConfig(mount=Mount(position_m=(1.2, 0.0, 1.85))),
        GnssConfig(mount=Mount(position_m=(0.7, 0.0, 1.5))),
    )
    found = RigCalibration.from_configs(configs)
    cameras = [(f"rgb_{side}", f"camera_{side}") for side in ("left", "right")]
    assert [(c.stream, c.frame) for c in found.cameras] == cameras
    assert found.imu is not None
    assert found.imu.gyroscope_random_walk == 7e-5
    assert found.lidar is not None
    assert (found.lidar.rings, found.lidar.range_max_m) == (32, 120.0)
    assert set(found.frames) == {"camera_left", "camera_right", "imu", "lidar", "gnss"}
    assert np.allclose(found.T("camera_left", "camera_right")[:3, 3], [0.4, 0.0, 0.0])
