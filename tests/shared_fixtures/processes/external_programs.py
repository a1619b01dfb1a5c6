"""Programs of others, run by the files that we give: where those are, and what is missing here."""

import shutil
import subprocess
from pathlib import Path

from recorder.slam.runners.command import program_path

EXTERNAL = Path(__file__).parents[3] / "examples" / "external"
SYSTEM_PYTHON = "/usr/bin/python3"
"""The Python that has Debian's ROS 1."""
_NO_ROS = "no ROS 1; apt-get install ros-core python3-rosbag python3-nav-msgs python3-sensor-msgs"
_PIP = {
    "kiss_icp_pipeline": 'pip install "kiss-icp[all]" rosbags',
    "genz_icp_pipeline": 'pip install "genz-icp[all]" rosbags',
    "kiss_slam_pipeline": "pip install kiss-slam pillow matplotlib rosbags",
    "rko_lio": "pip install rko_lio rosbags",
}


def missing_program(name: str) -> str:
    """How to get a program of a wheel; empty: it is there."""
    there = shutil.which(name, path=program_path())
    return "" if there else f"{name} is not installed; {_PIP[name]}"


def missing_ros(package: str = "rosbag") -> str:
    """How to get Debian's ROS 1 and a package that it has to find; empty: both are there."""
    needed = "rospy, rosbag, rospkg, nav_msgs.msg, sensor_msgs.msg"
    words = [SYSTEM_PYTHON, "-c", f"import {needed}; rospkg.RosPack().get_path('{package}')"]
    if shutil.which("roscore") is None or not Path(SYSTEM_PYTHON).exists():
        return _NO_ROS
    found = subprocess.run(words, capture_output=True, check=False, text=True)
    if "ResourceNotFound" in found.stderr:
        return f"ROS finds no package {package}; build it and name its folder in ROS_PACKAGE_PATH"
    return _NO_ROS if found.returncode else ""
