"""The SLAM systems that can be run, by name.

Systems that are programs, described by a YAML file: a command, what it reads, and what its poses mean.
"""

import runpy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.core.files.text_files import read_text
from recorder.dataset.sequence import SlamSequence
from recorder.slam.ros1.runner import Ros1Node
from recorder.slam.runners.command import run_command
from recorder.slam.system import END, MIDDLE, START, FrameClock, StampedPose, System

_INSTANTS = {"start": START, "middle": MIDDLE, "end": END}
_FRAMES = ("lidar", "imu", "camera", "base_link")
_INPUTS = ("lidar", "imu", "stereo")


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemFile:
    """Keys of such a file; name, title, needs and frame must be there, and a command or a ROS 1 node."""

    name: str
    """Name of its results."""
    title: str
    """Name in tables."""
    needs: tuple[str, ...]
    """What it reads: ``lidar``, ``imu``, ``stereo``."""
    frame: str
    """Frame of its poses: ``lidar``, ``imu``, ``camera`` (the left one) or ``base_link``."""
    command: tuple[str, ...] = ()
    """Program and words, see `recorder.slam.runners.command.run_command`; ``{here}`` is the file's folder."""
    ros1: Ros1Node | None = None
    """The ROS 1 node that is fed in place of a command."""
    what: str = ""
    """A few words on it."""
    instant: str = "start"
    """Instant of its poses within a sweep: ``start``, ``middle`` or ``end``."""
    instant_source: str = "its settings"
    """Source of that instant."""
    topic: str | None = None
    """Topic of its poses in ``{out_bag}``, if it writes one; None: it writes ``{out}``."""

    def __post_init__(self) -> None:
        if self.frame not in _FRAMES:
            raise ConfigError(unknown_name("frame", self.frame, _FRAMES))
        if self.instant not in _INSTANTS:
            raise ConfigError(unknown_name("instant", self.instant, _INSTANTS))
        for need in self.needs:
            if need not in _INPUTS:
                raise ConfigError(unknown_name("input", need, _INPUTS))
        if bool(self.command) == (self.ros1 is not None):
            raise ConfigError(f"'{self.name}' must have either 'command' or 'ros1'")
        wanted = "{out}" if self.topic is None else "{out_bag}"
        if self.command and not any(wanted in word for word in self.command):
            raise ConfigError(f"the command of '{self.name}' names no {wanted} to write its poses to")

    @property
    def system(self) -> System:
        """The system, as a benchmark runs it."""
        return System(
            name=self.name,
            title=self.title,
            what=self.what,
            needs=self.needs,
            runner="recorder.slam.systems:run",
            frame=self.frame,
            instant=_INSTANTS[self.instant],
            instant_source=self.instant_source,
            takes_seg=self.ros1 is not None and "lidar" in self.needs,
        )

    def run(self, sequence: SlamSequence, clock: FrameClock) -> list[StampedPose]:
        """Poses that its command or its node has given."""
        sensor = self.system.sensor
        if self.ros1 is not None:
            return self.ros1.run(sequence, clock, sensor=sensor)
        return run_command(sequence, clock, self.command, sensor=sensor, topic=self.topic)


def is_system_file(word: str) -> bool:
    """Whether a word that names a system is such a file."""
    return word.endswith((".yaml", ".yml"))


def read_system_file(path: Path) -> SystemFile:
    """Read the description of a program.

    Raises:
        ConfigError: the file is missing, no YAML, or lacks or has keys that it should not.
    """
    try:
        keys: Any = yaml.safe_load(read_text(path, "description of a system", ConfigError))
    except yaml.YAMLError as error:
        raise ConfigError(f"{path} is no YAML: {' '.join(str(error).split())}") from error
    try:
        return from_mapping(SystemFile, _with_folder(keys, str(path.resolve().parent)), str(path))
    except ConfigError as error:
        raise ConfigError(f"{error}; see docs/your-system.md") from error


def _with_folder(value: Any, here: str) -> Any:
    """A value with the file's folder in place of ``{here}``; words of a list are texts."""
    if isinstance(value, dict):
        return {key: _with_folder(item, here) for key, item in value.items()}
    if isinstance(value, list):
        return [str(word).replace("{here}", here) for word in value]
    return value


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
