"""The SLAM systems that can be run, by name."""

from __future__ import annotations

import runpy
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, unknown_name
from recorder.slam.system import END, MIDDLE, START, System
from recorder.slam.system_file import read_system_file

_RUNNERS = "recorder.slam.runners"
_EVALIO = "evalio's pipelines return the pose at the stamp of the sweep"


def _evalio(name: str, title: str, what: str, *needs: str) -> System:
    return System(
        name=name,
        title=title,
        what=f"{what}, in evalio",
        needs=("lidar", "imu", *needs),
        runner=f"{_RUNNERS}.evalio:{name}",
        frame="imu",
        instant=START,
        instant_source=_EVALIO,
        library="evalio",
        package="evalio",
    )


def _orbslam3(name: str, title: str, mode: str, frame: str, *needs: str) -> System:
    return System(
        name=name,
        title=title,
        what=f"ORB-SLAM3 (Campos et al. 2021), {mode}, without loop closures",
        needs=needs,
        runner=f"{_RUNNERS}.orbslam3:{mode.replace('-', '_')}",
        frame=frame,
        library="pyorbslam3",
        package="pyorbslam3",
        extra="orbslam3",
        python="CARLALOC_ORBSLAM3_PYTHON",
        file="CARLALOC_ORBSLAM3_VOCABULARY",
        file_hint="give ORBvoc.txt of its authors, or train one: carlaloc vocabulary DATA --out orb.txt",
    )


SYSTEMS = {
    system.name: system
    for system in (
        System(
            name="kiss_icp",
            title="KISS-ICP",
            what="LiDAR odometry (Vizzo et al. 2023)",
            needs=("lidar",),
            runner=f"{_RUNNERS}.kiss_icp:run",
            frame="lidar",
            instant=END,
            instant_source="KISS-ICP ≥ 1.2 moves all points to the sweep's end",
            library="kiss_icp",
            package="kiss-icp",
        ),
        System(
            name="genz_icp",
            title="GenZ-ICP",
            what="LiDAR odometry (Lee et al. 2025)",
            needs=("lidar",),
            runner=f"{_RUNNERS}.genz_icp:run",
            frame="lidar",
            instant=MIDDLE,
            instant_source="GenZ-ICP moves all points to the sweep's middle, as KISS-ICP did before 1.2",
            library="genz_icp",
            package="genz-icp",
        ),
        System(
            name="small_gicp",
            title="small_gicp",
            what="scan-to-map GICP (Koide 2024)",
            needs=("lidar",),
            runner=f"{_RUNNERS}.small_gicp:run",
            frame="lidar",
            instant=MIDDLE,
            instant_source="a sweep that is not compensated shows its middle best",
            library="small_gicp",
            package="small_gicp",
        ),
        System(
            name="rko_lio",
            title="RKO-LIO",
            what="LiDAR-inertial odometry (Malladi et al. 2025)",
            needs=("lidar", "imu"),
            runner=f"{_RUNNERS}.rko_lio:run",
            frame="imu",
            instant=END,
            instant_source="its own stamps are the ends of the sweeps",
            library="rko_lio",
            package="rko_lio",
        ),
        _evalio("loam", "LOAM", "LiDAR odometry by features (McGann's LOAM)"),
        _evalio("lio_sam", "LIO-SAM", "LiDAR-inertial smoothing (Shan et al. 2020)"),
        _evalio("dlio", "DLIO", "LiDAR-inertial odometry (Chen et al. 2023)"),
        _evalio("ct_icp", "CT-ICP", "LiDAR odometry in continuous time (Dellenbach et al. 2022)"),
        _evalio("mad_icp", "MAD-ICP", "LiDAR odometry (Ferrari et al. 2024)"),
        _evalio("form", "FORM", "LiDAR odometry with a fixed lag (Potokar and Kaess 2025)"),
        _orbslam3("orbslam3_stereo", "ORB-SLAM3 SVO", "stereo", "camera", "stereo"),
        _orbslam3("orbslam3_stereo_inertial", "ORB-SLAM3 SVIO", "stereo-inertial", "imu", "stereo", "imu"),
        System(
            name="stereo_vo",
            title="stereo-vo",
            what="our own stereo odometry on OpenCV: corners, tracks, PnP, window adjustment",
            needs=("stereo",),
            runner="recorder.slam.stereo_vo.odometry:run",
            frame="camera",
        ),
    )
}
"""Systems by name."""


def system_of(word: str) -> System:
    """A system by its name, out of a Python file that defines ``SYSTEM``, or by a YAML file.

    Args:
        word: Name of one of `SYSTEMS`, or path of a ``.py`` or ``.yaml`` file (docs/your-system.md).

    Raises:
        ConfigError: there is no such system, or the file defines none.
    """
    if word.endswith((".yaml", ".yml")):
        return read_system_file(Path(word)).system
    if not word.endswith(".py"):
        if word not in SYSTEMS:
            raise ConfigError(
                unknown_name("method", word, SYSTEMS) + ", or a .py or .yaml file that describes one"
            )
        return SYSTEMS[word]
    if not Path(word).is_file():
        raise ConfigError(f"{word}: no such file; give the path of a .py file that defines SYSTEM")
    # Code of the user's own choice runs in this process, as that of any script does.
    found = runpy.run_path(word).get("SYSTEM")
    if not isinstance(found, System):
        raise ConfigError(f"{word} defines no SYSTEM; see docs/your-system.md")
    return found
