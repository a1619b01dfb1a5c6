"""Systems that are programs, described by a YAML file: a command, its inputs, and the frame of its poses."""

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
            runner="recorder.slam.system_file:run",
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
