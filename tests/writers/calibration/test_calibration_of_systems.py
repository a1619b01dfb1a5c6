"""Calibration files read as OpenVINS, S-MSCKF, Basalt, LIO-SAM, KISS-ICP, RKO-LIO and A-LOAM read them."""

import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Lens
from carlaloc_env.rigs.industrial_camera import industrial_shutter
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.samples import Imu
from carlaloc_env.sensors.imu import IMU_GRADES, ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.writers.calibration.files import calibration_texts, write_calibration
from recorder.writers.rig_calibration import NOISE_FLOORS, RigCalibration
from recorder.writers.topic_profiles import STANDARD

RIG = RigCalibration.from_configs(rig_by_name("paper").sensors)
IMU, LIDAR = "imu", "lidar"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibration")
    write_calibration(path, RIG)
    return path


def true(to_frame: str, from_frame: str) -> Array:
    """From the mounts themselves, by another way than the files'."""
    return np.linalg.solve(RIG.frames[to_frame], RIG.frames[from_frame])


def opencv_rows(node: Any) -> Array:
    return np.array([[node.at(i).at(j).real() for j in range(node.at(i).size())] for i in range(node.size())])


def opened(path: Path) -> cv2.FileStorage:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.isOpened()
    return storage


def test_open_vins_reads_its_three_files_by_opencv(folder: Path) -> None:
    main = opened(folder / "open_vins/estimator_config.yaml")
    assert main.getNode("max_cameras").real() == 2
    # It reads them though it uses no tags and starts at rest, and ends where one is missing.
    dynamic = "bias_a bias_g inflation_ba inflation_bg inflation_ori inflation_vel min_deg min_rec_cond"
    names = [f"init_dyn_{name}" for name in f"{dynamic} mle_max_iter mle_max_time num_pose".split()]
    for name in (*names, "num_aruco", "up_aruco_sigma_px", "record_timing_filepath"):
        assert not main.getNode(name).empty(), name
    cameras = opened(folder / "open_vins" / main.getNode("relative_config_imucam").string())
    for k, side in enumerate(("left", "right")):
        camera = cameras.getNode(f"cam{k}")
        assert np.allclose(opencv_rows(camera.getNode("T_imu_cam")), true(IMU, f"camera_{side}"))
        numbers = [camera.getNode("intrinsics").at(i).real() for i in range(4)]
        assert numbers == [640.0, 640.0, *numbers[2:]]
        assert camera.getNode("rostopic").string() == f"/camera/{side}/image_raw"
    inertial = opened(folder / "open_vins" / main.getNode("relative_config_imu").string())
    imu = inertial.getNode("imu0")
    assert np.array_equal(opencv_rows(imu.getNode("T_i_b")), np.eye(4))
    assert imu.getNode("gyroscope_noise_density").real() == 2e-4
    assert imu.getNode("rostopic").string() == "/imu/data"
    assert np.array_equal(opencv_rows(imu.getNode("Tg")), np.zeros((3, 3)))


def test_rows_of_a_rolling_shutter_have_the_instants_at_which_they_are_exposed(tmp_path: Path) -> None:
    """As Kalibr times them, stamp + shift + row · line delay; one instant where a system knows none."""
    rolling = replace(industrial_shutter(), readout_ms=20.0)
    rig = rig_by_name("real")
    sensors = [replace(s, shutter=rolling) if s.kind == "camera" else s for s in rig.sensors]
    write_calibration(tmp_path, RigCalibration.from_configs(sensors))
    chain = yaml.safe_load((tmp_path / "kalibr/camchain-imucam.yaml").read_text())
    other = opened(tmp_path / "open_vins/kalibr_imucam_chain.yaml")
    for name in ("cam0", "cam1"):
        height = chain[name]["resolution"][1]
        rows_ns = 1e9 * (chain[name]["timeshift_cam_imu"] + np.arange(height) * chain[name]["line_delay"])
        assert np.allclose(rows_ns, rolling.rows_ns(0, 0.004, height).mean(axis=1), atol=1e-3)
        assert other.getNode(name).getNode("timeshift_cam_imu").real() == 0.0
        assert other.getNode(name).getNode("line_delay").real() == pytest.approx(0.020 / (height - 1))
    text = (tmp_path / "orbslam3_stereo.yaml").read_text()
    assert text.count("a rolling shutter of 20.0 ms") == 2
    assert not opened(tmp_path / "orbslam3_stereo.yaml").getNode("Camera1.fx").empty()
    for path, content in calibration_texts(RigCalibration.from_configs(rig.sensors), STANDARD).items():
        assert "line_delay" not in content, path


def test_s_msckf_reads_matrices_of_sixteen_numbers(folder: Path) -> None:
    chain = yaml.safe_load((folder / "s_msckf" / "camchain-imucam.yaml").read_text())
    for k, side in enumerate(("left", "right")):
        assert len(chain[f"cam{k}"]["T_cam_imu"]) == 16
        assert np.allclose(np.reshape(chain[f"cam{k}"]["T_cam_imu"], (4, 4)), true(f"camera_{side}", IMU))
    between = np.reshape(chain["cam1"]["T_cn_cnm1"], (4, 4))
    assert np.allclose(between, true("camera_right", "camera_left"))
    assert np.array_equal(np.reshape(chain["T_imu_body"], (4, 4)), np.eye(4))


def test_basalt(folder: Path) -> None:
    value = json.loads((folder / "basalt.json").read_text())["value0"]
    for pose, side in zip(value["T_imu_cam"], ("left", "right"), strict=True):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_quat([pose[f"q{axis}"] for axis in "xyzw"]).as_matrix()
        T[:3, 3] = [pose[f"p{axis}"] for axis in "xyz"]
        assert np.allclose(T, true(IMU, f"camera_{side}"))
    assert [camera["camera_type"] for camera in value["intrinsics"]] == ["pinhole", "pinhole"]
    assert value["resolution"] == [[1280, 720], [1280, 720]]
    assert (len(value["calib_accel_bias"]), len(value["calib_gyro_bias"])) == (9, 12)
    assert value["gyro_noise_std"] == [2e-4] * 3


def test_lio_sam_turns_the_imu_to_the_lidar_and_then_moves_it(folder: Path) -> None:
    settings = yaml.safe_load((folder / "lio_sam.yaml").read_text())["lio_sam"]
    turn = np.reshape(settings["extrinsicRot"], (3, 3))
    assert np.allclose(turn, true(LIDAR, IMU)[:3, :3])
    assert np.allclose(settings["extrinsicRPY"], settings["extrinsicRot"])
    assert np.allclose(settings["extrinsicTrans"], true(LIDAR, IMU)[:3, 3])
    # The paper's IMU has x up: at rest it reads +g there, and the LiDAR's z is up.
    assert np.allclose(turn @ [9.81, 0.0, 0.0], [0.0, 0.0, 9.81])
    assert (settings["N_SCAN"], settings["sensor"]) == (32, "velodyne")
    assert settings["pointCloudTopic"] == "/lidar/points"


def test_kiss_icp_takes_its_file(folder: Path) -> None:
    parser = pytest.importorskip("kiss_icp.config.parser", reason="KISS-ICP reads its configuration")
    config = parser.load_config(folder / "kiss_icp.yaml")
    assert (config.data.max_range, config.data.deskew, config.mapping.voxel_size) == (120.0, True, 1.2)


def test_rko_lio(folder: Path) -> None:
    settings = yaml.safe_load((folder / "rko_lio.yaml").read_text())
    for name, frame in (("imu", IMU), ("lidar", LIDAR)):
        values = settings.pop(f"extrinsic_{name}2base_quat_xyzw_xyz")
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.from_quat(values[:4]).as_matrix(), values[4:]
        assert np.allclose(T, true(LIDAR, frame))
    config = pytest.importorskip("rko_lio.config", reason="RKO-LIO names its settings")
    assert set(settings) <= set(config.LIOConfig.__dataclass_fields__)


def test_a_loam(folder: Path) -> None:
    launch = ElementTree.fromstring((folder / "a_loam.launch").read_text())
    values = {param.get("name"): param.get("value") for param in launch.iter("param")}
    assert values["scan_line"] == "32"
    (remap,) = launch.iter("remap")
    assert (remap.get("from"), remap.get("to")) == ("/velodyne_points", "/lidar/points")


def test_lego_loam_reads_the_lidar_alone(folder: Path) -> None:
    """Its topics are compiled in; on /imu/data it takes an attitude, which our IMU does not state."""
    launch = ElementTree.fromstring((folder / "lego_loam.launch").read_text())
    renamed = {remap.get("from"): remap.get("to") for remap in launch.iter("remap")}
    assert renamed.pop("/velodyne_points") == "/lidar/points"
    assert renamed.keys() == {"/imu/data"}
    assert renamed["/imu/data"] != STANDARD.topic(Imu, IMU)


def test_lenses_that_a_system_has_no_model_for_leave_its_file_out() -> None:
    def texts(lens: Lens) -> dict[str, str]:
        rig = replace(RIG, cameras=tuple(replace(camera, lens=lens) for camera in RIG.cameras))
        return calibration_texts(rig, STANDARD)

    assert "basalt.json" not in texts(Lens(model="radtan", coefficients=(-0.2, 0.0, 0.0, 0.0)))
    fisheye = texts(Lens(model="equidistant", coefficients=(0.01, 0.0, 0.0, 0.0)))
    camera = json.loads(fisheye["basalt.json"])["value0"]["intrinsics"][0]
    assert (camera["camera_type"], camera["intrinsics"]["k1"]) == ("kb4", 0.01)
    assert "distortion_model: equidistant" in fisheye["s_msckf/camchain-imucam.yaml"]


def test_a_noise_of_zero_becomes_a_floor_that_the_files_name(tmp_path: Path, folder: Path) -> None:
    """Kalibr refuses a noise of 0, and estimators divide by it."""
    nothing: dict[str, Any] = dict.fromkeys(NOISE_FLOORS, 0.0)
    assert RIG.imu is not None
    write_calibration(tmp_path, replace(RIG, imu=replace(RIG.imu, **nothing)))
    # Where each file has the figures, in the order of `NOISE_FLOORS`, and a factor of the two densities.
    kalibr = " ".join(NOISE_FLOORS)
    places = {
        "kalibr/imu.yaml": ("", kalibr, 1),
        "open_vins/kalibr_imu_chain.yaml": ("imu0", kalibr, 1),
        "orbslam3_stereo_inertial.yaml": ("", "IMU.NoiseAcc IMU.AccWalk IMU.NoiseGyro IMU.GyroWalk", 1),
        "vins_fusion/stereo_inertial.yaml": ("", "acc_n acc_w gyr_n gyr_w", 50),
        "lio_sam.yaml": ("lio_sam", "imuAccNoise imuAccBiasN imuGyrNoise imuGyrBiasN", 1),
        "basalt.json": ("value0", "accel_noise_std accel_bias_std gyro_noise_std gyro_bias_std", 1),
    }
    for name, (part, keys, factor) in places.items():
        text = (tmp_path / name).read_text()
        assert all(f"{figure}: the rig has 0.0; raised to a floor" in text for figure in NOISE_FLOORS), name
        assert "floor" not in (folder / name).read_text()
        storage = opened(tmp_path / name)
        node = storage.getNode(part) if part else storage.root()
        found = [node.getNode(key) for key in keys.split()]
        values = [(value.at(0) if value.isSeq() else value).real() for value in found]
        expected = np.multiply(list(NOISE_FLOORS.values()), [factor, 1, factor, 1])
        np.testing.assert_allclose(values, expected, err_msg=name)


@pytest.mark.parametrize("grade", IMU_GRADES)
def test_real_imus_lie_above_the_floors(grade: str) -> None:
    imu = RigCalibration.from_configs([ImuConfig(**ImuConfig.preset_values(grade))]).imu
    assert imu is not None
    assert not imu.raised


def test_rates_and_ranges_that_systems_refuse_are_not_written() -> None:
    assert RIG.lidar is not None
    lidar = replace(RIG.lidar, rate_hz=0.4, range_min_m=0.5, range_max_m=1.5)
    cameras = tuple(replace(camera, rate_hz=0.4) for camera in RIG.cameras)
    texts = calibration_texts(replace(RIG, lidar=lidar, cameras=cameras), STANDARD)
    assert "gives 0.4 clouds a second.\n    scan_rate: 1\n" in texts["fast_lio.yaml"]
    assert "give 0.4 pictures a second.\nCamera.fps: 1\n" in texts["orbslam3_stereo.yaml"]
    for name in ("kiss_icp.yaml", "rko_lio.yaml"):
        assert "min_range: 0.5\n" in texts[name]
    assert "lidarMinRange: 0.5\n" in texts["lio_sam.yaml"]


def test_files_that_would_hold_a_divisor_of_zero_are_left_out() -> None:
    assert RIG.lidar is not None
    at_one_place = dict.fromkeys((camera.frame for camera in RIG.cameras), RIG.cameras[0].T_base_camera)
    lidar = replace(RIG.lidar, elevations_deg=(0.0,))
    flat = replace(RIG, frames={**RIG.frames, **at_one_place}, lidar=lidar)
    left_out = calibration_texts(RIG, STANDARD).keys() - calibration_texts(flat, STANDARD).keys()
    of = {re.split("[_./]", name)[0] for name in left_out}
    assert of == {"orbslam3", "vins", "open", "s", "lego", "a"}


@pytest.mark.parametrize("name", ["mid360", "avia", "aeries2"])
def test_patterns_get_no_files_of_rings_and_columns(name: str) -> None:
    """Systems that take points as they come keep theirs; FAST-LIO2's has the driver's lines."""
    lidar = LidarConfig(**LidarConfig.preset_values(name))
    texts = calibration_texts(RigCalibration.from_configs([ImuConfig(), lidar]), STANDARD)
    assert {"kiss_icp.yaml", "fast_lio.yaml", "rko_lio.yaml"} <= texts.keys()
    assert not {"a_loam.launch", "lio_sam.yaml", "lego_loam.launch"} & texts.keys()
    assert f"scan_line: {lidar.rings}\n" in texts["fast_lio.yaml"]


@pytest.mark.parametrize(("rig", "near_m"), [("flu", 2.0), ("real", 3.0)])
def test_systems_leave_out_returns_of_the_own_car(rig: str, near_m: float) -> None:
    """The bonnet ends 2.7 m from the LiDAR: where it is reported, systems begin at 3 m."""
    configs = [c for c in rig_by_name(rig).sensors if c.kind in ("imu", "lidar")]
    texts = calibration_texts(RigCalibration.from_configs(configs), STANDARD)
    for name in ("kiss_icp.yaml", "rko_lio.yaml"):
        assert f"min_range: {near_m}\n" in texts[name]
    assert f"lidarMinRange: {near_m}\n" in texts["lio_sam.yaml"]
    assert f"blind: {near_m}\n" in texts["fast_lio.yaml"]
    assert not any("offset" in text and "laser" in text for text in texts.values())
