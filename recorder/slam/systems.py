"""The SLAM systems that can be run, by name."""

import runpy
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, unknown_name
from recorder.slam.system import END, MIDDLE, START, System
from recorder.slam.system_file import read_system_file

_RUNNERS = "recorder.slam.runners"


def _lidar(
    name: str, title: str, what: str, instant: float, why: str, *, inertial: bool = False, package: str = ""
) -> System:
    return System(
        name=name, title=title, what=what, needs=("lidar", "imu") if inertial else ("lidar",),
        runner=f"{_RUNNERS}.lidar_odometry:run_{name}", frame="imu" if inertial else "lidar", instant=instant,
        instant_source=why, library=name, package=package or name,
    )  # fmt: skip


def _evalio(name: str, title: str, what: str) -> System:
    return System(
        name=name, title=title, what=f"{what}, in evalio", needs=("lidar", "imu"),
        runner=f"{_RUNNERS}.evalio_pipelines:{name}", frame="imu", instant=START,
        instant_source="evalio's pipelines return the pose at the stamp of the sweep",
        library="evalio", package="evalio", extra="evalio",
    )  # fmt: skip


def _orbslam3(name: str, title: str, mode: str, frame: str, *needs: str) -> System:
    return System(
        name=name, title=title, what=f"ORB-SLAM3 (Campos et al. 2021), {mode}, without loop closures",
        needs=needs, runner=f"{_RUNNERS}.orbslam3:{mode.replace('-', '_')}", frame=frame,
        library="pyorbslam3", package="pyorbslam3", extra="orbslam3",
        python="CARLALOC_ORBSLAM3_PYTHON", file="CARLALOC_ORBSLAM3_VOCABULARY",
        file_hint="give ORBvoc.txt of its authors, or train one: carlaloc vocabulary DATA --out orb.txt",
    )  # fmt: skip


SYSTEMS = {
    system.name: system
    for system in (
        _lidar(
            "kiss_icp", "KISS-ICP", "LiDAR odometry (Vizzo et al. 2023)", END,
            "KISS-ICP ≥ 1.2 moves all points to the sweep's end", package="kiss-icp",
        ),
        _lidar(
            "genz_icp", "GenZ-ICP", "LiDAR odometry (Lee et al. 2025)", MIDDLE,
            "GenZ-ICP moves all points to the sweep's middle, as KISS-ICP did before 1.2", package="genz-icp",
        ),
        _lidar(
            "small_gicp", "small_gicp", "scan-to-map GICP (Koide 2024)", MIDDLE,
            "a sweep that is not compensated shows its middle best",
        ),
        _lidar(
            "rko_lio", "RKO-LIO", "LiDAR-inertial odometry (Malladi et al. 2025)", END,
            "its own stamps are the ends of the sweeps", inertial=True,
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
            runner="recorder.slam.stereo_vo:run",
            frame="camera",
        ),
    )
}  # fmt: skip
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
    system = runpy.run_path(word).get("SYSTEM")
    if not isinstance(system, System):
        raise ConfigError(f"{word} defines no SYSTEM; see docs/your-system.md")
    return system
