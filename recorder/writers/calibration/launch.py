"""Launch files for ROS 1 nodes: with the files beside them, and with the topics of the bags."""

from __future__ import annotations

from collections.abc import Mapping

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image, Imu, PointCloud
from recorder.writers.rig_calibration import LidarCalibration, RigCalibration
from recorder.writers.topics import TopicProfile

A_LOAM_BEAMS = (16, 32, 64)
"""Numbers of beams that A-LOAM takes."""
_S_MSCKF = {
    "max_cam_state_size": 20,
    "position_std_threshold": 8.0,
    "feature/config/translation_threshold": -1.0,
    "noise/gyro": 0.005,
    "noise/acc": 0.05,
    "noise/gyro_bias": 0.001,
    "noise/acc_bias": 0.01,
    "noise/feature": 0.035,
    "initial_covariance/velocity": 0.25,
}
_S_MSCKF_IMAGES = {"grid_row": 4, "grid_col": 5, "grid_max_feature_num": 4, "ransac_threshold": 3}


def fast_lio_launch() -> str:
    """FAST-LIO2 with ``fast_lio.yaml``; ``features:=true`` makes it extract features."""
    params = {
        "feature_extract_enable": "$(arg features)",
        "point_filter_num": 4,
        "max_iteration": 3,
        "filter_size_surf": 0.5,
        "filter_size_map": 0.5,
        "cube_side_length": 1000.0,
    }
    text = '<arg name="features" default="false" />\n' + _load("fast_lio.yaml") + _params(params)
    return _launch(text + _node("fast_lio", "fastlio_mapping", "laserMapping"))


def a_loam_launch(lidar: LidarCalibration, topics: TopicProfile) -> str:
    """A-LOAM's three nodes; `lego_loam.md` has its traps with this LiDAR.

    Raises:
        WriterError: the LiDAR has a number of beams that A-LOAM does not take.
    """
    if lidar.rings not in A_LOAM_BEAMS:
        raise WriterError(f"A-LOAM takes {A_LOAM_BEAMS} beams, not {lidar.rings}; change the LiDAR")
    params = {
        "scan_line": lidar.rings,
        "mapping_skip_frame": 1,
        "minimum_range": max(2.0, lidar.range_min_m),
        "mapping_line_resolution": 0.2,
        "mapping_plane_resolution": 0.4,
    }
    text = f"<!-- Set scanPeriod in src/scanRegistration.cpp to {1 / lidar.rate_hz:.3f}. -->\n" + _params(
        params
    )
    for name in ("ascanRegistration", "alaserOdometry", "alaserMapping"):
        text += _node("aloam_velodyne", name, name, _points(name, lidar, topics))
    return _launch(text)


def lego_loam_launch(lidar: LidarCalibration, topics: TopicProfile) -> str:
    """LeGO-LOAM's four nodes and the turns between its camera's axes and the world's."""
    turns = {
        "camera_init_to_map": "0 0 0 1.570795 0 1.570795 map camera_init 10",
        "base_link_to_camera": "0 0 0 -1.570795 -1.570795 0 camera base_link 10",
    }
    text = "".join(_node("tf", "static_transform_publisher", name, args=args) for name, args in turns.items())
    for name in ("imageProjection", "featureAssociation", "mapOptmization", "transformFusion"):
        inside = _points(name, lidar, topics)
        if name == "featureAssociation":
            # It takes attitudes from there, and an IMU without an attitude states none.
            inside += _renamed({"/imu/data": "/imu/with_attitude"})
        text += _node("lego_loam", name, name, inside)
    return _launch(text)


def vins_launch(settings: str) -> str:
    """VINS-Fusion's estimator with a settings file beside it."""
    return _launch(_node("vins", "vins_node", "vins_estimator", args=f"$(dirname)/{settings}"))


def open_vins_launch() -> str:
    """OpenVINS with ``estimator_config.yaml``."""
    config = _params({"config_path": "$(dirname)/estimator_config.yaml"})
    return _launch(_node("ov_msckf", "run_subscribe_msckf", "ov_msckf", config))


def s_msckf_launch(rig: RigCalibration, topics: TopicProfile) -> str:
    """S-MSCKF's two nodes with ``camchain-imucam.yaml``; noise is that of its settings for EuRoC.

    Raises:
        WriterError: the rig has no stereo pair or no IMU.
    """
    if rig.imu is None or len(rig.cameras) < 2:
        raise WriterError("S-MSCKF needs two cameras and an IMU; add them to the rig")
    left, right = rig.cameras[:2]
    imu = {"~imu": topics.topic(Imu, rig.imu.name)}
    images = {
        "~cam0_image": topics.topic(Image, left.stream),
        "~cam1_image": topics.topic(Image, right.stream),
    }
    chain = _load("camchain-imucam.yaml")
    text = _node(
        "nodelet",
        "nodelet",
        "image_processor",
        chain + _params(_S_MSCKF_IMAGES) + _renamed(imu | images),
        args="standalone msckf_vio/ImageProcessorNodelet",
    )
    text += _node(
        "nodelet",
        "nodelet",
        "vio",
        chain
        + _params({"frame_rate": left.rate_hz, **_S_MSCKF})
        + _renamed(imu | {"~features": "image_processor/features"}),
        args="standalone msckf_vio/MsckfVioNodelet",
    )
    return _launch(f'<group ns="s_msckf">\n{_indented(text)}</group>\n')


def _points(node: str, lidar: LidarCalibration, topics: TopicProfile) -> str:
    """The LiDAR's topic for the node that reads sweeps."""
    reads = node in ("ascanRegistration", "imageProjection")
    return _renamed({"/velodyne_points": topics.topic(PointCloud, lidar.name)}) if reads else ""


def _launch(text: str) -> str:
    return f"<launch>\n{_indented(text)}</launch>\n"


def _node(package: str, program: str, name: str, inside: str = "", *, args: str = "") -> str:
    """A node whose end ends all."""
    given = f' args="{args}"' if args else ""
    return (
        f'<node pkg="{package}" type="{program}" name="{name}"{given} output="screen" required="true">\n'
        f"{_indented(inside)}</node>\n"
    )


def _params(values: Mapping[str, object]) -> str:
    return "".join(
        f'<param name="{name}" value="{str(value).lower() if isinstance(value, bool) else value}" />\n'
        for name, value in values.items()
    )


def _renamed(names: dict[str, str]) -> str:
    return "".join(f'<remap from="{name}" to="{topic}" />\n' for name, topic in names.items())


def _load(file: str) -> str:
    return f'<rosparam command="load" file="$(dirname)/{file}" />\n'


def _indented(text: str) -> str:
    return "".join(f"    {line}\n" for line in text.splitlines())
